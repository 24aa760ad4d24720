/* Observer: what a reading of the pose corrects. */
#include <string.h>

#include "head.h"

/* A reading is late: its correction begins then and is carried to now by the linear motion */
void correct(const settings_t *s, state_t *x, const double reading[6]) {
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
