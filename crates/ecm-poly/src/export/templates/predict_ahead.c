int32_t @NAME@_predict_ahead(const state_t *state, const real *p, int32_t count, real dt,
                             const inputs_t *inputs, real *h, real *k)
{
    state_t ahead = *state;
    for (int32_t i = 0; i < count; i++) {
        if (!@NAME@_step(&ahead, p + @N@ * i, dt, inputs, h + @M@ * i, k ? k + @NM@ * i : k)) {
            return i;
        }
    }
    return count;
}
