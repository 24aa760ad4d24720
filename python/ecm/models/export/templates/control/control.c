/* A control loop that holds the platform at a pose with the model's wrench and stiffness.
 *
 *     e = p_d - p,    S = sum of e dt,    y = w^2 (e + g S) + 2 w (e - e_before) / dt,    g = w / 4
 *     wrench = h(p_d) - M G + M B y + g K(p_d) S,    M = diag(m I, j I),    B = diag(I, J(theta_d))
 *
 * h(p_d) balances the mechanism at the held pose p_d, and -M G the weight of the platform, whose centre
 * of mass is at its origin; G is gravity in base axes. B takes a small change of the pose to a twist:
 * a moment turns the platform about axes in space, not along the rotation vector. w was chosen at the
 * export from the stiffness over the model's poses, the mass and the delay (docs/control.md):
 *
@SUMMARY@
 *
@+ * h(p_d) is what @NAME@_step gives along the held pose: fed forward, it carries what relaxes and slips and
@+ * cannot make the loop unstable. Half-way the controller is stored as bytes and loaded, as by a restart.
@+ *
 * Replace plant_step by your robot: read the pose, command the wrench. Here it is a rigid platform
 * of that mass on a mechanism 20 % softer than the model says and without damping, whose commands
 * come late by the whole delay, pushed for 200 steps.
 *
 *     cc -O2 @NAME@.c @NAME@_control.c && ./a.out     (exits 0 where the pose is held, and says so)
 *     cc -O2 -DQUIET ...                              without stdio
 */
#include "@NAME@.h"
#ifndef QUIET
#include <stdio.h>
#endif

typedef @NAME@_real real;
#define R(x) ((real)(x))

enum { STEPS = @COUNT@, SUBSTEPS = 4, DELAY_STEPS = @DELAY@ };

static const real dt = R(@DT@);               /* s */
static const real mass = R(@MASS@);           /* kg, of the platform and what it carries */
static const real inertia = R(@INERTIA@);     /* kg m^2, about any axis through its origin */
static const real bandwidth = R(@BANDWIDTH@); /* w, rad/s */
static const real gravity[3] = {@GRAVITY@}; /* m/s^2, base axes */
static const real pose_to_hold[6] = {@HELD@};
@+static const real pose_at_rest[6] = {@REST@};

static void cross(const real *a, const real *b, real *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

/* ---- the controller ------------------------------------------------------------------- */

typedef struct {
    real held[6], feed[6], stiffness[36]; /* p_d, h(p_d), K(p_d) */
    real sum[6], before[6];
@+    @NAME@_state state; /* what the mechanism remembers */
} controller_t;

@+/* The wrench at the held pose, seconds later; where it is refused, that of the step before. */
@+static void controller_feed(controller_t *c, real seconds)
@+{
@+    real feed[6], tangent[36];
@+    if (@NAME@_step(&c->state, c->held, seconds, 0, feed, tangent)) {
@+        for (int32_t i = 0; i < 6; i++) {
@+            c->feed[i] = feed[i];
@+        }
@+    }
@+}
@+
static void controller_start(controller_t *c, const real *held)
{
    @NAME@_value_and_stiffness(held, c->feed, c->stiffness);
    for (int32_t i = 0; i < 6; i++) {
        c->held[i] = held[i];
        c->sum[i] = R(0);
        c->before[i] = R(0);
    }
@+    (void)@NAME@_init(&c->state, pose_at_rest);
@+    controller_feed(c, R(0)); /* it has just been moved there from a long rest */
}

/* y = J(theta) x: x + c_2 theta x x + c_3 theta x (theta x x), c_k = 1/k! - theta^2/(k + 2)! + ... */
static void turned(const real *theta, const real *x, real *y)
{
    const real s = theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2];
    real once[3], twice[3], second = R(0), third = R(0);
    for (int32_t j = 11; j >= 0; j--) {
        second = R(1) - second * s / R((2 * j + 3) * (2 * j + 4));
        third = R(1) - third * s / R((2 * j + 4) * (2 * j + 5));
    }
    cross(theta, x, once);
    cross(theta, once, twice);
    for (int32_t i = 0; i < 3; i++) {
        y[i] = x[i] + second / R(2) * once[i] + third / R(6) * twice[i];
    }
}

