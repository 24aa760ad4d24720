/* @TITLE@
 *
 * Polynomial of inputs mapped from their ranges to [-1, 1]. No heap, no libm, no branch on
 * the inputs: every call costs the same.
 */
#include "@NAME@.h"

typedef @NAME@_real real;
#define R(x) ((real)(x))

enum { INPUTS = @N@, OUTPUTS = @M@, TERMS = @TERMS@, SLOPES = @SLOPES@ };

static const real centre[INPUTS] = {@CENTRE@};
static const real scale[INPUTS] = {@SCALE@};
/* 1 for a component of the rotation vector */
static const real turns[INPUTS] = {@TURNS@};
static const real half_turn_squared = R(@HALFTURN@);
/* Term t > 0 is term parent_of[t] times input variable_of[t]. */
static const uint16_t parent_of[TERMS] = {@PARENTS@};
static const uint8_t variable_of[TERMS] = {@VARIABLES@};
static const real coefficient[TERMS][OUTPUTS] = {@COEFFICIENTS@};
/* d(term)/d(input) = factor times a lower term */
static const uint16_t slope_term[SLOPES] = {@SLOPETERMS@};
static const uint8_t slope_input[SLOPES] = {@SLOPEINPUTS@};
static const uint16_t slope_lower[SLOPES] = {@SLOPELOWERS@};
static const real slope_factor[SLOPES] = {@SLOPEFACTORS@};

/* 0, or NaN where an input is not finite or the rotation passes half a turn */
static real refused(const real *p)
{
    real none = R(0), turn = R(0);
    for (int32_t i = 0; i < INPUTS; i++) {
        none += p[i] - p[i];
        turn += turns[i] * p[i] * p[i];
    }
    return none + R(0) / (real)(turn <= half_turn_squared);
}

static void terms_at(const real *p, real *m)
{
    real u[INPUTS];
    for (int32_t i = 0; i < INPUTS; i++) {
        u[i] = (p[i] - centre[i]) * scale[i];
    }
    m[0] = R(1);
    for (int32_t t = 1; t < TERMS; t++) {
        m[t] = m[parent_of[t]] * u[variable_of[t]];
    }
}

static void value_of(const real *m, real start, real *h)
{
    for (int32_t j = 0; j < OUTPUTS; j++) {
        h[j] = start;
    }
    for (int32_t t = 0; t < TERMS; t++) {
        for (int32_t j = 0; j < OUTPUTS; j++) {
            h[j] += coefficient[t][j] * m[t];
        }
    }
}

void @NAME@_value(const real p[INPUTS], real h[OUTPUTS])
{
    real m[TERMS];
    terms_at(p, m);
    value_of(m, refused(p), h);
}

void @NAME@_value_and_stiffness(const real p[INPUTS], real h[OUTPUTS], real k[INPUTS * OUTPUTS])
{
    real m[TERMS];
    const real start = refused(p);
    terms_at(p, m);
    value_of(m, start, h);
    for (int32_t e = 0; e < INPUTS * OUTPUTS; e++) {
        k[e] = start;
    }
    for (int32_t e = 0; e < SLOPES; e++) {
        const real slope = slope_factor[e] * m[slope_lower[e]];
        for (int32_t j = 0; j < OUTPUTS; j++) {
            k[INPUTS * j + slope_input[e]] += slope * coefficient[slope_term[e]][j];
        }
    }
}

@WITHIN@
int32_t @NAME@_inside(const real p[INPUTS])
{
    return within(p) & (int32_t)(refused(p) <= R(0));
}
@FREEPOSE@@STEPPER@