/* Whether two states differ in any bit. */
static int different(const @NAME@_state *a, const @NAME@_state *b)
{
    const uint8_t *one = (const uint8_t *)a, *other = (const uint8_t *)b;
    int found = 0;
    for (uint32_t i = 0; i < (uint32_t)sizeof *a; i++) {
        found |= one[i] != other[i];
    }
    return found;
}

/* The edges of the inputs' ranges and what lies beyond them. */
static int inputs_wrong(void)
{
    @NAME@_conditions inputs = @NAME@_default_conditions;
    int wrong = !@NAME@_inputs_inside(&@NAME@_least_conditions);
    wrong += !@NAME@_inputs_inside(&@NAME@_largest_conditions);
    inputs.temperature_degC = (@NAME@_real)0;
    inputs.temperature_degC /= inputs.temperature_degC;
    wrong += @NAME@_inputs_inside(&inputs);
    inputs = @NAME@_default_conditions;
    inputs.age_s = (@NAME@_real)0;
    inputs.age_s /= inputs.age_s;
    wrong += @NAME@_inputs_inside(&inputs);
    return wrong;
}

/* A history of steps; every other step is done again from a copy of the state before it. */
static int history(void)
{
    @NAME@_state state, saved;
    int wrong = !@NAME@_init(&state, @NAME@_history_p[0]);
    for (int32_t i = 0; i < @NAME@_history_count; i++) {
        @NAME@_real h[@M@], k[@NM@], again[@M@], slope[@NM@], none[@N@] = {0};
        saved = state;
        wrong += !@NAME@_step(&state, @NAME@_history_p[i], @NAME@_history_dt[i],
                              &@NAME@_history_inputs[i], h, k);
        for (int32_t j = 0; j < @M@; j++) {
            const @NAME@_real e = h[j] - @NAME@_history_h[i][j];
            wrong += !(e <= @NAME@_history_h_tolerance && e >= -@NAME@_history_h_tolerance);
        }
        for (int32_t j = 0; j < @NM@; j++) {
            const @NAME@_real e = k[j] - @NAME@_history_k[i][j];
            wrong += !(e <= @NAME@_history_k_tolerance && e >= -@NAME@_history_k_tolerance);
        }
        if (i % 2 == 1) {
            wrong += !@NAME@_step(&saved, @NAME@_history_p[i], @NAME@_history_dt[i],
                                  &@NAME@_history_inputs[i], again, 0);
            for (int32_t j = 0; j < @M@; j++) {
                wrong += again[j] != h[j];
            }
            wrong += different(&saved, &state);
        }
        wrong += !@NAME@_settled(@NAME@_history_p[i], 0, again, 0);
        saved = state;
        none[0] = (@NAME@_real)0;
        none[0] /= none[0];
        wrong += @NAME@_step(&state, none, @NAME@_history_dt[i], 0, again, slope) != 0;
        wrong += @NAME@_step(&state, @NAME@_history_p[i], (@NAME@_real)-1, 0, again, slope) != 0;
        wrong += again[0] == again[0];
        wrong += different(&saved, &state);
        /* Two steps ahead of the next ones, from a state that stays. */
        if (i + 2 < @NAME@_history_count) {
            const @NAME@_conditions *inputs = &@NAME@_history_inputs[i + 1];
            @NAME@_real ahead[2 * @M@], slopes[2 * @NM@];
            wrong += @NAME@_predict_ahead(&state, @NAME@_history_p[i + 1], 2, (@NAME@_real)0.01, inputs,
                                          ahead, slopes) != 2;
            wrong += different(&saved, &state);
            for (int32_t n = 0; n < 2; n++) {
                wrong += !@NAME@_step(&saved, @NAME@_history_p[i + 1 + n], (@NAME@_real)0.01, inputs,
                                      again, slope);
                for (int32_t j = 0; j < @M@; j++) {
                    wrong += ahead[@M@ * n + j] != again[j];
                }
                for (int32_t j = 0; j < @NM@; j++) {
                    wrong += slopes[@NM@ * n + j] != slope[j];
                }
            }
            wrong += @NAME@_predict_ahead(&state, none, 1, (@NAME@_real)0.01, inputs, ahead, 0) != 0;
        }
    }
    return wrong + inputs_wrong();
}

