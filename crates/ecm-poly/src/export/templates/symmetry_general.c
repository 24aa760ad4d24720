/* The variables are q = (c, theta), and the inputs of actuators, themselves. */
static void variables(const real *q, real *v)
{
    for (int32_t i = 0; i < INPUTS; i++) {
        v[i] = q[i];
    }
}

static void gradient(const real *q, const real *u, real *g)
{
    (void)q;
    for (int32_t i = 0; i < 6; i++) {
        g[i] = u[i];
    }
}

static void curvature(const real *q, const real *u, const real *bend, real *h)
{
    (void)q;
    (void)u;
    for (int32_t i = 0; i < 36; i++) {
        h[i] = bend[i];
    }
}
