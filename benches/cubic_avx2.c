/* Six cubics of six inputs by hand: two registers of four doubles a coefficient vector, one pass;
   then the same in single precision, one register of eight. */
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

typedef float f8 __attribute__((vector_size(32)));

static inline f8 fma8f(f8 sum, float x, f8 c)
{
    const f8 s = {x, x, x, x, x, x, x, x};
    return sum + s * c;
}

void value_and_stiffness_single(long rows, const float *p, const f8 *c, f8 *h, f8 *k)
{
    for (long r = 0; r < rows; r++, p += 6, k += 6) {
        f8 sum = c[0], g[6];
        const f8 *next = c + 7;
        for (int i = 0; i < 6; i++) {
            g[i] = c[1 + i];
            sum = fma8f(sum, p[i], c[1 + i]);
        }
#pragma GCC unroll 6
        for (int i = 0; i < 6; i++)
#pragma GCC unroll 6
            for (int j = i; j < 6; j++) {
                const float pair = p[i] * p[j];
                f8 q = *next++;
#pragma GCC unroll 6
                for (int m = j; m < 6; m++) {
                    q = fma8f(q, p[m], *next);
                    g[m] = fma8f(g[m], pair, *next++);
                }
                sum = fma8f(sum, pair, q);
                g[i] = fma8f(g[i], p[j], q);
                g[j] = fma8f(g[j], p[i], q);
            }
        h[r] = sum;
        for (int i = 0; i < 6; i++) k[i] = g[i];
    }
}
