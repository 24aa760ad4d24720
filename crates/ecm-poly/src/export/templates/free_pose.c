
/* Largest step of each coordinate in one iteration: the poses near which the model means something. */
static const real most_step[6] = {@MOSTSTEP@};

int32_t @NAME@_free_pose(const real a[@ACTUATORS@], const real wrench[6], real pose[6])
{
    real p[@N@], h[6], k[@NM@], row_of[6][7], step[6];
    for (int32_t i = 0; i < @N@; i++) {
        p[i] = i < 6 ? pose[i] : a[i - 6];
    }
    for (int32_t count = 1; count <= @NAME@_most_iterations; count++) {
        real largest = R(0);
        @NAME@_value_and_stiffness(p, h, k);
        for (int32_t i = 0; i < 6; i++) {
            for (int32_t j = 0; j < 6; j++) {
                row_of[i][j] = k[@N@ * i + j];
            }
            row_of[i][6] = wrench[i] - h[i];
        }
        for (int32_t j = 0; j < 6; j++) { /* elimination with the largest pivot of each column */
            int32_t pivot = j;
            for (int32_t i = j + 1; i < 6; i++) {
                const real x = row_of[i][j], y = row_of[pivot][j];
                pivot = x * x > y * y ? i : pivot;
            }
            for (int32_t l = j; l < 7; l++) {
                const real x = row_of[j][l];
                row_of[j][l] = row_of[pivot][l];
                row_of[pivot][l] = x;
            }
            for (int32_t i = j + 1; i < 6; i++) {
                const real x = row_of[i][j] / row_of[j][j];
                for (int32_t l = j; l < 7; l++) {
                    row_of[i][l] -= x * row_of[j][l];
                }
            }
        }
        for (int32_t j = 5; j >= 0; j--) {
            real left = row_of[j][6], share;
            for (int32_t l = j + 1; l < 6; l++) {
                left -= row_of[j][l] * step[l];
            }
            step[j] = left / row_of[j][j];
            share = step[j] / most_step[j];
            share = share < R(0) ? -share : share;
            largest = share <= largest ? largest : share; /* keeps what is no number */
        }
        if (!(largest < R(1e6))) {
            return 0;
        }
        for (int32_t i = 0; i < 6; i++) {
            p[i] += largest > R(1) ? step[i] / largest : step[i];
        }
        if (largest < R(@SETTLED@)) {
            for (int32_t i = 0; i < 6; i++) {
                pose[i] = p[i];
            }
            return count;
        }
    }
    return 0;
}
