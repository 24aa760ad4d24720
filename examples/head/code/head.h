/* Settings, state and inputs of the head's controller, and what its files share.
 *
 * It is compiled with the C code that `ecm export` writes for a model (name `neck`). No heap, no loop
 * without a fixed bound. docs/head.md derives each part. `compiled.py` has the same fields in order.
 *
 *   NECK_STEPS   the model has effects of time: neck_init and neck_step are there
 *   NO_NECK      no model at all
 */
#ifndef HEAD_H
#define HEAD_H

#include <stdint.h>

#ifndef NO_NECK
#include "neck.h"
#endif

#if defined(__GNUC__)
#define HEAD_API __attribute__((visibility("default"))) /* for callers of the library */
#else
#define HEAD_API
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
    double sum[4];                        /* N: of the integral */
    double history[HISTORY][6];
    int64_t steps;
#ifdef NECK_STEPS
    neck_state memory;
#endif
} state_t;

typedef struct {
    double pose[6], twist[6], acceleration[6]; /* wanted; twist and its rate in base axes */
    double reading[6];                         /* measured pose */
    double forces[4];                          /* measured */
    double known[6];                           /* wrench of the neck that is known otherwise */
    double temperature;                        /* degC */
    double pause;                              /* s since the step before, beyond dt */
    int32_t fresh;                             /* whether there is a new reading */
} inputs_t;

typedef struct {
    double commands[4]; /* N: wanted tendon forces */
    double drive[4];    /* N: what the motion costs the motors */
    int32_t limited;    /* tendons at a limit */
} outputs_t;

/* mechanics.c: rotation vectors, their rates, and small twists from pose to pose */
void cross(const double a[3], const double b[3], double out[3]);
void rotation(const double v[3], double r[9]);
void jacobian(const double v[3], const double w[3], int sign, double out[3]);
void difference(const double to[6], const double from[6], double out[6]);
void moved(double pose[6], const double twist[6], double dt);

/* mechanics.c: linear equations; the head with its tendons, and its neck */
int solve(int n, double *a, double *b, int m);
void tendon_matrix(const settings_t *s, const double pose[6], const double r[9], double a[24]);
void inertia(const settings_t *s, const double r[9], const double spin[3], double m[36],
             double wrench[6]);
HEAD_API void head_neck(const double pose[6], double h[6], double k[36]);

/* controller.c: forces that hold a pose; forces that move the equilibrium; the step of a period */
HEAD_API int32_t head_hold(const settings_t *s, const double pose[6], const double wrench[6],
                           const double k[36], double t[4]);
HEAD_API int32_t head_reach(const settings_t *s, const double pose[6], const double k[36],
                            const double t[4], const double away[6], double f[4]);
HEAD_API int32_t head_state_bytes(void);
HEAD_API void head_init(state_t *x, const double pose[6]);
HEAD_API void head_step(const settings_t *s, state_t *x, const inputs_t *in, outputs_t *out);

#endif
