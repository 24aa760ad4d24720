/* The head: what its tendons, its inertia and its neck do at a pose. */
#include <math.h>
#include <string.h>

#include "head.h"

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
