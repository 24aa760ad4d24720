/* Rotation vectors: their matrices and rates, and small twists from pose to pose. */
#include <math.h>

#include "head.h"

void cross(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

void rotation(const double v[3], double r[9]) {
    double a2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], a = sqrt(a2), s, c;
    if (a < 1e-4) {
        s = 1.0 - a2 / 6.0;
        c = 0.5 - a2 / 24.0;
    } else {
        s = sin(a) / a;
        c = (1.0 - cos(a)) / a2;
    }
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) r[3 * i + j] = c * v[i] * v[j] + (i == j ? 1.0 - c * a2 : 0.0);
    r[1] -= s * v[2];
    r[2] += s * v[1];
    r[3] += s * v[2];
    r[5] -= s * v[0];
    r[6] -= s * v[1];
    r[7] += s * v[0];
}

/* J(v) w (sign 1) or J(v)^-1 w (sign -1): between rates of the rotation vector and base axes */
void jacobian(const double v[3], const double w[3], int sign, double out[3]) {
    double a2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], a = sqrt(a2), first, second, once[3], twice[3];
    if (a < 1e-3) {
        first = sign > 0 ? 0.5 - a2 / 24.0 : -0.5;
        second = sign > 0 ? 1.0 / 6.0 - a2 / 120.0 : 1.0 / 12.0;
    } else if (sign > 0) {
        first = (1.0 - cos(a)) / a2;
        second = (a - sin(a)) / (a2 * a);
    } else {
        first = -0.5;
        second = 1.0 / a2 - (1.0 + cos(a)) / (2.0 * a * sin(a));
    }
    cross(v, w, once);
    cross(v, once, twice);
    for (int i = 0; i < 3; ++i) out[i] = w[i] + first * once[i] + second * twice[i];
}

/* Small twist that leads from one pose to another */
void difference(const double to[6], const double from[6], double out[6]) {
    double turn[3];
    for (int i = 0; i < 3; ++i) {
        out[i] = to[i] - from[i];
        turn[i] = to[3 + i] - from[3 + i];
    }
    jacobian(from + 3, turn, 1, out + 3);
}

void moved(double pose[6], const double twist[6], double dt) {
    double rate[3];
    jacobian(pose + 3, twist + 3, -1, rate);
    for (int i = 0; i < 3; ++i) {
        pose[i] += dt * twist[i];
        pose[3 + i] += dt * rate[i];
    }
}
