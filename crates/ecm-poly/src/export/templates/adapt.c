/* A model that keeps itself right: see @NAME@_adapt.h. */
#include "@NAME@_adapt.h"

typedef @NAME@_adapt_real real;
typedef @NAME@_adapt_state state_t;
typedef @NAME@_adapt_settings settings_t;
typedef @NAME@_adapt_block block_t;
#define R(x) ((real)(x))

enum { N = @COUNT@, STILL = 1000, EXCITED = 100, MOST_EXCITED = 10000, SUSPECTS = 3, JUMPS = 3, WINDOW = 100 };

/* 0 modulus, 1 mass, 2 to 4 mass times centre, 5 to 10 zero, 11 and 12 shares */
static const uint8_t kind_of[N] = {@KINDS@};

const settings_t @NAME@_adapt_defaults = {
    {@PRIORS@},
    {@WRENCHSD@},
    {@POSESD@},
    @NOISETIME@,
    {@MODELSD@},
    {@REACH@},
    {@GRAVITY@},
    @INTERVAL@};

@DECAY@

static int32_t all_finite(const real *x, int32_t count)
{
    real sum = R(0);
    for (int32_t i = 0; i < count; i++) {
        sum += x[i] - x[i];
    }
    return is_finite(sum);
}

static void clear(block_t *b)
{
    for (int32_t i = 0; i < 6; i++) {
        b->pose[i] = R(0);
        b->wrench[i] = R(0);
        b->predicted[i] = R(0);
        b->branches[i] = R(0);
        b->branches[6 + i] = R(0);
    }
    b->time_s = R(0);
    b->read_s = R(0);
    b->readings = R(0);
}

