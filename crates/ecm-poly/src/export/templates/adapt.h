/* A model that keeps itself right (docs/adapt.md): @NAMES@.
 *
 * A filter over these parameters, from readings of pose and wrench, which are averaged over an interval;
 * an interval changes the parameters, unless it is beyond five standard deviations. At least two readings
 * belong into an interval: with one, modulus and shares are held.
 * @NAME@_adapt takes the measured pose and wrench, dt seconds after the reading before, with what the
 * model says at that pose: wrench h and K = dh/dp (6 x 6, row by row) of @NAME@_step or
 * @NAME@_value_and_stiffness, and of each relaxing branch its wrench with share 1 (0: none).
 *
 * State: @STATE@ bytes of plain numbers, to be copied, stored and loaded as they are.
 * Reentrant: nothing static is written. Stack: at most @STACK@ bytes (release build for
 * thumbv7em-none-eabihf). No heap, no libm, no errno, no panic. The arrays of one call do not overlap.
 *
 * Link lib@NAME@_adapt.a, which needs Rust @RUST@ or later and nothing else:
 *     cargo build --release --manifest-path @NAME@_adapt/Cargo.toml --target thumbv7em-none-eabihf
 * gives it in @NAME@_adapt/target/thumbv7em-none-eabihf/release; without --target, for this machine, in
 * @NAME@_adapt/target/release.
 */
#ifndef @GUARD@
#define @GUARD@

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef @CREAL@ @NAME@_adapt_real;

/* Places of the parameters in values and covariance. */
enum {
@PLACES@    @NAME@_parameters = @COUNT@
};

/* What a reading did. */
enum {
    @NAME@_waiting = 0,  /* it waits for the end of its interval */
    @NAME@_adapted = 1,  /* the interval changed the parameters */
    @NAME@_left_out = 2, /* the interval was beyond the bound */
    @NAME@_jumped = 3,   /* three such intervals: parameters that may jump are open again */
    @NAME@_diagnose = 4, /* neither drift nor jump of these parameters: everything is held */
    @NAME@_refused = 5   /* a number was not finite, or dt not above 0: nothing happened */
};

typedef struct {
    @NAME@_adapt_real start, sd, low, high; /* sd: at the start, and the largest; 0 holds it */
    @NAME@_adapt_real walk;                 /* standard deviation of its change in an hour */
    @NAME@_adapt_real jumps;                /* 1: it may jump; 0: it only drifts */
} @NAME@_prior;

typedef struct {
    @NAME@_prior priors[@COUNT@];
    @NAME@_adapt_real wrench_sd[2], pose_sd[2];     /* of one reading: N and N m, m and rad */
    @NAME@_adapt_real noise_time_s;                 /* over which noise stays alike */
    @NAME@_adapt_real model_sd[2], reach[2];        /* error of the model, and the way it holds */
    @NAME@_adapt_real model_rim;                    /* error at the rim over that in the middle, >= 1 */
    @NAME@_adapt_real middle[6], per_half_range[6]; /* of the fitted domain; 0: no rim */
    @NAME@_adapt_real gravity[3], interval_s;       /* base axes, m/s^2; s */
} @NAME@_adapt_settings;

/* Sums over half an interval. */
typedef struct {
    @NAME@_adapt_real pose[6], wrench[6], predicted[6], branches[12];
    @NAME@_adapt_real read_s, readings;
} @NAME@_adapt_block;

typedef struct {
    @NAME@_adapt_real values[@COUNT@], covariance[@COUNT@][@COUNT@];
    @NAME@_adapt_block block[2];
    @NAME@_adapt_real time_s, last[6], at_last[3][6]; /* pose that moved, wrenches of model and branches */
    /* error of the model: covariance with the parameters, neighbourhoods of poses, last visits */
    @NAME@_adapt_real cross[@COUNT@][@PARTS@][6], centres[@CELLS@][6];
    uint32_t visits[@CELLS@];
    /* what the last blocks tell of a modulus or share, whatever the others are, and what noise seems to: with at
     * most ten times the second it is held */
    @NAME@_adapt_real excitation[@COUNT@][2];
    /* the same of all parameters together */
    @NAME@_adapt_real information[@COUNT@][@COUNT@], of_noise, window[2];
    uint32_t counts[4], held;
} @NAME@_adapt_state;

/* The library was built for a state of this size. */
typedef char @NAME@_adapt_state_has_its_size[sizeof(@NAME@_adapt_state) == @STATE@ ? 1 : -1];

extern const @NAME@_adapt_settings @NAME@_adapt_defaults;

/* The state at the start, which is also a reset. */
void @NAME@_adapt_init(@NAME@_adapt_state *state, const @NAME@_adapt_settings *settings);
/* Goes on after a diagnosis: values as they are, covariance of the start. */
void @NAME@_adapt_resume(@NAME@_adapt_state *state, const @NAME@_adapt_settings *settings);
int32_t @NAME@_adapt(@NAME@_adapt_state *state, const @NAME@_adapt_settings *settings,
                     const @NAME@_adapt_real p[6], const @NAME@_adapt_real wrench[6],
                     @NAME@_adapt_real dt, const @NAME@_adapt_real h[6],
                     const @NAME@_adapt_real k[36], const @NAME@_adapt_real *branches);
/* The wrench that is expected: of_sensor 1 with the sensor's zero, 0 what the robot feels. */
void @NAME@_adapt_expected(const @NAME@_adapt_state *state, const @NAME@_adapt_settings *settings,
                           const @NAME@_adapt_real p[6], const @NAME@_adapt_real h[6],
                           const @NAME@_adapt_real *branches, int32_t of_sensor,
                           @NAME@_adapt_real wrench[6]);

#ifdef __cplusplus
}
#endif

#endif
