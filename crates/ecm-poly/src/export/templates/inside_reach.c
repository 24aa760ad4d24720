/* Box of the measured poses, and the ellipsoid |factor (x - middle)| <= 1 of their spread. */
static const real inside_low[@N@] = {@LOW@};
static const real inside_high[@N@] = {@HIGH@};
static const real inside_middle[@N@] = {@MIDDLE@};
static const real inside_factor[@TRIANGLE@] = {@FACTOR@};

static int32_t within(const real *x)
{
    real away = R(0);
    int32_t inside = 1;
    for (int32_t i = 0, e = 0; i < @N@; i++) {
        real sum = R(0);
        for (int32_t j = 0; j <= i; j++) {
            sum += inside_factor[e++] * (x[j] - inside_middle[j]);
        }
        away += sum * sum;
        inside &= (int32_t)(x[i] >= inside_low[i]) & (int32_t)(x[i] <= inside_high[i]);
    }
    return inside & (int32_t)(away <= R(1));
}
