/* v = (c_x, |c_perp|^2, |theta_perp|^2, theta_x, a, b) and its chain rule */
static void variables(const real *q, real *v)
{
    v[0] = q[0];
    v[1] = q[1] * q[1] + q[2] * q[2];
    v[2] = q[4] * q[4] + q[5] * q[5];
    v[3] = q[3];
    v[4] = q[1] * q[4] + q[2] * q[5];
    v[5] = q[1] * q[5] - q[2] * q[4];
}

static void gradient(const real *q, const real *u, real *g)
{
    g[0] = u[0];
    g[1] = R(2) * u[1] * q[1] + u[4] * q[4] + u[5] * q[5];
    g[2] = R(2) * u[1] * q[2] + u[4] * q[5] - u[5] * q[4];
    g[3] = u[3];
    g[4] = R(2) * u[2] * q[4] + u[4] * q[1] - u[5] * q[2];
    g[5] = R(2) * u[2] * q[5] + u[4] * q[2] + u[5] * q[1];
}

static void curvature(const real *q, const real *u, const real *bend, real *h)
{
    real half[36], column[6], chained[6];
    for (int32_t i = 0; i < 6; i++) {
        gradient(q, bend + 6 * i, half + 6 * i);
    }
    for (int32_t j = 0; j < 6; j++) {
        for (int32_t i = 0; i < 6; i++) {
            column[i] = half[6 * i + j];
        }
        gradient(q, column, chained);
        for (int32_t i = 0; i < 6; i++) {
            h[6 * i + j] = chained[i];
        }
    }
    h[7] += R(2) * u[1];
    h[14] += R(2) * u[1];
    h[28] += R(2) * u[2];
    h[35] += R(2) * u[2];
    h[10] += u[4];
    h[25] += u[4];
    h[17] += u[4];
    h[32] += u[4];
    h[11] += u[5];
    h[31] += u[5];
    h[16] -= u[5];
    h[26] -= u[5];
}
