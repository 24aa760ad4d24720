/* 1/k! */
static const real inverse_factorial[10] = {@FACTORIALS@};

static int32_t is_finite(real x) { return x - x == R(0); }

/* 1 - exp(-x) by its series at x / 1024, then s <- s (2 - s) ten times, and (1 - exp(-x)) / x */
static void decay(real x, real *lost, real *left)
{
    real y = (x < R(64) ? x : R(64)) / R(1024), sum = R(0);
    if (x < R(@EPSILON@)) {
        *lost = x;
        *left = R(1);
        return;
    }
    for (int32_t j = 9; j >= 1; j--) {
        sum = inverse_factorial[j] - y * sum;
    }
    y *= sum;
    for (int32_t j = 0; j < 10; j++) {
        y *= R(2) - y;
    }
    *lost = y;
    *left = y / x;
}