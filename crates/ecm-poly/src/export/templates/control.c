/* A 1 kHz control loop that holds the platform at a pose with the model's wrench and stiffness.
 *
 *     w = h(p_d) + K(p_d) (e + sum(e) dt / T - T_d v),   e = p_d - p
 *
 * h(p_d) balances the mechanism at the held pose p_d; K turns errors of metres and radians into
 * newtons and newton metres, so that three times set the gains of all six axes. Replace plant_step by
 * your robot: read the pose, command the wrench. Here the plant is a rigid platform on a
 * mechanism 5 % softer than the model says, pushed for 0.2 s.
 *
 *     cc -O2 @NAME@.c @NAME@_control.c && ./a.out       (exits 0 where the pose is held)
 *     cc -O2 -DTRACE ...                                prints the error every 100 ms
 */
#include "@NAME@.h"
#ifdef TRACE
#include <stdio.h>
#endif

typedef @NAME@_real real;
#define R(x) ((real)(x))

enum { RATE_HZ = 1000, DURATION_MS = 4000, SUBSTEPS = 10 };

static const @NAME@_real pose_to_hold[6] = {@HELD@};

/* ---- the controller ------------------------------------------------------------------- */

typedef struct {
    real held[6], feed[6], stiffness[36]; /* p_d, h(p_d), K(p_d) */
    real sum[6], last[6];
} controller_t;

static void controller_start(controller_t *c, const real *held)
{
    @NAME@_value_and_stiffness(held, c->feed, c->stiffness);
    for (int32_t i = 0; i < 6; i++) {
        c->held[i] = held[i];
        c->last[i] = held[i];
        c->sum[i] = R(0);
    }
}

/* Once a millisecond: pose in, wrench of the robot on the platform out. */
static void controller_step(controller_t *c, const real *pose, real *wrench)
{
    const real dt = R(1) / R(RATE_HZ), reset_s = R(0.2), damping_s = R(0.02);
    real x[6];
    for (int32_t i = 0; i < 6; i++) {
        const real error = c->held[i] - pose[i], speed = (pose[i] - c->last[i]) / dt;
        c->sum[i] += error * dt;
        c->last[i] = pose[i];
        x[i] = error + c->sum[i] / reset_s - damping_s * speed;
    }
    for (int32_t i = 0; i < 6; i++) {
        wrench[i] = c->feed[i];
        for (int32_t j = 0; j < 6; j++) {
            wrench[i] += c->stiffness[6 * i + j] * x[j];
        }
    }
}

/* ---- a plant to try it on --------------------------------------------------------------- */

typedef struct {
    real pose[6], speed[6]; /* linear and angular velocity in base axes */
    real mass, inertia;
} plant_t;

static real largest(const real *k, int32_t from)
{
    real found = k[7 * from];
    for (int32_t i = from + 1; i < from + 3; i++) {
        found = k[7 * i] > found ? k[7 * i] : found;
    }
    return found;
}

/* theta' = omega - theta x omega / 2 + g theta x (theta x omega), g = 1/12 + a^2/720 + ... */
static void turn(real *theta, const real *omega, real dt)
{
    const real s = theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2];
    const real g = R(1.0 / 12) + s * (R(1.0 / 720) + s * (R(1.0 / 30240) + s * R(1.0 / 1209600)));
    const real a[3] = {theta[1] * omega[2] - theta[2] * omega[1],
                       theta[2] * omega[0] - theta[0] * omega[2],
                       theta[0] * omega[1] - theta[1] * omega[0]};
    const real b[3] = {theta[1] * a[2] - theta[2] * a[1], theta[2] * a[0] - theta[0] * a[2],
                       theta[0] * a[1] - theta[1] * a[0]};
    for (int32_t i = 0; i < 3; i++) {
        theta[i] += dt * (omega[i] - R(0.5) * a[i] + g * b[i]);
    }
}

static void plant_step(plant_t *s, const real *wrench, real dt)
{
    real h[6];
    @NAME@_value(s->pose, h);
    for (int32_t i = 0; i < 6; i++) {
        s->speed[i] += dt * (wrench[i] - R(0.95) * h[i]) / (i < 3 ? s->mass : s->inertia);
    }
    for (int32_t i = 0; i < 3; i++) {
        s->pose[i] += dt * s->speed[i];
    }
    turn(s->pose + 3, s->speed + 3, dt);
}

int main(void)
{
    const real *held = pose_to_hold;
    controller_t controller;
    plant_t plant;
    controller_start(&controller, held);
    for (int32_t i = 0; i < 6; i++) {
        plant.pose[i] = held[i];
        plant.speed[i] = R(0);
    }
    /* A platform whose own frequency with the mechanism is 150 rad/s. */
    plant.mass = largest(controller.stiffness, 0) / R(150 * 150);
    plant.inertia = largest(controller.stiffness, 3) / R(150 * 150);
    const real push = R(0.0002) * largest(controller.stiffness, 0);

    real worst = R(0), error = R(0);
    int lost = 0; /* also where the pose is no number */
    for (int32_t ms = 0; ms < DURATION_MS; ms++) {
        real wrench[6];
        controller_step(&controller, plant.pose, wrench);
        if (ms >= 500 && ms < 700) {
            wrench[1] += push;
        }
        for (int32_t n = 0; n < SUBSTEPS; n++) {
            plant_step(&plant, wrench, R(1) / R(RATE_HZ * SUBSTEPS));
        }
        error = R(0);
        for (int32_t i = 0; i < 6; i++) {
            const real e =
                plant.pose[i] > held[i] ? plant.pose[i] - held[i] : held[i] - plant.pose[i];
            error = e <= error ? error : e;
            lost += !(e < R(0.05));
        }
        worst = error <= worst ? worst : error;
#ifdef TRACE
        if (ms % 100 == 99) {
            printf("%4d ms: largest error %.3g (m, rad)\n", (int)(ms + 1), (double)error);
        }
#endif
    }
    /* The push was felt, and the pose is held again. */
    return !(lost == 0 && worst > R(1e-4) && error < R(1e-5));
}