static real dot6(const real *a, const real *b)
{
    real sum = R(0);
    for (int32_t i = 0; i < 6; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* Square root of 1e-6 <= x <= 1 by Newton's steps. */
static real root(real x)
{
    real y = R(1);
    for (int32_t i = 0; i < 16; i++) {
        y = R(0.5) * (y + x / y);
    }
    return y;
}

/* Bound of chi-square over its degrees of freedom (Wilson and Hilferty 1931). */
static real bound_of_mean(real freedom, real z)
{
    const real a = R(2) / (R(9) * freedom);
    const real edge = R(1) - a + z * root(a);
    return edge * edge * edge;
}

/* L D L' in place, 1/D on the diagonal; NaN where the matrix is not positive definite. */
static void factorise(real e[6][6])
{
    for (int32_t j = 0; j < 6; j++) {
        real pivot = e[j][j];
        for (int32_t k = 0; k < j; k++) {
            pivot -= e[j][k] * (e[j][k] * e[k][k]);
        }
        for (int32_t i = j + 1; i < 6; i++) {
            real sum = e[i][j];
            for (int32_t k = 0; k < j; k++) {
                sum -= e[i][k] * (e[j][k] * e[k][k]);
            }
            e[i][j] = sum;
        }
        if (pivot > R(0)) {
            e[j][j] = R(1) / pivot;
        } else {
            e[j][j] = R(0);
            e[j][j] /= e[j][j];
        }
    }
}

static void solve(real e[6][6], const real *right, real *x)
{
    for (int32_t i = 0; i < 6; i++) {
        x[i] = right[i];
        for (int32_t k = 0; k < i; k++) {
            x[i] -= e[i][k] * e[k][k] * x[k];
        }
    }
    for (int32_t i = 0; i < 6; i++) {
        x[i] *= e[i][i];
    }
    for (int32_t i = 5; i >= 0; i--) {
        for (int32_t k = i + 1; k < 6; k++) {
            x[i] -= e[k][i] * e[i][i] * x[k];
        }
    }
}

/* Rotation matrix of a rotation vector of at most half a turn. */
static void turn_of(const real *t, real m[3][3])
{
    const real s = t[0] * t[0] + t[1] * t[1] + t[2] * t[2];
    real one = R(1), two = R(1), cosine;
    for (int32_t j = 13; j >= 1; j--) {
        one = R(1) - s / (R(2 * j) * R(2 * j + 1)) * one;
        two = R(1) - s / (R(2 * j + 1) * R(2 * j + 2)) * two;
    }
    two *= R(0.5);
    cosine = R(1) - s * two;
    for (int32_t i = 0; i < 3; i++) {
        for (int32_t j = 0; j < 3; j++) {
            m[i][j] = two * t[i] * t[j] + (i == j ? cosine : R(0));
        }
    }
    m[0][1] -= one * t[2];
    m[0][2] += one * t[1];
    m[1][0] += one * t[2];
    m[1][2] -= one * t[0];
    m[2][0] -= one * t[1];
    m[2][1] += one * t[0];
}

/* d(wrench)/d(parameters), by rows of parameters */
static void columns_at(const settings_t *s, const real *p, const real *h, const real *branches,
                       real c[N][6])
{
    real m[3][3];
    turn_of(p + 3, m);
    for (int32_t i = 0; i < N; i++) {
        const int32_t kind = kind_of[i];
        for (int32_t a = 0; a < 6; a++) {
            c[i][a] = kind == 0 ? h[a] : R(0);
            if (kind >= 11 && branches) {
                c[i][a] = branches[6 * (kind - 11) + a];
            }
        }
        if (kind == 1) {
            for (int32_t a = 0; a < 3; a++) {
                c[i][a] = -s->gravity[a];
            }
        } else if (kind >= 2 && kind <= 4) {
            const real *g = s->gravity;
            const real x = m[0][kind - 2], y = m[1][kind - 2], z = m[2][kind - 2];
            c[i][3] = g[1] * z - g[2] * y;
            c[i][4] = g[2] * x - g[0] * z;
            c[i][5] = g[0] * y - g[1] * x;
        } else if (kind >= 5 && kind <= 10) {
            const int32_t axis = (kind - 5) % 3, from = kind - 5 - axis;
            for (int32_t a = 0; a < 3; a++) {
                c[i][from + a] = m[a][axis];
            }
        }
    }
}

static real nominal(const settings_t *s, int32_t i)
{
    if (kind_of[i] == 0) {
        return R(1);
    }
    return kind_of[i] >= 11 ? s->priors[i].start : R(0);
}

void @NAME@_adapt_init(state_t *state, const settings_t *settings)
{
    const settings_t *s = settings ? settings : &@NAME@_adapt_defaults;
    for (int32_t i = 0; i < N; i++) {
        state->values[i] = s->priors[i].start;
        state->excitation[i] = R(0);
        for (int32_t j = 0; j < N; j++) {
            state->covariance[i][j] = R(0);
        }
        state->covariance[i][i] = s->priors[i].sd * s->priors[i].sd;
    }
    clear(&state->block);
    clear(&state->anchor);
    state->window[0] = R(0);
    state->window[1] = R(0);
    for (int32_t i = 0; i < 4; i++) {
        state->counts[i] = 0;
    }
    state->held = 0;
}

void @NAME@_adapt_resume(state_t *state, const settings_t *settings)
{
    real values[N];
    for (int32_t i = 0; i < N; i++) {
        values[i] = state->values[i];
    }
    @NAME@_adapt_init(state, settings);
    for (int32_t i = 0; i < N; i++) {
        state->values[i] = values[i];
    }
}

void @NAME@_adapt_expected(const state_t *state, const settings_t *settings, const real p[6],
                           const real h[6], const real *branches, int32_t of_sensor, real wrench[6])
{
    const settings_t *s = settings ? settings : &@NAME@_adapt_defaults;
    real c[N][6];
    columns_at(s, p, h, branches, c);
    for (int32_t a = 0; a < 6; a++) {
        wrench[a] = h[a];
    }
    for (int32_t i = 0; i < N; i++) {
        if (of_sensor || kind_of[i] < 5 || kind_of[i] > 10) {
            const real away = state->values[i] - nominal(s, i);
            for (int32_t a = 0; a < 6; a++) {
                wrench[a] += away * c[i][a];
            }
        }
    }
}

/* How many readings of independent noise a block is worth. */
static real independent(const block_t *b, const settings_t *s)
{
    if (s->noise_time_s * b->readings <= b->read_s) {
        return b->readings;
    }
    return s->noise_time_s < b->read_s ? b->read_s / s->noise_time_s : R(1);
}

/* Scales row and column, which keeps the matrix positive and its correlations as they are. */
static void cap(const settings_t *s, state_t *x, int32_t i)
{
    const real largest = s->priors[i].sd * s->priors[i].sd;
    real ratio, factor = R(0);
    if (x->covariance[i][i] <= largest) {
        return;
    }
    ratio = largest / x->covariance[i][i];
    if (ratio > R(@EPSILON@)) {
        factor = root(ratio);
    }
    for (int32_t j = 0; j < N; j++) {
        x->covariance[i][j] *= factor;
        x->covariance[j][i] = x->covariance[i][j];
    }
    x->covariance[i][i] = largest;
}

static real clamped(const settings_t *s, int32_t i, real value)
{
    if (value < s->priors[i].low) {
        return s->priors[i].low;
    }
    return value > s->priors[i].high ? s->priors[i].high : value;
}

/* What a block tells: G = P H' by rows of P, S = H P H' + noise + model */
typedef struct {
    real c[N][6], g[N][6], total[6][6];
} told_t;

static void tell(const state_t *x, const block_t *at, const settings_t *s, real noise[6][6],
                 told_t *told)
{
    columns_at(s, at->pose, at->predicted, at->branches, told->c);
    for (int32_t i = 0; i < N; i++) {
        for (int32_t a = 0; a < 6; a++) {
            told->g[i][a] = R(0);
        }
        for (int32_t j = 0; j < N; j++) {
            for (int32_t a = 0; a < 6; a++) {
                told->g[i][a] += x->covariance[i][j] * told->c[j][a];
            }
        }
    }
    for (int32_t a = 0; a < 6; a++) {
        for (int32_t b = 0; b < 6; b++) {
            real sum = R(0);
            for (int32_t i = 0; i < N; i++) {
                sum += told->c[i][a] * told->g[i][b];
            }
            told->total[a][b] = sum + noise[a][b];
        }
        told->total[a][a] += s->model_sd[a / 3] * s->model_sd[a / 3];
    }
}

/* nu' S^-1 nu; x = S^-1 nu */
static real surprise_of(const told_t *told, const real *nu, real *x)
{
    real e[6][6];
    for (int32_t a = 0; a < 6; a++) {
        for (int32_t b = 0; b < 6; b++) {
            e[a][b] = told->total[a][b];
        }
    }
    factorise(e);
    solve(e, nu, x);
    return dot6(nu, x);
}

/* Whether no parameter was held for want of excitation. */
static int32_t update(const settings_t *s, state_t *x, const told_t *told, const real *nu, real apart,
                   const real *of_pose)
{
    real total[6][6], e[6][6], gain[N][6], rest[6], noisy = R(0), times = R(STILL);
    int32_t all_told = 1;
    if (apart * R(STILL) > R(2) - apart) {
        times = (R(2) - apart) / apart;
    }
    for (int32_t a = 0; a < 6; a++) {
        for (int32_t b = 0; b < 6; b++) {
            total[a][b] = told->total[a][b];
        }
        total[a][a] += (times - R(1)) * (s->model_sd[a / 3] * s->model_sd[a / 3]);
        noisy += of_pose[a] / total[a][a];
        for (int32_t b = 0; b < 6; b++) {
            e[a][b] = total[a][b];
        }
    }
    factorise(e);
    for (int32_t i = 0; i < N; i++) {
        real signal = R(0);
        for (int32_t a = 0; a < 6; a++) {
            signal += told->g[i][a] * told->g[i][a] / total[a][a];
        }
        solve(e, told->g[i], gain[i]);
        if ((kind_of[i] == 0 || kind_of[i] >= 11) && x->covariance[i][i] > R(0)) {
            /* The mean, or blocks in which noise looks like excitation would be chosen. */
            real ratio = signal / (x->covariance[i][i] * x->covariance[i][i] * noisy);
            ratio = ratio < R(MOST_EXCITED) ? ratio : R(MOST_EXCITED);
            x->excitation[i] += (ratio - x->excitation[i]) / R(20);
            if (x->excitation[i] <= R(EXCITED)) {
                all_told = 0;
                for (int32_t a = 0; a < 6; a++) {
                    gain[i][a] = R(0);
                }
            }
        }
        x->values[i] += dot6(gain[i], nu);
    }
    for (int32_t i = 0; i < N; i++) {
        for (int32_t a = 0; a < 6; a++) {
            rest[a] = dot6(total[a], gain[i]) - told->g[i][a];
        }
        for (int32_t j = 0; j <= i; j++) {
            x->covariance[i][j] += dot6(rest, gain[j]) - dot6(gain[i], told->g[j]);
            x->covariance[j][i] = x->covariance[i][j];
        }
    }
    for (int32_t i = 0; i < N; i++) {
        const real excess = clamped(s, i, x->values[i]) - x->values[i];
        const real variance = x->covariance[i][i];
        if (excess * excess > R(0) && variance > R(0)) {
            for (int32_t j = 0; j < N; j++) {
                x->values[j] += x->covariance[j][i] / variance * excess;
            }
        }
    }
    for (int32_t i = 0; i < N; i++) {
        x->values[i] = clamped(s, i, x->values[i]);
    }
    return all_told;
}

/* The mean of the window's innovations against chi-square; 1: no drift. */
static int32_t no_drift(state_t *x, real surprise, const told_t *told, real noise[6][6])
{
    real alike = R(0), mean, bound;
    for (int32_t a = 0; a < 6; a++) {
        alike += R(1) - noise[a][a] / told->total[a][a];
    }
    alike /= R(6);
    x->window[0] += surprise;
    x->window[1] += x->counts[0] == 0 ? R(1) : R(1) - alike * alike;
    x->counts[0] += 1;
    if (x->counts[0] < WINDOW) {
        return 0;
    }
    mean = x->window[0] / R(6 * WINDOW);
    bound = bound_of_mean(R(6) * x->window[1], R(4.75));
    x->window[0] = R(0);
    x->window[1] = R(0);
    x->counts[0] = 0;
    x->counts[2] = 0;
    if (mean <= bound) {
        return 0;
    }
    x->held = 1;
    return 1;
}

/* The end of an interval; b: means of its readings. */
static int32_t close_block(const settings_t *s, state_t *x, const block_t *b, const real *k)
{
    const int32_t first = x->counts[3] == 0;
    const real n = independent(b, s), bound = R(6) * bound_of_mean(R(6), R(5));
    real apart = first ? R(1) : R(0), scale = R(1), way = R(0), surprise;
    real nu[6], weighed[6], noise[6][6], of_pose[6], variance[6], expected[6];
    int32_t moved = first, outcome = @NAME@_adapted, all_told;
    told_t told;
    state_t next;
    for (int32_t i = 0; i < 6; i++) {
        const real d = b->pose[i] - x->anchor.pose[i], sd = s->pose_sd[i / 3];
        moved |= (int32_t)(d * d > R(100) / n * sd * sd);
        way += (d < R(0) ? -d : d) / s->reach[i / 3];
    }
    if (moved) {
        real lost, left;
        decay(way, &lost, &left);
        apart += (R(1) - apart) * lost;
        x->anchor = *b;
    }
    x->counts[3] += x->counts[3] < UINT32_MAX ? 1U : 0U;
    for (int32_t i = 0; i < N; i++) {
        const real walk = s->priors[i].walk;
        x->covariance[i][i] += walk * walk * (b->time_s / R(3600));
        cap(s, x, i);
        if (kind_of[i] == 0) {
            scale = x->values[i];
        }
    }
    @NAME@_adapt_expected(x, s, b->pose, b->predicted, b->branches, 1, expected);
    for (int32_t a = 0; a < 6; a++) {
        nu[a] = b->wrench[a] - expected[a];
        variance[a] = R(1) / n * s->pose_sd[a / 3] * s->pose_sd[a / 3];
    }
    for (int32_t a = 0; a < 6; a++) {
        for (int32_t c = 0; c < 6; c++) {
            noise[a][c] = R(0);
            for (int32_t j = 0; j < 6; j++) {
                noise[a][c] += scale * k[6 * a + j] * variance[j] * (scale * k[6 * c + j]);
            }
        }
        of_pose[a] = noise[a][a];
        noise[a][a] += R(1) / n * s->wrench_sd[a / 3] * s->wrench_sd[a / 3];
    }
    tell(x, &x->anchor, s, noise, &told);
    surprise = surprise_of(&told, nu, weighed);
    if (!(surprise <= bound)) {
        int32_t may_jump = 0;
        x->counts[1] += 1;
        if (x->counts[1] < SUSPECTS) {
            return @NAME@_left_out;
        }
        for (int32_t i = 0; i < N; i++) {
            may_jump |= (int32_t)(s->priors[i].jumps > R(0));
        }
        if (!may_jump || x->counts[2] >= JUMPS) {
            x->held = 1;
            return @NAME@_diagnose;
        }
        x->counts[0] = 0;
        x->counts[1] = 0;
        x->counts[2] += 1;
        x->window[0] = R(0);
        x->window[1] = R(0);
        for (int32_t i = 0; i < N; i++) {
            if (s->priors[i].jumps > R(0)) {
                x->covariance[i][i] += s->priors[i].sd * s->priors[i].sd;
                cap(s, x, i);
            }
        }
        tell(x, &x->anchor, s, noise, &told);
        surprise = surprise_of(&told, nu, weighed);
        outcome = @NAME@_jumped;
        if (!(surprise <= bound)) {
            return outcome;
        }
    }
    x->counts[1] = 0;
    next = *x;
    if (moved) {
        for (int32_t j = 0; j < 6; j++) {
            real shift = R(0);
            for (int32_t a = 0; a < 6; a++) {
                shift += scale * k[6 * a + j] * weighed[a];
            }
            shift *= variance[j];
            next.anchor.pose[j] += shift;
            for (int32_t a = 0; a < 6; a++) {
                next.anchor.predicted[a] += k[6 * a + j] * shift;
            }
        }
        tell(&next, &next.anchor, s, noise, &told);
    }
    all_told = update(s, &next, &told, nu, apart, of_pose);
    if (!(all_finite(next.values, N) && all_finite(next.covariance[0], N * N) &&
          all_finite(next.anchor.pose, 6) && all_finite(next.anchor.predicted, 6))) {
        return @NAME@_left_out;
    }
    *x = next;
    /* The error of a parameter that is held is alike in all blocks: no chi-square. */
    if (!all_told) {
        return outcome;
    }
    return no_drift(x, surprise, &told, noise) ? @NAME@_diagnose : outcome;
}

int32_t @NAME@_adapt(state_t *state, const settings_t *settings, const real p[6],
                     const real wrench[6], real dt, const real h[6], const real k[36],
                     const real *branches)
{
    const settings_t *s = settings ? settings : &@NAME@_adapt_defaults;
    const real turn = p[3] * p[3] + p[4] * p[4] + p[5] * p[5];
    block_t b = state->block;
    if (!(dt > R(0) && is_finite(dt) && all_finite(p, 6) && all_finite(wrench, 6) &&
          all_finite(h, 6) && all_finite(k, 36) && turn <= R(@HALFTURN@) &&
          (!branches || all_finite(branches, 12)))) {
        return @NAME@_refused;
    }
    if (state->held) {
        return @NAME@_diagnose;
    }
    /* What was read before a pause longer than an interval is dropped. */
    if (dt > s->interval_s) {
        clear(&b);
        b.time_s = state->block.time_s;
    }
    for (int32_t i = 0; i < 6; i++) {
        b.pose[i] += p[i];
        b.wrench[i] += wrench[i];
        b.predicted[i] += h[i];
    }
    for (int32_t i = 0; i < 12; i++) {
        b.branches[i] += branches ? branches[i] : R(0);
    }
    b.time_s += dt;
    b.read_s += dt;
    b.readings += R(1);
    if (!(all_finite(b.pose, 6) && all_finite(b.wrench, 6) && all_finite(b.predicted, 6) &&
          all_finite(b.branches, 12) && is_finite(b.time_s))) {
        return @NAME@_refused;
    }
    state->block = b;
    if (b.read_s + R(0.5) * dt < s->interval_s) {
        return @NAME@_waiting;
    }
    clear(&state->block);
    for (int32_t i = 0; i < 6; i++) {
        const real share = R(1) / b.readings;
        b.pose[i] *= share;
        b.wrench[i] *= share;
        b.predicted[i] *= share;
        b.branches[i] *= share;
        b.branches[6 + i] *= share;
    }
    return close_block(s, state, &b, k);
}
