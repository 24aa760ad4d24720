/* @TITLE@
 *
 * Energy U(q) in mid-frame coordinates; wrench h = (f, tau) at the top frame's origin in
 * base axes, K = dh/dp. No heap, no libm, no branch on the pose: every call costs the same.
 * Sines and cosines enter only through entire series in |theta|^2, |theta| < pi.
 */
#include "@NAME@.h"

typedef @NAME@_real real;
#define R(x) ((real)(x))

enum { INPUTS = @N@, MONOMIALS = @MONOMIALS@, OFSLOPES = @OFSLOPES@, SERIES = @SERIES@ };

static const real length_m = R(@LENGTH@);
static const real half_turn_squared = R(@HALFTURN@);
static const uint16_t parent_of[MONOMIALS] = {@PARENTS@};
static const uint8_t variable_of[MONOMIALS] = {@VARIABLES@};
static const uint16_t row_end[@ROWS@] = {@ENDS@};
static const uint16_t column_of[@ENTRIES@] = {@COLUMNS@};
static const real weight_of[@ENTRIES@] = {@WEIGHTS@};
/* 1/(2j + k)! of the functions c_6 and c_7; 1/k! of c_0 ... c_5. */
static const real series_6[SERIES] = {@SERIES6@};
static const real series_7[SERIES] = {@SERIES7@};
static const real start_of[6] = {R(1), R(1), R(1) / R(2), R(1) / R(6), R(1) / R(24), R(1) / R(120)};

typedef struct {
    real r[3], theta[3];
    real whole[8], half[8];
    real a[9];       /* base from mid frame */
    real w[9];       /* J(theta/2)/2 */
    real inverse[9]; /* J(theta)^-1 */
    real q[INPUTS];  /* mid-frame coordinates, then the inputs of actuators */
    real refused;    /* 0, or NaN where p is not finite or |theta| > pi */
} frame_t;

static real dot(const real *a, const real *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const real *a, const real *b, real *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static void skew(const real *a, real *m)
{
    m[0] = R(0);
    m[1] = -a[2];
    m[2] = a[1];
    m[3] = a[2];
    m[4] = R(0);
    m[5] = -a[0];
    m[6] = -a[1];
    m[7] = a[0];
    m[8] = R(0);
}

/* c = A b and c = A' b */
static void apply(const real *m, const real *b, real *c)
{
    for (int32_t i = 0; i < 3; i++) {
        c[i] = m[3 * i] * b[0] + m[3 * i + 1] * b[1] + m[3 * i + 2] * b[2];
    }
}

static void apply_transposed(const real *m, const real *b, real *c)
{
    for (int32_t i = 0; i < 3; i++) {
        c[i] = m[i] * b[0] + m[3 + i] * b[1] + m[6 + i] * b[2];
    }
}

/* C = A B and C = A' B */
static void product(const real *a, const real *b, real *c)
{
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
        }
    }
}

static void transposed_product(const real *a, const real *b, real *c)
{
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            c[3 * i + j] = a[i] * b[j] + a[3 + i] * b[3 + j] + a[6 + i] * b[6 + j];
        }
    }
}

/* c_k(s) = sum_j (-s)^j / (2j + k)!, k = 0 ... 7 */
static void stumpff(real s, real *c)
{
    real six = R(0), seven = R(0);
    for (int32_t j = SERIES - 1; j >= 0; j--) {
        six = series_6[j] - s * six;
        seven = series_7[j] - s * seven;
    }
    c[6] = six;
    c[7] = seven;
    for (int32_t k = 5; k >= 0; k--) {
        c[k] = start_of[k] - s * c[k + 2];
    }
}

static real first(const real *c, int32_t k) { return R(0.5) * (R(k) * c[k + 2] - c[k + 1]); }

static real second(const real *c, int32_t k)
{
    return R(0.5) * (R(k) * first(c, k + 2) - first(c, k + 1));
}

/* x I + y [t]x + z t t' */
static void with_parts(const real *t, real x, real y, real z, real *m)
{
    skew(t, m);
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            m[3 * i + j] = y * m[3 * i + j] + z * t[i] * t[j] + (i == j ? x : R(0));
        }
    }
}

