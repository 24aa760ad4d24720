/* Rotations, small linear systems, and the head: its tendons, inertia and neck at a pose. */
#include <math.h>
#include <string.h>

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

/* Columns: wrench of one newton in each tendon, base axes about the top frame's origin */
void tendon_matrix(const settings_t *s, const double pose[6], const double r[9], double a[24]) {
    for (int t = 0; t < 4; ++t) {
        double arm[3], span[3], turn[3], size = 0.0;
        for (int i = 0; i < 3; ++i) {
            arm[i] = 0.0;
            for (int j = 0; j < 3; ++j) arm[i] += r[3 * i + j] * s->anchors[3 * t + j];
            span[i] = s->guides[3 * t + i] - pose[i] - arm[i];
            size += span[i] * span[i];
        }
        size = sqrt(size);
        for (int i = 0; i < 3; ++i) span[i] /= size;
        cross(arm, span, turn);
        for (int i = 0; i < 3; ++i) {
            a[4 * i + t] = span[i];
            a[4 * (3 + i) + t] = turn[i];
        }
    }
}

/* Inertia (6 x 6) about the top frame's origin and the wrench of gravity and of spinning */
void inertia(const settings_t *s, const double r[9], const double spin[3], double m[36],
                    double wrench[6]) {
    double c[3], about[9], weight[3], away[3], twice[3], momentum[3], gyro[3], turn[3];
    for (int i = 0; i < 3; ++i) {
        c[i] = 0.0;
        for (int j = 0; j < 3; ++j) c[i] += r[3 * i + j] * s->centre[j];
        weight[i] = s->mass * s->gravity[i];
        for (int j = 0; j < 3; ++j) {
            about[3 * i + j] = 0.0;
            for (int k = 0; k < 3; ++k) about[3 * i + j] += r[3 * i + k] * s->inertia[k] * r[3 * j + k];
        }
    }
    cross(spin, c, away);
    cross(spin, away, twice);
    for (int i = 0; i < 3; ++i) {
        momentum[i] = 0.0;
        for (int j = 0; j < 3; ++j) momentum[i] += about[3 * i + j] * spin[j];
        wrench[i] = weight[i] - s->mass * twice[i];
    }
    cross(spin, momentum, gyro);
    cross(c, wrench, turn);
    for (int i = 0; i < 3; ++i) wrench[3 + i] = turn[i] - gyro[i];
    memset(m, 0, 36 * sizeof(double));
    double c2 = c[0] * c[0] + c[1] * c[1] + c[2] * c[2];
    double skew[9] = {0.0, -c[2], c[1], c[2], 0.0, -c[0], -c[1], c[0], 0.0};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            if (i == j) m[6 * i + j] = s->mass;
            m[6 * i + 3 + j] = -s->mass * skew[3 * i + j];
            m[6 * (3 + i) + j] = s->mass * skew[3 * i + j];
            m[6 * (3 + i) + 3 + j] = about[3 * i + j] + s->mass * ((i == j ? c2 : 0.0) - c[i] * c[j]);
        }
}

/* Wrench and stiffness of the model */
void head_neck(const double pose[6], double h[6], double k[36]) {
#ifdef NO_NECK
    static const double usual[6] = {2e4, 3e3, 3e3, 4.0, 10.0, 10.0};
    (void)pose;
    memset(h, 0, 6 * sizeof(double));
    memset(k, 0, 36 * sizeof(double));
    for (int i = 0; i < 6; ++i) k[7 * i] = usual[i]; /* only the weights of the allocation use it */
#else
    neck_value_and_stiffness(pose, h, k);
#endif
}
