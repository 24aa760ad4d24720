/* Small systems of linear equations. */
#include <math.h>

#include "head.h"

/* Solves a x = b in place by elimination with pivots; b has m columns, n <= 6. 0 where singular. */
int solve(int n, double *a, double *b, int m) {
    for (int k = 0; k < n; ++k) {
        int p = k;
        for (int i = k + 1; i < n; ++i)
            if (fabs(a[i * n + k]) > fabs(a[p * n + k])) p = i;
        if (!(fabs(a[p * n + k]) > 1e-12)) return 0;
        for (int j = 0; j < n && p != k; ++j) {
            double t = a[p * n + j];
            a[p * n + j] = a[k * n + j];
            a[k * n + j] = t;
        }
        for (int j = 0; j < m && p != k; ++j) {
            double t = b[p * m + j];
            b[p * m + j] = b[k * m + j];
            b[k * m + j] = t;
        }
        for (int i = k + 1; i < n; ++i) {
            double f = a[i * n + k] / a[k * n + k];
            for (int j = k; j < n; ++j) a[i * n + j] -= f * a[k * n + j];
            for (int j = 0; j < m; ++j) b[i * m + j] -= f * b[k * m + j];
        }
    }
    for (int k = n - 1; k >= 0; --k)
        for (int j = 0; j < m; ++j) {
            double t = b[k * m + j];
            for (int i = k + 1; i < n; ++i) t -= a[k * n + i] * b[i * m + j];
            b[k * m + j] = t / a[k * n + k];
        }
    return 1;
}
