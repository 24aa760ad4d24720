int32_t @NAME@_predict_ahead(const state_t *state, const real *p, int32_t count, real dt,
                             const inputs_t *inputs, real *h, real *k)
{
    state_t ahead = *state;
    real slope[@NM@];
    for (int32_t i = 0; i < count; i++) {
        real *tangent = k ? k + @NM@ * i : slope;
        if (!@NAME@_step(&ahead, p + @N@ * i, dt, inputs, h + @M@ * i, tangent)) {
            return i;
        }
    }
    return count;
}