/* Once a step: pose in, wrench of the robot on the platform out. */
static void controller_step(controller_t *c, const real *pose, real *wrench)
{
    const real w = bandwidth, g = w / R(4);
    real y[6], moment[3];
@+    controller_feed(c, dt);
    for (int32_t i = 0; i < 6; i++) {
        const real e = c->held[i] - pose[i];
        c->sum[i] += e * dt;
        y[i] = w * w * (e + g * c->sum[i]) + R(2) * w / dt * (e - c->before[i]);
        c->before[i] = e;
    }
    turned(c->held + 3, y + 3, moment);
    for (int32_t i = 0; i < 6; i++) {
        wrench[i] = c->feed[i] + (i < 3 ? mass * (y[i] - gravity[i]) : inertia * moment[i - 3]);
        for (int32_t j = 0; j < 6; j++) {
            wrench[i] += g * c->stiffness[6 * i + j] * c->sum[j];
        }
    }
}

@+/* A controller is plain numbers: as bytes it outlives a restart. */
@+static void controller_store(const controller_t *c, uint8_t *bytes)
@+{
@+    const uint8_t *from = (const uint8_t *)c;
@+    for (uint32_t i = 0; i < (uint32_t)sizeof *c; i++) {
@+        bytes[i] = from[i];
@+    }
@+}
@+
@+static void controller_load(controller_t *c, const uint8_t *bytes)
@+{
@+    uint8_t *to = (uint8_t *)c;
@+    for (uint32_t i = 0; i < (uint32_t)sizeof *c; i++) {
@+        to[i] = bytes[i];
@+    }
@+}
@+
/* ---- a plant to try it on --------------------------------------------------------------- */

typedef struct {
    real start[6], moved[6];  /* the pose is their sum: small changes are not rounded away */
    real speed[6];            /* linear and angular velocity in base axes */
    real late[DELAY_STEPS + 1][6]; /* commands on their way, the newest last */
    real softness;            /* stiffness over the model's */
    int32_t delay;            /* steps, at most DELAY_STEPS */
@+    @NAME@_state state;       /* what it remembers itself */
} plant_t;

static void plant_pose(const plant_t *s, real *pose)
{
    for (int32_t i = 0; i < 6; i++) {
        pose[i] = s->start[i] + s->moved[i];
    }
}

static void plant_start(plant_t *s, const controller_t *c, real softness, int32_t delay)
{
    s->softness = softness;
    s->delay = delay;
    for (int32_t i = 0; i < 6; i++) {
        s->start[i] = c->held[i];
        s->moved[i] = R(0);
        s->speed[i] = R(0);
        for (int32_t n = 0; n <= DELAY_STEPS; n++) {
            s->late[n][i] = c->feed[i] - (i < 3 ? mass * gravity[i] : R(0));
        }
    }
@+    s->state = c->state;
}

/* One step: Newton's law in small steps, theta' = J^-1 omega
 * = omega - theta x omega / 2 + g theta x (theta x omega), g = 1/12 + theta^2/720 + ... */
