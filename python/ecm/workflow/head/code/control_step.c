/* One step of the controller: observer, feed-forward, feedback, integral, tendon forces. */
#include <string.h>

#include "head.h"

int32_t head_state_bytes(void) { return (int32_t)sizeof(state_t); }

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
