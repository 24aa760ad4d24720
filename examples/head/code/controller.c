/* The controller: static inverse, integral, observer, and the step that joins them. */
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

int32_t head_state_bytes(void) { return (int32_t)sizeof(state_t); }

void head_init(state_t *x, const double pose[6]) {
    memset(x, 0, sizeof *x);
    memcpy(x->pose, pose, 6 * sizeof(double));
    for (int i = 0; i < HISTORY; ++i) memcpy(x->history[i], pose, 6 * sizeof(double));
#ifdef NECK_STEPS
    neck_init(&x->memory, pose);
#endif
}

void head_step(const settings_t *s, state_t *x, const inputs_t *in, outputs_t *out) {
    double *commands = out->commands;
    double h[6], k[36], there[6], stiff[36], carried[6], r[9], m[36], outside[6], a[24], net[6];
    /* What the neck remembers, along the estimated motion */
    head_neck(x->pose, h, k);
    memcpy(carried, in->known, sizeof carried);
#ifdef NECK_STEPS
    double with[6];
    neck_conditions air = neck_default_conditions;
    air.temperature_degC = in->temperature;
    if (neck_step(&x->memory, x->pose, s->dt + in->pause, &air, with, k))
        for (int i = 0; i < 6; ++i) carried[i] += with[i] - h[i];
#endif
    for (int i = 0; i < 6; ++i) h[i] += carried[i];

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
        need[i] = there[i] + carried[i] - spin[i] - s->compensation * x->unknown[i];
        for (int j = 0; j < 6; ++j) need[i] += m[6 * i + j] * in->acceleration[j];
    }
    out->limited = head_hold(s, in->pose, need, stiff, commands);

    /* Motors: their damping at the speed of the tendons, so that the force loop need not wait for an
     * error of force. A soft neck makes it slow: a newton more is millimetres of tendon. */
    tendon_matrix(s, in->pose, r, a);
    for (int i = 0; i < 4; ++i) {
        double speed = 0.0;
        for (int l = 0; l < 6; ++l)
            speed += a[4 * l + i] * (in->twist[l] + s->speed_share * (x->twist[l] - in->twist[l]));
        out->drive[i] = s->damping * speed;
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
        if (!(wanted == commands[i])) out->limited += out->limited < 4;
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