static void prepare(const real *p, frame_t *f)
{
    real h[3], c[3], g;
    f->refused = R(0) / (real)(dot(p + 3, p + 3) <= half_turn_squared);
    for (int32_t i = 0; i < 3; i++) {
        f->refused += p[i] - p[i];
        f->r[i] = p[i];
        f->theta[i] = p[3 + i];
        h[i] = R(0.5) * p[3 + i];
    }
    stumpff(dot(f->theta, f->theta), f->whole);
    stumpff(dot(h, h), f->half);
    with_parts(h, f->half[0], f->half[1], f->half[2], f->a);
    with_parts(h, R(0.5) * f->half[1], R(0.5) * f->half[2], R(0.5) * f->half[3], f->w);
    g = (f->whole[3] - R(2) * f->whole[4]) / (R(2) * f->whole[2]);
    with_parts(f->theta, R(1) - dot(f->theta, f->theta) * g, R(-0.5), g, f->inverse);
    apply_transposed(f->a, f->r, c);
    for (int32_t i = 0; i < 3; i++) {
        f->q[i] = c[i];
        f->q[3 + i] = f->theta[i];
    }
    f->q[0] = c[0] - length_m;
    for (int32_t i = 6; i < INPUTS; i++) {
        f->q[i] = p[i];
        f->refused += p[i] - p[i];
    }
}

@SYMMETRY@

/* All monomials of U, or the first ones, which its slopes and curvatures need */
static void monomials_at(const real *q, int32_t count, real *m)
{
    real v[INPUTS];
    variables(q, v);
    m[0] = R(1);
    for (int32_t t = 0; t < count; t++) {
        m[t + 1] = m[parent_of[t]] * v[variable_of[t]];
    }
}

static real row(int32_t i, const real *m)
{
    const int32_t end = row_end[i];
    int32_t e = i > 0 ? row_end[i - 1] : 0;
    real a = R(0), b = R(0), c = R(0), d = R(0); /* additions need not wait for each other */
    for (; e + 3 < end; e += 4) {
        a += weight_of[e] * m[column_of[e]];
        b += weight_of[e + 1] * m[column_of[e + 1]];
        c += weight_of[e + 2] * m[column_of[e + 2]];
        d += weight_of[e + 3] * m[column_of[e + 3]];
    }
    for (; e < end; e++) {
        a += weight_of[e] * m[column_of[e]];
    }
    return (a + b) + (c + d);
}

/* h from Q = dU/dq: f = A Q_c, tau = J^-T (Q_theta - W' (r x f)) */
static void wrench_of(const frame_t *f, const real *force, real *h)
{
    real lever[3], turned[3], angular[3];
    apply(f->a, force, h);
    cross(f->r, h, lever);
    apply_transposed(f->w, lever, turned);
    for (int32_t i = 0; i < 3; i++) {
        angular[i] = force[3 + i] - turned[i];
    }
    apply_transposed(f->inverse, angular, h + 3);
}

/* Hessian in phi of Q_c . R(phi)' r */
static void form_hessian(const frame_t *f, const real *a, real *hessian)
{
    real phi[3], n[3], m[3], turning[3];
    const real *b = f->r, *c = f->half;
    for (int32_t i = 0; i < 3; i++) {
        phi[i] = R(0.5) * f->theta[i];
    }
    cross(a, b, n);
    const real ab = dot(a, b), bp = dot(b, phi), ap = dot(a, phi);
    for (int32_t i = 0; i < 3; i++) {
        m[i] = R(0.5) * (bp * a[i] + ap * b[i]) - ab * phi[i];
    }
    const real linear = dot(phi, n), quadratic = dot(phi, m);
    const real slope = first(c, 1) * linear + first(c, 2) * quadratic;
    const real curvature = R(4) * (second(c, 1) * linear + second(c, 2) * quadratic);
    for (int32_t i = 0; i < 3; i++) {
        turning[i] = R(2) * first(c, 1) * n[i] + R(4) * first(c, 2) * m[i];
    }
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            hessian[3 * i + j] = phi[i] * turning[j] + phi[j] * turning[i] +
                                 c[2] * (a[i] * b[j] + a[j] * b[i]) + curvature * phi[i] * phi[j] +
                                 (i == j ? R(2) * slope - R(2) * c[2] * ab : R(0));
        }
    }
}

/* D = d(J' tau)/dtheta at constant tau */
static void torque_derivative(const frame_t *f, const real *tau, real *d)
{
    real across[3], column[3], s = dot(f->theta, f->theta);
    const real *t = f->theta, *c = f->whole;
    const real along = dot(t, tau);
    cross(t, tau, across);
    for (int32_t i = 0; i < 3; i++) {
        column[i] = R(-2) * first(c, 2) * across[i] +
                    R(2) * first(c, 3) * (along * t[i] - s * tau[i]) - R(2) * c[3] * tau[i];
    }
    skew(tau, d);
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            d[3 * i + j] = c[2] * d[3 * i + j] + column[i] * t[j] + c[3] * t[i] * tau[j] +
                           (i == j ? c[3] * along : R(0));
        }
    }
}

/* Q = dU/dq and dQ/dq */
static void forces_at(const real *q, const real *m, real *force, real *u)
{
    real slope[6], bend[36];
    for (int32_t i = 0; i < 6; i++) {
        slope[i] = row(1 + i, m);
    }
    for (int32_t i = 0, next = 7; i < 6; i++) {
        for (int32_t j = i; j < 6; j++) {
            bend[6 * i + j] = row(next++, m);
            bend[6 * j + i] = bend[6 * i + j];
        }
    }
    gradient(q, slope, force);
    curvature(q, slope, bend, u);
}

