static const real lower[INPUTS] = {@LOWER@};
static const real upper[INPUTS] = {@UPPER@};

static int32_t within(const real *p)
{
    int32_t inside = 1;
    for (int32_t i = 0; i < INPUTS; i++) {
        inside &= (int32_t)(p[i] >= lower[i]) & (int32_t)(p[i] <= upper[i]);
    }
    return inside;
}
