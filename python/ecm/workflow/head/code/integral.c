/* How tendon forces move the equilibrium: what the integral of the error asks for. */
#include <math.h>

#include "head.h"

/* Slope of all static wrenches: K, less what tendons of constant force and the weight change. Both
 * sides take a small twist; the model's K takes a rate of the rotation vector. */
static void static_slope(const settings_t *s, const double pose[6], const double k[36],
                         const double t[4], double slope[36]) {
    double r[9], a[24], c[3], weight[3];
    rotation(pose + 3, r);
    tendon_matrix(s, pose, r, a);
    for (int i = 0; i < 3; ++i) {
        c[i] = 0.0;
        weight[i] = s->mass * s->gravity[i];
        for (int j = 0; j < 3; ++j) c[i] += r[3 * i + j] * s->centre[j];
    }
    for (int d = 0; d < 6; ++d) {
        double shift[3] = {0.0, 0.0, 0.0}, turn[3] = {0.0, 0.0, 0.0}, rate[3], away[3], moment[3];
        (d < 3 ? shift : turn)[d % 3] = 1.0;
        jacobian(pose + 3, turn, -1, rate);
        cross(turn, c, away);
        cross(away, weight, moment);
        for (int i = 0; i < 6; ++i) {
            slope[6 * i + d] = i < 3 ? 0.0 : -moment[i - 3];
            for (int j = 0; j < 3; ++j)
                slope[6 * i + d] += k[6 * i + j] * shift[j] + k[6 * i + 3 + j] * rate[j];
        }
        for (int n = 0; n < 4; ++n) {
            double arm[3], span[3], along[3], change[3], moved_[3], first[3], second[3];
            double size = 0.0, part = 0.0;
            for (int i = 0; i < 3; ++i) {
                arm[i] = 0.0;
                for (int j = 0; j < 3; ++j) arm[i] += r[3 * i + j] * s->anchors[3 * n + j];
                span[i] = s->guides[3 * n + i] - pose[i] - arm[i];
                size += span[i] * span[i];
                along[i] = a[4 * i + n];
            }
            size = sqrt(size);
            cross(turn, arm, moved_);
            for (int i = 0; i < 3; ++i) part += along[i] * (shift[i] + moved_[i]);
            for (int i = 0; i < 3; ++i)
                change[i] = (along[i] * part - shift[i] - moved_[i]) / size;
            cross(moved_, along, first);
            cross(arm, change, second);
            for (int i = 0; i < 3; ++i) {
                slope[6 * i + d] -= t[n] * change[i];
                slope[6 * (3 + i) + d] -= t[n] * (first[i] + second[i]);
            }
        }
    }
}

/* Forces f by which the equilibrium moves nearest to a small twist: least |D (S^-1 A f - away)|^2.
 * 0.1 mm/N bounds what a direction asks for in which forces move the head by less. */
int32_t head_reach(const settings_t *s, const double pose[6], const double k[36], const double t[4],
                   const double away[6], double f[4]) {
    double r[9], slope[36], b[24], q[16];
    rotation(pose + 3, r);
    tendon_matrix(s, pose, r, b);
    static_slope(s, pose, k, t, slope);
    if (!solve(6, slope, b, 4)) return 0;
    for (int i = 0; i < 4; ++i) {
        f[i] = 0.0;
        for (int j = 0; j < 4; ++j) q[4 * i + j] = i == j ? 1e-8 : 0.0;
        for (int l = 0; l < 6; ++l) {
            double weight = l < 3 ? 1.0 : s->length * s->length;
            f[i] += weight * b[4 * l + i] * away[l];
            for (int j = 0; j < 4; ++j) q[4 * i + j] += weight * b[4 * l + i] * b[4 * l + j];
        }
    }
    for (int i = 0; i < 16; ++i) q[i] *= 1e6; /* m to mm, for the tolerance of `solve` */
    for (int i = 0; i < 4; ++i) f[i] *= 1e6;
    return solve(4, q, f, 1);
}