/* h of the six sums from row i, the slopes of an energy */
static void wrench_at(int32_t i, const frame_t *f, const real *m, real *h)
{
    real slope[6], force[6];
    for (int32_t j = 0; j < 6; j++) {
        slope[j] = row(i + j, m);
    }
    gradient(f->q, slope, force);
    wrench_of(f, force, h);
}

/* Wrench h of the force Q to q, and K = dh/dp at dQ/dq = u */
static void carried(const frame_t *f, const real *force, const real *u, real *h, real *k)
{
    real cc[9], ct[9], g[9], t1[9], t2[9], cc_g[9], across[9], mixed[9], bent[9], form[9], d[9];
    wrench_of(f, force, h);
    /* G = A' [r]x W */
    skew(f->r, t1);
    product(t1, f->w, t2);
    transposed_product(f->a, t2, g);
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            cc[3 * i + j] = u[6 * i + j];
            ct[3 * i + j] = u[6 * i + 3 + j];
        }
    }
    /* H_rr = A U_cc A' */
    product(f->a, cc, t1);
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            k[6 * i + j] = t1[3 * i] * f->a[3 * j] + t1[3 * i + 1] * f->a[3 * j + 1] +
                           t1[3 * i + 2] * f->a[3 * j + 2];
        }
    }
    /* H_rt = A (U_cc G + U_ct) - [f]x W */
    product(cc, g, cc_g);
    for (int32_t i = 0; i < 9; i++) {
        t1[i] = cc_g[i] + ct[i];
    }
    product(f->a, t1, across);
    skew(h, t1);
    product(t1, f->w, t2);
    for (int32_t i = 0; i < 9; i++) {
        across[i] -= t2[i];
    }
    /* H_tt = U_tt + U_tc G + G' U_ct + G' U_cc G + d2(Q_c . A' r)/dtheta2, less D for K */
    transposed_product(ct, g, mixed);
    transposed_product(g, cc_g, bent);
    form_hessian(f, force, form);
    torque_derivative(f, h + 3, d);
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            k[6 * i + 3 + j] = across[3 * i + j];
            t1[3 * i + j] = u[6 * (3 + i) + 3 + j] + mixed[3 * i + j] + mixed[3 * j + i] +
                            R(0.5) * (bent[3 * i + j] + bent[3 * j + i]) +
                            R(0.25) * form[3 * i + j] - d[3 * i + j];
        }
    }
    /* Lower rows J^-T (H_tr, H_tt - D) */
    transposed_product(f->inverse, t1, t2);
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            k[6 * (3 + i) + 3 + j] = t2[3 * i + j];
            k[6 * (3 + i) + j] = f->inverse[i] * across[3 * j] +
                                 f->inverse[3 + i] * across[3 * j + 1] +
                                 f->inverse[6 + i] * across[3 * j + 2];
        }
    }
}

real @NAME@_energy(const real p[@N@])
{
    frame_t f;
    real m[MONOMIALS + 1];
    prepare(p, &f);
    monomials_at(f.q, MONOMIALS, m);
    return row(0, m) + f.refused;
}

void @NAME@_value(const real p[@N@], real h[6])
{
    frame_t f;
    real m[OFSLOPES + 1];
    prepare(p, &f);
    monomials_at(f.q, OFSLOPES, m);
    wrench_at(1, &f, m, h);
    for (int32_t i = 0; i < 6; i++) {
        h[i] += f.refused;
    }
}

void @NAME@_value_and_stiffness(const real p[@N@], real h[6], real k[@NM@])
{
    frame_t f;
    real m[OFSLOPES + 1], force[6], u[36], partial[36];
    prepare(p, &f);
    monomials_at(f.q, OFSLOPES, m);
    forces_at(f.q, m, force, u);
    carried(&f, force, u, h, partial);
    for (int32_t i = 0; i < 6; i++) {
        h[i] += f.refused;
        for (int32_t j = 0; j < 6; j++) {
            k[INPUTS * i + j] = partial[6 * i + j] + f.refused;
        }
    }
    for (int32_t j = 6; j < INPUTS; j++) {
        wrench_at(28 + 6 * (j - 6), &f, m, force);
        for (int32_t i = 0; i < 6; i++) {
            k[INPUTS * i + j] = force[i] + f.refused;
        }
    }
}

@WITHIN@
int32_t @NAME@_inside(const real p[@N@])
{
    frame_t f;
    prepare(p, &f);
    return within(f.q) & (int32_t)(f.refused <= R(0));
}
@FREEPOSE@@STEPPER@