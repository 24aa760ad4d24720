/* a: polynomial model of an elastic mechanism
 *
 * Polynomial of inputs mapped from their ranges to [-1, 1]. No heap, no libm, no branch on
 * the inputs: every call costs the same.
 */
#include "a.h"

typedef a_real real;
#define R(x) ((real)(x))

enum { INPUTS = 1, OUTPUTS = 1, TERMS = 2, SLOPES = 1 };

static const real centre[INPUTS] = {
    R(0e0)};
static const real scale[INPUTS] = {
    R(1e2)};
/* 1 for a component of the rotation vector */
static const real turns[INPUTS] = {0};
static const real half_turn_squared = R(9.869604401089376e0);
/* Term t > 0 is term parent_of[t] times input variable_of[t]. */
static const uint16_t parent_of[TERMS] = {
    0, 0};
static const uint8_t variable_of[TERMS] = {
    0, 0};
static const real coefficient[TERMS][OUTPUTS] = {
    {
    R(-7.752656836003964e-16)}, {
    R(2.000453997563476e1)}};
/* d(term)/d(input) = factor times a lower term */
static const uint16_t slope_term[SLOPES] = {
    1};
static const uint8_t slope_input[SLOPES] = {
    0};
static const uint16_t slope_lower[SLOPES] = {
    0};
static const real slope_factor[SLOPES] = {
    R(1e2)};

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

void a_value(const real p[INPUTS], real h[OUTPUTS])
{
    real m[TERMS];
    terms_at(p, m);
    value_of(m, refused(p), h);
}

void a_value_and_stiffness(const real p[INPUTS], real h[OUTPUTS], real k[INPUTS * OUTPUTS])
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

/* Box of the measured poses, and the ellipsoid |factor (x - middle)| <= 1 of their spread. */
static const real inside_low[1] = {
    R(-1.01e-2)};
static const real inside_high[1] = {
    R(1.01e-2)};
static const real inside_middle[1] = {
    R(1.6521175961683876e-19)};
static const real inside_factor[1] = {
    R(9.9009900990099e1)};

static int32_t within(const real *x)
{
    real away = R(0);
    int32_t inside = 1;
    for (int32_t i = 0, e = 0; i < 1; i++) {
        real sum = R(0);
        for (int32_t j = 0; j <= i; j++) {
            sum += inside_factor[e++] * (x[j] - inside_middle[j]);
        }
        away += sum * sum;
        inside &= (int32_t)(x[i] >= inside_low[i]) & (int32_t)(x[i] <= inside_high[i]);
    }
    return inside & (int32_t)(away <= R(1));
}

int32_t a_inside(const real p[INPUTS])
{
    return within(p) & (int32_t)(refused(p) <= R(0));
}
