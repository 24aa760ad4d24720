/* Six cubics of six inputs by hand: two registers of four doubles a coefficient vector, one pass. */
typedef double v4 __attribute__((vector_size(32)));
typedef struct { v4 low, high; } v8;

static inline v8 fma8(v8 sum, double x, v8 c)
{
    const v4 s = {x, x, x, x};
    return (v8){sum.low + s * c.low, sum.high + s * c.high};
}

/* c: constant, 6 linear, then for i <= j: B_ij, C_ij(k = j ... 5). h: 8 a row. */
void value(long rows, const double *p, const v8 *c, v8 *h)
{
    for (long r = 0; r < rows; r++, p += 6) {
        v8 sum = c[0];
        const v8 *next = c + 7;
#pragma GCC unroll 6
        for (int i = 0; i < 6; i++) {
            v8 slope = c[1 + i];
#pragma GCC unroll 6
            for (int j = i; j < 6; j++) {
                v8 q = *next++;
#pragma GCC unroll 6
                for (int k = j; k < 6; k++) q = fma8(q, p[k], *next++);
                slope = fma8(slope, p[j], q);
            }
            sum = fma8(sum, p[i], slope);
        }
        h[r] = sum;
    }
}

/* k: six columns of 8 a row. */
void value_and_stiffness(long rows, const double *p, const v8 *c, v8 *h, v8 *k)
{
    for (long r = 0; r < rows; r++, p += 6, k += 6) {
        v8 sum = c[0], g[6];
        const v8 *next = c + 7;
        for (int i = 0; i < 6; i++) {
            g[i] = c[1 + i];
            sum = fma8(sum, p[i], c[1 + i]);
        }
#pragma GCC unroll 6
        for (int i = 0; i < 6; i++)
#pragma GCC unroll 6
            for (int j = i; j < 6; j++) {
                const double pair = p[i] * p[j];
                v8 q = *next++;
#pragma GCC unroll 6
                for (int m = j; m < 6; m++) {
                    q = fma8(q, p[m], *next);
                    g[m] = fma8(g[m], pair, *next++);
                }
                sum = fma8(sum, pair, q);
                g[i] = fma8(g[i], p[j], q);
                g[j] = fma8(g[j], p[i], q);
            }
        h[r] = sum;
        for (int i = 0; i < 6; i++) k[i] = g[i];
    }
}
