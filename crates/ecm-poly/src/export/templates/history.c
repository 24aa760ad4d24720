/* A history of steps; every other step is done again from a copy of the state before it. */
static int history(void)
{
    @NAME@_state state, saved;
    int wrong = !@NAME@_init(&state, @NAME@_history_p[0]);
    for (int32_t i = 0; i < @NAME@_history_count; i++) {
        @NAME@_real h[6], k[36], again[6], slope[36], none[6] = {0};
        saved = state;
        wrong += !@NAME@_step(&state, @NAME@_history_p[i], @NAME@_history_dt[i],
                              &@NAME@_history_inputs[i], h, k);
        for (int32_t j = 0; j < 6; j++) {
            const @NAME@_real e = h[j] - @NAME@_history_h[i][j];
            wrong += !(e <= @NAME@_history_h_tolerance && e >= -@NAME@_history_h_tolerance);
        }
        for (int32_t j = 0; j < 36; j++) {
            const @NAME@_real e = k[j] - @NAME@_history_k[i][j];
            wrong += !(e <= @NAME@_history_k_tolerance && e >= -@NAME@_history_k_tolerance);
        }
        if (i % 2 == 1) {
            wrong += !@NAME@_step(&saved, @NAME@_history_p[i], @NAME@_history_dt[i],
                                  &@NAME@_history_inputs[i], again, slope);
            for (int32_t j = 0; j < 6; j++) {
                wrong += again[j] != h[j];
                wrong += saved.memory[0][j] != state.memory[0][j];
            }
        }
        saved = state;
        none[0] = (@NAME@_real)0;
        none[0] /= none[0];
        wrong += @NAME@_step(&state, none, @NAME@_history_dt[i], 0, again, slope) != 0;
        wrong += @NAME@_step(&state, @NAME@_history_p[i], (@NAME@_real)-1, 0, again, slope) != 0;
        wrong += again[0] == again[0];
        for (int32_t j = 0; j < 6; j++) {
            wrong += saved.memory[0][j] != state.memory[0][j] || saved.pose[j] != state.pose[j];
        }
    }
    return wrong;
}

