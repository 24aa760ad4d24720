/* Whether free_pose, from beside a pose, finds one that takes the pose's wrench. */
static int free_pose_wrong(const @NAME@_real *p, const @NAME@_real *h)
{
    @NAME@_real q[@N@], found[6];
    int wrong = 0;
    for (int32_t i = 0; i < @N@; i++) {
        q[i] = p[i] + (i < 6 ? (@NAME@_golden_p[0][i] - p[i]) / (@NAME@_real)100 : 0);
    }
    wrong += @NAME@_free_pose(q + 6, h, q) == 0;
    @NAME@_value(q, found);
    for (int32_t j = 0; j < 6; j++) {
        const @NAME@_real e = found[j] - h[j];
        wrong += !(e <= @NAME@_golden_h_tolerance && e >= -@NAME@_golden_h_tolerance);
    }
    q[0] /= (@NAME@_real)0;
    return wrong + (@NAME@_free_pose(q + 6, h, q) != 0);
}