static void plant_step(plant_t *s, const real *wrench, real push)
{
    const real small = dt / R(SUBSTEPS);
    for (int32_t i = 0; i < 6; i++) {
        for (int32_t n = 0; n < DELAY_STEPS; n++) {
            s->late[n][i] = s->late[n + 1][i];
        }
        s->late[DELAY_STEPS][i] = wrench[i];
    }
    for (int32_t n = 0; n < SUBSTEPS; n++) {
@-        real pose[6], h[6], once[3], twice[3];
@+        real pose[6], h[6], k[36], once[3], twice[3];
        plant_pose(s, pose);
@-        @NAME@_value(pose, h);
@+        (void)@NAME@_step(&s->state, pose, small, 0, h, k);
        for (int32_t i = 0; i < 6; i++) {
            const real acting = s->late[DELAY_STEPS - s->delay][i] + (i == 1 ? push : R(0));
            const real force = acting - s->softness * h[i];
            s->speed[i] += small * (i < 3 ? force / mass + gravity[i] : force / inertia);
        }
        const real *theta = pose + 3, *omega = s->speed + 3;
        const real t = theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2];
        const real g =
            R(1.0 / 12) + t * (R(1.0 / 720) + t * (R(1.0 / 30240) + t * R(1.0 / 1209600)));
        cross(theta, omega, once);
        cross(theta, once, twice);
        for (int32_t i = 0; i < 3; i++) {
            s->moved[i] += small * s->speed[i];
            s->moved[3 + i] += small * (omega[i] - R(0.5) * once[i] + g * twice[i]);
        }
    }
}

#ifndef QUIET
static const char *const columns[6] = {@COLUMNS@};
#endif

int main(void)
{
    controller_t controller;
    plant_t plant;
    controller_start(&controller, pose_to_hold);
    plant_start(&plant, &controller, R(0.8), DELAY_STEPS);
    /* Moves a free platform by 1 mm. */
    const real push = R(0.001) * mass * bandwidth * bandwidth;

    real felt = R(0), error = R(0);
    int32_t lost = -1, worst = 0; /* step and column */
@+    static uint8_t stored[sizeof(controller_t)];
@+    int differs = 0;
#ifndef QUIET
@PRINTED@
#endif
    for (int32_t step = 0; step < STEPS && lost < 0; step++) {
        real pose[6], wrench[6];
        plant_pose(&plant, pose);
@+        if (step == STEPS / 2) {
@+            controller_store(&controller, stored);
@+        }
        controller_step(&controller, pose, wrench);
@+        if (step == STEPS / 2) {
@+            real again[6];
@+            controller_load(&controller, stored);
@+            controller_step(&controller, pose, again);
@+            for (int32_t i = 0; i < 6; i++) {
@+                differs |= !(again[i] <= wrench[i] && again[i] >= wrench[i]);
@+            }
@+        }
        plant_step(&plant, wrench, step >= 500 && step < 700 ? push : R(0));
        error = R(0);
        for (int32_t i = 0; i < 6; i++) {
            const real e = plant.moved[i] < R(0) ? -plant.moved[i] : plant.moved[i];
            if (!(e < (i < 3 ? R(0.05) : R(0.5)))) { /* also where it is no number */
                lost = step;
                worst = i;
            } else if (e > error) {
                error = e;
                worst = i;
            }
        }
        felt = step >= 500 && error > felt ? error : felt;
#ifndef QUIET
        if (step % 500 == 499) {
            printf("%5.0f ms: largest error %.3g (%s)\n", 1e3 * (double)dt * (step + 1),
                   (double)error, columns[worst]);
        }
#endif
        if (lost >= 0) {
            break;
        }
    }
@-    const int held = lost < 0 && felt > R(2e-5) && error < R(1e-5);
@+    const int held = lost < 0 && felt > R(2e-5) && error < R(1e-5) && !differs;
#ifdef QUIET
    (void)worst;
#else
    if (lost >= 0) {
        printf("not held: after %.0f ms %s has left the held pose by %.3g. The loop is unstable "
               "here: export again with the mass, inertia and delay of this robot.\n",
               1e3 * (double)dt * (lost + 1), columns[worst], (double)plant.moved[worst]);
@+    } else if (differs) {
@+        printf("not held: the stored controller went on with another wrench.\n");
    } else if (!held) {
        printf("not held: after %.0f ms %s is still %.3g from the held pose (at most 1e-5); the "
               "push moved it by %.3g (at least 2e-5).\n",
               1e3 * (double)dt * STEPS, columns[worst], (double)error, (double)felt);
    } else {
        printf("held: the push moved the platform by %.3g, at the end it is %.3g away (m, rad)\n",
               (double)felt, (double)error);
    }
#endif
    return !held;
}
