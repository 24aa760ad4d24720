/* One step of the head's controller: observer, feed-forward, feedback, tendon forces.
 *
 * It is compiled with the C code that `ecm export` writes for a model (name `neck`), and called once
 * per period. No heap, no loop without a fixed bound. docs/head.md derives each part.
 *
 *   NECK_STEPS   the model has effects of time: neck_init and neck_step are there
 *   NO_NECK      no model at all
 */
#include <math.h>
#include <stdint.h>
#include <string.h>

#ifndef NO_NECK
#include "neck.h"
#endif

#define HISTORY 256

typedef struct {
    double dt, mass, centre[3], inertia[3], gravity[3];
    double guides[12], anchors[12];
    double least, most, preferred;     /* N */
    double bandwidth, compensation;    /* rad/s, share */
    double integral;                   /* 1/s: in the directions that forces reach; 0: none */
    double gain[108], carry[324];      /* observer: 18 x 6 per reading, 18 x 18 per step */
    double length;                     /* m: what a radian counts */
    double damping, speed_share;       /* N s/m of a motor; share of the head's own speed in `drive` */
    int32_t delay_steps, feedback;
} settings_t;

typedef struct {
    double pose[6], twist[6], unknown[6]; /* estimates; unknown: wrench on the head, N and N m */
    double forces[4];                     /* last commands */
    double sum[4];                        /* N: of the integral */
    double drive[4];                      /* N: what the motion costs the motors */
    double history[HISTORY][6];
    int64_t steps;
    int32_t limited;                      /* tendons at a limit in the last step */
    int32_t reserved;
    double wrench[6];                     /* of the model at the estimate */
#ifdef NECK_STEPS
    neck_state memory;
#else
    double memory[1];
#endif
} state_t;

typedef struct {
    double pose[6], twist[6], acceleration[6]; /* wanted; twist and its rate in base axes */
    double reading[6];                         /* measured pose */
    double forces[4];                          /* measured */
    double known[6];                           /* wrench of the neck that is known otherwise */
    double factor;                             /* on the model's wrench */
    double temperature;                        /* degC */
    double pause;                              /* s since the step before, beyond dt */
    int32_t fresh, reserved;                   /* whether there is a new reading */
} inputs_t;

int32_t head_state_bytes(void) { return (int32_t)sizeof(state_t); }

/* --- rotations ------------------------------------------------------------------------------- */

