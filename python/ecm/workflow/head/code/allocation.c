/* Static inverse: tendon forces, within their limits, that hold a pose best. */
#include <math.h>
#include <string.h>

#include "head.h"

/* Least t'q t / 2 - c't within [low, high]^4, q positive definite: of the 81 ways in which forces may
 * be at a limit, the one whose multipliers have the right sign; the first has none at a limit. */
static int32_t allocate(const double q[16], const double c[4], double low, double high, double t[4]) {
    for (int32_t way = 0; way < 81; ++way) {
        int kind[4], free_[4], n = 0, good = 1;
        for (int i = 0, w = way; i < 4; ++i, w /= 3) {
            kind[i] = w % 3;
            t[i] = kind[i] == 1 ? low : high;
            if (kind[i] == 0) free_[n++] = i;
        }
        double a[16], b[4];
        for (int i = 0; i < n; ++i) {
            b[i] = c[free_[i]];
            for (int j = 0; j < 4; ++j)
                if (kind[j]) b[i] -= q[4 * free_[i] + j] * t[j];
            for (int j = 0; j < n; ++j) a[n * i + j] = q[4 * free_[i] + free_[j]];
        }
        if (n && !solve(n, a, b, 1)) continue;
        for (int i = 0; i < n; ++i) {
            t[free_[i]] = b[i];
            good &= b[i] >= low - 1e-9 && b[i] <= high + 1e-9;
        }
        for (int i = 0; i < 4 && good; ++i) {
            if (!kind[i]) continue;
            double slope = -c[i];
            for (int j = 0; j < 4; ++j) slope += q[4 * i + j] * t[j];
            good &= kind[i] == 1 ? slope >= -1e-9 : slope <= 1e-9;
        }
        if (good) return 4 - n;
    }
    for (int i = 0; i < 4; ++i) t[i] = low; /* not reached: such a way exists for finite numbers */
    return 4;
}

/* The convex problem: least |D K^-1 (A t - wrench)|^2 + small |t - preferred|^2 within the limits,
 * the pose error that the forces leave, with a radian counted as a length. */
int32_t head_hold(const settings_t *s, const double pose[6], const double wrench[6], const double k[36],
                  double t[4]) {
    double r[9], a[24], lu[36], b[30], q[16], c[4];
    rotation(pose + 3, r);
    tendon_matrix(s, pose, r, a);
    for (int i = 0; i < 6; ++i) {
        for (int j = 0; j < 4; ++j) b[5 * i + j] = a[4 * i + j];
        b[5 * i + 4] = wrench[i];
    }
    /* K takes rates of the rotation vector; for a small error at these angles that is near enough */
    memcpy(lu, k, sizeof lu);
    if (!solve(6, lu, b, 5)) return -1;
    for (int i = 3; i < 6; ++i)
        for (int j = 0; j < 5; ++j) b[5 * i + j] *= s->length;
    for (int i = 0; i < 4; ++i) {
        c[i] = 1e-12 * s->preferred;
        for (int j = 0; j < 4; ++j) {
            q[4 * i + j] = i == j ? 1e-12 : 0.0;
            for (int l = 0; l < 6; ++l) q[4 * i + j] += b[5 * l + i] * b[5 * l + j];
        }
        for (int l = 0; l < 6; ++l) c[i] += b[5 * l + i] * b[5 * l + 4];
    }
    double scale = 0.0; /* to numbers near 1, for the tolerances of `allocate` */
    for (int i = 0; i < 4; ++i) scale += q[5 * i];
    for (int i = 0; i < 16; ++i) q[i] *= 4.0 / scale;
    for (int i = 0; i < 4; ++i) c[i] *= 4.0 / scale;
    return allocate(q, c, s->least, s->most, t);
}