static void cross(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static void rotation(const double v[3], double r[9]) {
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
static void jacobian(const double v[3], const double w[3], int sign, double out[3]) {
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
static void difference(const double to[6], const double from[6], double out[6]) {
    double turn[3];
    for (int i = 0; i < 3; ++i) {
        out[i] = to[i] - from[i];
        turn[i] = to[3 + i] - from[3 + i];
    }
    jacobian(from + 3, turn, 1, out + 3);
}

static void moved(double pose[6], const double twist[6], double dt) {
    double rate[3];
    jacobian(pose + 3, twist + 3, -1, rate);
    for (int i = 0; i < 3; ++i) {
        pose[i] += dt * twist[i];
        pose[3 + i] += dt * rate[i];
    }
}

/* --- linear equations ------------------------------------------------------------------------ */

/* Solves a x = b in place by elimination with pivots; b has m columns, n <= 6. 0 where singular. */
static int solve(int n, double *a, double *b, int m) {
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

/* --- the head -------------------------------------------------------------------------------- */

/* Columns: wrench of one newton in each tendon, base axes about the top frame's origin */
static void tendon_matrix(const settings_t *s, const double pose[6], const double r[9], double a[24]) {
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
static void inertia(const settings_t *s, const double r[9], const double spin[3], double m[36],
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

/* --- allocation ------------------------------------------------------------------------------ */

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

/* --- observer -------------------------------------------------------------------------------- */

/* A reading is late: its correction begins then and is carried to now by the linear motion */
static void correct(const settings_t *s, state_t *x, const double reading[6]) {
    double error[6], now[18], next[18];
    int64_t then = x->steps - s->delay_steps;
    if (then < 0) then = 0;
    difference(reading, x->history[then % HISTORY], error);
    for (int i = 0; i < 18; ++i) {
        now[i] = 0.0;
        for (int j = 0; j < 6; ++j) now[i] += s->gain[6 * i + j] * error[j];
    }
    for (int64_t step = then;; ++step) {
        moved(x->history[step % HISTORY], now, 1.0);
        if (step == x->steps) break;
        for (int i = 0; i < 18; ++i) {
            next[i] = 0.0;
            for (int j = 0; j < 18; ++j) next[i] += s->carry[18 * i + j] * now[j];
        }
        memcpy(now, next, sizeof now);
    }
    memcpy(x->pose, x->history[x->steps % HISTORY], 6 * sizeof(double));
    for (int i = 0; i < 6; ++i) {
        x->twist[i] += now[6 + i];
        x->unknown[i] += now[12 + i];
    }
}

/* --- one step -------------------------------------------------------------------------------- */

void head_init(state_t *x, const double pose[6]) {
    memset(x, 0, sizeof *x);
    memcpy(x->pose, pose, 6 * sizeof(double));
    for (int i = 0; i < HISTORY; ++i) memcpy(x->history[i], pose, 6 * sizeof(double));
#ifdef NECK_STEPS
    neck_init(&x->memory, pose);
#endif
}

void head_step(const settings_t *s, state_t *x, const inputs_t *in, double commands[4]) {
    double h[6], k[36], there[6], stiff[36], carried[6], r[9], m[36], outside[6], a[24], net[6];
    /* What the neck remembers, along the estimated motion */
    head_neck(x->pose, h, k);
    memcpy(carried, in->known, sizeof carried);
#ifdef NECK_STEPS
    double with[6];
    neck_conditions air = neck_default_conditions;
    air.temperature_degC = in->temperature;
    if (neck_step(&x->memory, x->pose, s->dt + in->pause, &air, with, k))
        for (int i = 0; i < 6; ++i) carried[i] += with[i] - in->factor * h[i];
#endif
    for (int i = 0; i < 6; ++i) x->wrench[i] = h[i] = in->factor * h[i] + carried[i];

    /* Observer: the head moves as model, tendons and gravity say; readings correct it */
    rotation(x->pose + 3, r);
    tendon_matrix(s, x->pose, r, a);
    inertia(s, r, x->twist + 3, m, outside);
    for (int i = 0; i < 6; ++i) {
        net[i] = x->unknown[i];
#ifndef NO_NECK /* without a model nothing is known of what moves the head */
        net[i] += outside[i] - h[i];
        for (int j = 0; j < 4; ++j) net[i] += a[4 * i + j] * in->forces[j];
#endif
    }
    solve(6, m, net, 1);
    for (int i = 0; i < 6; ++i) x->twist[i] += s->dt * net[i];
    moved(x->pose, x->twist, s->dt);
    x->steps += 1;
    memcpy(x->history[x->steps % HISTORY], x->pose, 6 * sizeof(double));
    if (in->fresh) correct(s, x, in->reading);

    /* Feed-forward: what holds and moves the head at the wanted pose */
    double need[6], spin[6];
    head_neck(in->pose, there, stiff);
    rotation(in->pose + 3, r);
    inertia(s, r, in->twist + 3, m, spin);
    for (int i = 0; i < 6; ++i) {
        need[i] = in->factor * there[i] + carried[i] - spin[i] - s->compensation * x->unknown[i];
        for (int j = 0; j < 6; ++j) need[i] += m[6 * i + j] * in->acceleration[j];
    }
    x->limited = head_hold(s, in->pose, need, stiff, commands);

    /* Motors: their damping at the speed of the tendons, so that the force loop need not wait for an
     * error of force. A soft neck makes it slow: a newton more is millimetres of tendon. */
    tendon_matrix(s, in->pose, r, a);
    for (int i = 0; i < 4; ++i) {
        double speed = 0.0;
        for (int l = 0; l < 6; ++l) 
            speed += a[4 * l + i] * (in->twist[l] + s->speed_share * (x->twist[l] - in->twist[l]));
        x->drive[i] = s->damping * speed;
    }

    /* Feedback along the tendons: their inertia L = (A' M^-1 A)^-1 gives all the same bandwidth */
    if (s->feedback) {
        double away[6], wide[24], q[16], b[8], w = s->bandwidth;
        difference(in->pose, x->pose, away);
        memcpy(wide, a, sizeof a);
        solve(6, m, wide, 4);
        for (int i = 0; i < 4; ++i) {
            b[i] = 0.0;
            for (int l = 0; l < 6; ++l)
                b[i] += a[4 * l + i] * (w * w * away[l] + 2.0 * w * (in->twist[l] - x->twist[l]));
            for (int j = 0; j < 4; ++j) {
                q[4 * i + j] = i == j ? 0.02 : 0.0; /* 1/kg: bounds what a weak direction asks for */
                for (int l = 0; l < 6; ++l) q[4 * i + j] += a[4 * l + i] * wide[4 * l + j];
            }
        }
        if (solve(4, q, b, 1))
            for (int i = 0; i < 4; ++i) commands[i] += b[i];
    }
    for (int i = 0; i < 4; ++i) {
        commands[i] += x->sum[i];
        double wanted = commands[i];
        commands[i] = wanted < s->least ? s->least : wanted > s->most ? s->most : wanted;
        if (!(wanted == commands[i])) x->limited += x->limited < 4;
        x->forces[i] = commands[i];
    }

    /* Integral of the error that the forces can take away; a tendon at its limit waits */
    if (s->integral > 0.0) {
        double away[6], more[4];
        difference(in->pose, x->pose, away);
        if (head_reach(s, in->pose, stiff, commands, away, more))
            for (int i = 0; i < 4; ++i)
                if ((commands[i] > s->least || more[i] > 0.0) && (commands[i] < s->most || more[i] < 0.0))
                    x->sum[i] += s->dt * s->integral * more[i];
    }
}
