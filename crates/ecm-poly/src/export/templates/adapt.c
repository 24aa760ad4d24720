/* A model that keeps itself right: see @NAME@_adapt.h. */
#include "@NAME@_adapt.h"

typedef @NAME@_adapt_real real;
typedef @NAME@_adapt_state state_t;
typedef @NAME@_adapt_settings settings_t;
typedef @NAME@_adapt_block block_t;
#define R(x) ((real)(x))

enum {
    N = @COUNT@,
    CELLS = @CELLS@,
    PARTS = @PARTS@,
    AT_ONCE = 5,
    STILL = 1000,
    EXCITED_OVER = 200,
    TOLD = 10,
    NO_OTHER = 65535,
    SUSPECTS = 3,
    JUMPS = 3,
    WINDOW = 100,
    ALLOWED = 1,
    FARTHEST = 4,
    MOST = 16
};

/* 0 modulus, 1 mass, 2 to 4 mass times centre, 5 to 10 zero, 11 and 12 shares */
static const uint8_t kind_of[N] = {@KINDS@};

const settings_t @NAME@_adapt_defaults = {
    {@PRIORS@},
    {@WRENCHSD@},
    {@POSESD@},
    @NOISETIME@,
    {@MODELSD@},
    {@REACH@},
    @RIM@,
    {@MIDDLE@},
    {@PERHALFRANGE@},
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
        state->excitation[i][0] = R(0);
        state->excitation[i][1] = R(1);
        for (int32_t j = 0; j < N; j++) {
            state->covariance[i][j] = R(0);
            state->information[i][j] = R(0);
        }
        state->covariance[i][i] = s->priors[i].sd * s->priors[i].sd;
        for (int32_t k = 0; k < PARTS; k++) {
            for (int32_t a = 0; a < 6; a++) {
                state->cross[i][k][a] = R(0);
            }
        }
    }
    for (int32_t k = 0; k < CELLS; k++) {
        state->visits[k] = 0;
        for (int32_t a = 0; a < 6; a++) {
            state->centres[k][a] = R(0);
        }
    }
    for (int32_t a = 0; a < 6; a++) {
        state->last[a] = R(0);
        state->at_last[0][a] = R(0);
        state->at_last[1][a] = R(0);
        state->at_last[2][a] = R(0);
    }
    clear(&state->block[0]);
    clear(&state->block[1]);
    state->time_s = R(0);
    state->of_noise = R(0);
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

static real clamped(const settings_t *s, int32_t i, real value)
{
    if (value < s->priors[i].low) {
        return s->priors[i].low;
    }
    return value > s->priors[i].high ? s->priors[i].high : value;
}

/* A walk of dt seconds that forgets: variance (1 - f^2) of the start. */
static void grow(const settings_t *s, state_t *x, real dt)
{
    const real hours = dt / R(3600);
    real lost[N], kept[N];
    for (int32_t i = 0; i < N; i++) {
        const @NAME@_prior *prior = &s->priors[i];
        lost[i] = R(0);
        if (prior->sd > R(0)) {
            real left;
            decay(prior->walk * prior->walk * hours / (R(2) * prior->sd * prior->sd), &lost[i],
                  &left);
        }
        kept[i] = R(1) - lost[i];
    }
    for (int32_t i = 0; i < N; i++) {
        const real sd = s->priors[i].sd;
        for (int32_t j = 0; j < N; j++) {
            x->covariance[i][j] = kept[i] * kept[j] * x->covariance[i][j];
        }
        /* 1 - kept^2 without the 1, which would swallow slow walks in single precision. */
        x->covariance[i][i] += lost[i] * (R(2) - lost[i]) * sd * sd;
        for (int32_t k = 0; k < PARTS; k++) {
            for (int32_t a = 0; a < 6; a++) {
                x->cross[i][k][a] = kept[i] * x->cross[i][k][a];
            }
        }
    }
}

/* Way between two poses in units of the reach. */
static real way_of(const settings_t *s, const real *from, const real *to)
{
    real way = R(0);
    for (int32_t i = 0; i < 6; i++) {
        const real d = to[i] - from[i];
        way += (d < R(0) ? -d : d) / s->reach[i / 3];
    }
    return way;
}

/* The neighbourhood of a pose; the one that was left longest ago makes room. */
static int32_t visit(const settings_t *s, state_t *x, const real *pose)
{
    int32_t cell = -1, oldest = 0;
    real least = R(0.5);
    for (int32_t k = 0; k < CELLS; k++) {
        const real way = way_of(s, x->centres[k], pose);
        if (x->visits[k] > 0 && way < least) {
            least = way;
            cell = k;
        }
        if (x->visits[k] < x->visits[oldest]) {
            oldest = k;
        }
    }
    if (cell < 0) {
        cell = oldest;
        for (int32_t a = 0; a < 6; a++) {
            x->centres[cell][a] = pose[a];
            for (int32_t i = 0; i < N; i++) {
                x->cross[i][4 + cell][a] = R(0);
            }
        }
    }
    x->visits[cell] = x->counts[3];
    return cell;
}

/* A block: columns and innovations of the mean of its halves and of half their difference, the noise of
 * either, with modulus 1, and the part of the pose in it; parts of the model's error, their covariance with
 * the parameters, variance, and the rest. */
typedef struct {
    real columns[2][N][6], nu[2][6], noise[6][6], unscaled[6][6], of_pose[6][6];
    int32_t places[AT_ONCE];
    real weights[AT_ONCE][6], shared[N][6], variance[6], rest[6], whole[6];
} seen_t;

/* 1 + (rim - 1) q^6: the error at a pose over that in the middle, with q = 1 at the rim. */
static real away_from_middle(const settings_t *s, const real *pose)
{
    real q = R(0), cube;
    for (int32_t i = 0; i < 6; i++) {
        const real part = (pose[i] - s->middle[i]) * s->per_half_range[i];
        const real size = part < R(0) ? -part : part;
        q = size > q ? size : q;
    }
    q = q < R(FARTHEST) ? q : R(FARTHEST);
    cube = q * q * q;
    return R(1) + (s->model_rim - R(1)) * (cube * cube);
}

static void see_parts(const settings_t *s, const state_t *x, const real *pose, int32_t cell, seen_t *seen)
{
    const real alike = R(5) / R(8), grown = away_from_middle(s, pose);
    for (int32_t k = 0; k < AT_ONCE; k++) {
        const real here = k == 0 ? alike : alike * grown;
        const real turn = k >= 1 && k <= 3 ? R(7) / R(4) * pose[2 + k] / s->reach[1] : here;
        seen->places[k] = k < 4 ? k : 4 + cell;
        for (int32_t a = 0; a < 6; a++) {
            seen->weights[k][a] = turn * s->model_sd[a / 3];
        }
    }
    for (int32_t a = 0; a < 6; a++) {
        seen->variance[a] = R(0);
        for (int32_t k = 0; k < AT_ONCE; k++) {
            seen->variance[a] += seen->weights[k][a] * seen->weights[k][a];
        }
        seen->whole[a] = (grown * s->model_sd[a / 3]) * (grown * s->model_sd[a / 3]);
        seen->rest[a] = seen->whole[a] / R(5);
        for (int32_t i = 0; i < N; i++) {
            seen->shared[i][a] = R(0);
            for (int32_t k = 0; k < AT_ONCE; k++) {
                seen->shared[i][a] += x->cross[i][seen->places[k]][a] * seen->weights[k][a];
            }
        }
    }
}

/* P H' by rows of P */
static void carry(const state_t *x, real c[N][6], real g[N][6])
{
    for (int32_t i = 0; i < N; i++) {
        for (int32_t a = 0; a < 6; a++) {
            g[i][a] = R(0);
        }
        for (int32_t j = 0; j < N; j++) {
            for (int32_t a = 0; a < 6; a++) {
                g[i][a] += x->covariance[i][j] * c[j][a];
            }
        }
    }
}

/* G = P H' + covariance with the model's error, and S */
static void tell(const state_t *x, seen_t *seen, real g[N][6], real total[6][6])
{
    carry(x, seen->columns[0], g);
    for (int32_t a = 0; a < 6; a++) {
        for (int32_t b = 0; b < 6; b++) {
            real sum = R(0), once = R(0), back = R(0);
            for (int32_t i = 0; i < N; i++) {
                sum += seen->columns[0][i][a] * g[i][b];
                once += seen->columns[0][i][a] * seen->shared[i][b];
                back += seen->columns[0][i][b] * seen->shared[i][a];
            }
            total[a][b] = sum + (once + back + seen->noise[a][b]);
        }
        total[a][a] += seen->variance[a] + seen->rest[a];
    }
    for (int32_t i = 0; i < N; i++) {
        for (int32_t a = 0; a < 6; a++) {
            g[i][a] += seen->shared[i][a];
        }
    }
}

/* nu' S^-1 nu with twice the variance of the model's error, and the mean share of the variance that is no noise */
static real surprise_of(const seen_t *seen, real total[6][6], real *alike)
{
    real e[6][6], solved[6];
    *alike = R(0);
    for (int32_t a = 0; a < 6; a++) {
        for (int32_t b = 0; b < 6; b++) {
            e[a][b] = total[a][b];
        }
        e[a][a] += R(ALLOWED) * seen->whole[a];
        *alike += R(1) - seen->noise[a][a] / e[a][a];
    }
    *alike /= R(6);
    factorise(e);
    solve(e, seen->nu[0], solved);
    return dot6(seen->nu[0], solved);
}

static int32_t follows(int32_t i)
{
    return kind_of[i] == 0 || kind_of[i] >= 11;
}

/* Takes what row j explains out of the other rows. */
static void eliminate(real m[N][N], int32_t j)
{
    for (int32_t i = 0; i < N; i++) {
        const real share = m[i][j] / m[j][j];
        for (int32_t k = 0; k < N && i != j; k++) {
            m[i][k] -= share * m[j][k];
        }
    }
}

/* What the last blocks tell of each parameter that follows the model, whatever the others are: the Schur
 * complement of its information. What is known, or told by noise only, does not follow. */
static void excite(const settings_t *s, state_t *x)
{
    real left[N][N], own[N][N];
    for (int32_t i = 0; i < N; i++) {
        for (int32_t j = 0; j < N; j++) {
            left[i][j] = x->information[i][j];
        }
    }
    for (int32_t j = 0; j < N; j++) {
        if (!follows(j) && s->priors[j].sd > R(0) && left[j][j] * R(NO_OTHER) > x->information[j][j]) {
            eliminate(left, j);
        }
    }
    for (int32_t i = 0; i < N; i++) {
        if (!follows(i) || !(s->priors[i].sd > R(0))) {
            continue;
        }
        for (int32_t j = 0; j < N; j++) {
            for (int32_t k = 0; k < N; k++) {
                own[j][k] = left[j][k];
            }
        }
        for (int32_t j = 0; j < N; j++) {
            if (j != i && follows(j) && s->priors[j].sd > R(0) && own[j][j] > R(TOLD) * x->of_noise) {
                eliminate(own, j);
            }
        }
        x->excitation[i][0] = own[i][i];
        x->excitation[i][1] = x->of_noise;
    }
}

/* Adds the information of a block to the mean over the last of them, by the noise of the readings alone. */
static void inform(const settings_t *s, state_t *x, const seen_t *seen)
{
    real e[6][6], of_noise = R(0);
    for (int32_t a = 0; a < 6; a++) {
        for (int32_t b = 0; b < 6; b++) {
            e[a][b] = seen->unscaled[a][b];
        }
    }
    factorise(e);
    for (int32_t i = 0; i < N; i++) {
        real one[6], other[6];
        solve(e, seen->columns[0][i], one);
        solve(e, seen->columns[1][i], other);
        for (int32_t j = 0; j < N; j++) {
            const real told = dot6(one, seen->columns[0][j]) - dot6(other, seen->columns[1][j]);
            x->information[i][j] += (told - x->information[i][j]) / R(EXCITED_OVER);
        }
    }
    for (int32_t a = 0; a < 6; a++) {
        real solved[6];
        solve(e, seen->of_pose[a], solved);
        of_noise += solved[a];
    }
    x->of_noise += (of_noise - x->of_noise) / R(EXCITED_OVER);
    excite(s, x);
}

/* Takes parameters that follow the model out of the gains while the readings tell too little of them, and
 * in a block that has not moved, or has no two halves. */
static void hold(const state_t *x, int32_t told_apart, real g[2][N][6])
{
    real rest[N][N];
    for (int32_t i = 0; i < N; i++) {
        for (int32_t j = 0; j < N; j++) {
            rest[i][j] = x->covariance[i][j];
        }
    }
    for (int32_t h = 0; h < N; h++) {
        const real own = rest[h][h];
        const int32_t told = told_apart && x->excitation[h][0] > R(TOLD) * x->excitation[h][1];
        real share[N];
        if (!follows(h) || told || !(x->covariance[h][h] > R(0))) {
            continue;
        }
        for (int32_t i = 0; i < N; i++) {
            share[i] = own > R(0) && i != h ? rest[i][h] / own : R(0);
        }
        for (int32_t i = 0; i < N; i++) {
            for (int32_t j = 0; j < N; j++) {
                rest[i][j] -= share[i] * rest[h][j];
            }
        }
        for (int32_t part = 0; part < 2; part++) {
            for (int32_t a = 0; a < 6; a++) {
                const real row = g[part][h][a];
                for (int32_t i = 0; i < N; i++) {
                    g[part][i][a] -= share[i] * row;
                }
                g[part][h][a] = R(0);
            }
        }
    }
}

/* x <- x + P (H+' S^-1 nu+ - H-' S^-1 nu-): each half of the interval is the instrument of the other. */
static void update(const settings_t *s, state_t *x, seen_t *seen, real apart, int32_t told_apart,
                   real g[N][6], real total[6][6])
{
    real both[2][N][6], e[6][6], noise[6][6], gain[2][N][6], through[N][N], half[N][N], shared[N][6];
    real times = R(STILL);
    if (apart * R(STILL) > R(2) - apart) {
        times = (R(2) - apart) / apart;
    }
    carry(x, seen->columns[1], both[1]);
    for (int32_t a = 0; a < 6; a++) {
        for (int32_t b = 0; b < 6; b++) {
            real sum = R(0);
            for (int32_t i = 0; i < N; i++) {
                sum += seen->columns[1][i][a] * both[1][i][b];
            }
            e[a][b] = a == b ? total[a][b] + (times - R(1)) * seen->rest[a] : total[a][b];
            e[a][b] += sum;
            noise[a][b] = seen->noise[a][b];
        }
        noise[a][a] += seen->variance[a] + times * seen->rest[a];
        for (int32_t i = 0; i < N; i++) {
            both[0][i][a] = g[i][a];
        }
    }
    factorise(e);
    if (told_apart) {
        inform(s, x, seen);
    }
    hold(x, told_apart, both);
    for (int32_t i = 0; i < N; i++) {
        solve(e, both[0][i], gain[0][i]);
        solve(e, both[1][i], gain[1][i]);
        x->values[i] += dot6(gain[0][i], seen->nu[0]) - dot6(gain[1][i], seen->nu[1]);
    }
    for (int32_t i = 0; i < N; i++) {
        for (int32_t j = 0; j < N; j++) {
            through[i][j] = (i == j ? R(1) : R(0)) - dot6(gain[0][i], seen->columns[0][j]) +
                            dot6(gain[1][i], seen->columns[1][j]);
        }
    }
    for (int32_t i = 0; i < N; i++) {
        for (int32_t a = 0; a < 6; a++) {
            shared[i][a] = R(0);
            /* The gains times the noise take the place of P H'. */
            both[0][i][a] = dot6(noise[a], gain[0][i]);
            both[1][i][a] = dot6(seen->noise[a], gain[1][i]);
            for (int32_t j = 0; j < N; j++) {
                shared[i][a] += through[i][j] * seen->shared[j][a];
            }
        }
        for (int32_t j = 0; j < N; j++) {
            half[i][j] = R(0);
            for (int32_t k = 0; k < N; k++) {
                half[i][j] += through[i][k] * x->covariance[k][j];
            }
        }
    }
    for (int32_t i = 0; i < N; i++) {
        for (int32_t j = 0; j <= i; j++) {
            real sum = R(0);
            for (int32_t k = 0; k < N; k++) {
                sum += half[i][k] * through[j][k];
            }
            sum += dot6(gain[0][i], both[0][j]) + dot6(gain[1][i], both[1][j]);
            sum -= dot6(shared[i], gain[0][j]) + dot6(gain[0][i], shared[j]);
            x->covariance[i][j] = sum;
            x->covariance[j][i] = sum;
        }
    }
    for (int32_t k = 0; k < PARTS; k++) {
        for (int32_t a = 0; a < 6; a++) {
            real before[N];
            for (int32_t i = 0; i < N; i++) {
                before[i] = x->cross[i][k][a];
            }
            for (int32_t i = 0; i < N; i++) {
                x->cross[i][k][a] = R(0);
                for (int32_t j = 0; j < N; j++) {
                    x->cross[i][k][a] += through[i][j] * before[j];
                }
            }
        }
    }
    for (int32_t k = 0; k < AT_ONCE; k++) {
        for (int32_t i = 0; i < N; i++) {
            for (int32_t a = 0; a < 6; a++) {
                x->cross[i][seen->places[k]][a] -= gain[0][i][a] * seen->weights[k][a];
            }
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
}

/* Whether all numbers are finite, and no variance below zero or far beyond that of the start. */
static int32_t is_sound(const settings_t *s, const state_t *x)
{
    int32_t sound = all_finite(x->values, N) && all_finite(x->covariance[0], N * N) &&
                    all_finite(x->excitation[0], 2 * N) && all_finite(x->information[0], N * N) &&
                    is_finite(x->of_noise) && all_finite(x->cross[0][0], 6 * PARTS * N);
    for (int32_t i = 0; i < N; i++) {
        const real sd = s->priors[i].sd, variance = x->covariance[i][i];
        sound = sound && variance >= R(0) && variance <= R(MOST) * sd * sd;
    }
    return sound;
}

/* The mean of the window's innovations against chi-square; 1: no drift. */
static int32_t no_drift(state_t *x, real surprise, real alike)
{
    real mean, bound;
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

/* The end of an interval; b: means of its halves, n: readings of independent noise. */
static int32_t close_block(const settings_t *s, state_t *x, const block_t *b, int32_t two, real n,
                           real time_s, const real *k)
{
    const real bound = R(6) * bound_of_mean(R(6), R(5));
    real apart = R(0), scale = R(1), surprise, alike, pose[6], variance[6], g[N][6], total[6][6];
    int32_t moved = 0, outcome = @NAME@_adapted;
    seen_t seen;
    state_t next;
    for (int32_t h = 0; h < 2; h++) {
        const real *t = b[h].pose + 3;
        if (!(t[0] * t[0] + t[1] * t[1] + t[2] * t[2] <= R(@HALFTURN@))) {
            return @NAME@_left_out;
        }
        columns_at(s, b[h].pose, b[h].predicted, b[h].branches, h == 0 ? seen.columns[0] : seen.columns[1]);
    }
    for (int32_t i = 0; i < N; i++) {
        for (int32_t a = 0; a < 6; a++) {
            const real one = seen.columns[0][i][a], other = seen.columns[1][i][a];
            seen.columns[0][i][a] = R(0.5) * (one + other);
            seen.columns[1][i][a] = R(0.5) * (one - other);
        }
    }
    for (int32_t i = 0; i < 6; i++) {
        const real sd = s->pose_sd[i / 3];
        pose[i] = R(0.5) * (b[0].pose[i] + b[1].pose[i]);
        moved |= (int32_t)((pose[i] - x->last[i]) * (pose[i] - x->last[i]) > R(100) / n * sd * sd);
    }
    if (x->counts[3] == 0 || moved) {
        real left;
        decay(way_of(s, x->last, pose), &apart, &left);
        if (x->counts[3] == 0) {
            apart = R(1);
        }
        for (int32_t i = 0; i < 6; i++) {
            x->last[i] = pose[i];
            x->at_last[0][i] = R(0.5) * (b[0].predicted[i] + b[1].predicted[i]);
            x->at_last[1][i] = R(0.5) * (b[0].branches[i] + b[1].branches[i]);
            x->at_last[2][i] = R(0.5) * (b[0].branches[6 + i] + b[1].branches[6 + i]);
        }
    }
    x->counts[3] += x->counts[3] < UINT32_MAX ? 1U : 0U;
    grow(s, x, time_s);
    see_parts(s, x, pose, visit(s, x, pose), &seen);
    for (int32_t i = 0; i < N; i++) {
        if (kind_of[i] == 0) {
            scale = x->values[i];
        }
    }
    for (int32_t a = 0; a < 6; a++) {
        const real one = b[0].wrench[a] - b[0].predicted[a];
        const real other = b[1].wrench[a] - b[1].predicted[a];
        real explained[2] = {R(0), R(0)};
        for (int32_t i = 0; i < N; i++) {
            const real away = x->values[i] - nominal(s, i);
            explained[0] += seen.columns[0][i][a] * away;
            explained[1] += seen.columns[1][i][a] * away;
        }
        seen.nu[0][a] = R(0.5) * (one + other) - explained[0];
        seen.nu[1][a] = R(0.5) * (one - other) - explained[1];
        variance[a] = R(1) / n * s->pose_sd[a / 3] * s->pose_sd[a / 3];
    }
    /* At rest the noise of the pose must not look like a change of the columns. */
    if (!(apart > R(0))) {
        columns_at(s, x->last, x->at_last[0], x->at_last[1], seen.columns[0]);
        for (int32_t i = 0; i < N; i++) {
            for (int32_t a = 0; a < 6; a++) {
                seen.columns[1][i][a] = R(0);
            }
        }
    }
    for (int32_t a = 0; a < 6; a++) {
        for (int32_t c = 0; c < 6; c++) {
            seen.of_pose[a][c] = R(0);
            for (int32_t j = 0; j < 6; j++) {
                seen.of_pose[a][c] += k[6 * a + j] * variance[j] * k[6 * c + j];
            }
            seen.noise[a][c] = scale * seen.of_pose[a][c] * scale;
            seen.unscaled[a][c] = seen.of_pose[a][c];
        }
        seen.noise[a][a] += R(1) / n * s->wrench_sd[a / 3] * s->wrench_sd[a / 3];
        seen.unscaled[a][a] += R(1) / n * s->wrench_sd[a / 3] * s->wrench_sd[a / 3];
    }
    tell(x, &seen, g, total);
    surprise = surprise_of(&seen, total, &alike);
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
            }
        }
        tell(x, &seen, g, total);
        surprise = surprise_of(&seen, total, &alike);
        outcome = @NAME@_jumped;
        if (!(surprise <= bound)) {
            return outcome;
        }
    }
    x->counts[1] = 0;
    next = *x;
    update(s, &next, &seen, apart, two && apart > R(0), g, total);
    if (!is_sound(s, &next)) {
        return @NAME@_left_out;
    }
    *x = next;
    return no_drift(x, surprise, alike) ? @NAME@_diagnose : outcome;
}

int32_t @NAME@_adapt(state_t *state, const settings_t *settings, const real p[6],
                     const real wrench[6], real dt, const real h[6], const real k[36],
                     const real *branches)
{
    const settings_t *s = settings ? settings : &@NAME@_adapt_defaults;
    const real turn = p[3] * p[3] + p[4] * p[4] + p[5] * p[5];
    block_t b[2];
    block_t *half;
    real read_s, time_s, readings, n;
    int32_t two;
    if (!(dt > R(0) && is_finite(dt) && all_finite(p, 6) && all_finite(wrench, 6) &&
          all_finite(h, 6) && all_finite(k, 36) && turn <= R(@HALFTURN@) &&
          (!branches || all_finite(branches, 12)))) {
        return @NAME@_refused;
    }
    if (state->held) {
        return @NAME@_diagnose;
    }
    b[0] = state->block[0];
    b[1] = state->block[1];
    /* What was read before a pause longer than an interval is dropped. */
    if (dt > s->interval_s) {
        clear(&b[0]);
        clear(&b[1]);
    }
    read_s = b[0].read_s + b[1].read_s + R(0.5) * dt;
    time_s = state->time_s + dt;
    half = read_s >= R(9) / R(20) * s->interval_s ? &b[1] : &b[0];
    for (int32_t i = 0; i < 6; i++) {
        half->pose[i] += p[i];
        half->wrench[i] += wrench[i];
        half->predicted[i] += h[i];
    }
    for (int32_t i = 0; i < 12; i++) {
        half->branches[i] += branches ? branches[i] : R(0);
    }
    half->read_s += dt;
    half->readings += R(1);
    if (!(all_finite(half->pose, 6) && all_finite(half->wrench, 6) && all_finite(half->predicted, 6) &&
          all_finite(half->branches, 12) && is_finite(half->read_s) && is_finite(time_s))) {
        return @NAME@_refused;
    }
    state->block[0] = b[0];
    state->block[1] = b[1];
    state->time_s = time_s;
    if (read_s + dt < s->interval_s) {
        return @NAME@_waiting;
    }
    clear(&state->block[0]);
    clear(&state->block[1]);
    state->time_s = R(0);
    two = b[0].readings > R(0) && b[1].readings > R(0);
    readings = b[0].readings + b[1].readings;
    /* Variance of the mean of two means: (1/n1 + 1/n2) / 4. */
    n = two ? R(4) * b[0].readings * b[1].readings / readings : readings;
    read_s = b[0].read_s + b[1].read_s;
    if (s->noise_time_s * n > read_s) {
        n = s->noise_time_s < read_s ? read_s / s->noise_time_s : R(1);
    }
    for (int32_t j = 0; j < 2; j++) {
        const real share = R(1) / b[j].readings;
        if (!(b[j].readings > R(0))) {
            continue;
        }
        for (int32_t i = 0; i < 6; i++) {
            b[j].pose[i] *= share;
            b[j].wrench[i] *= share;
            b[j].predicted[i] *= share;
            b[j].branches[i] *= share;
            b[j].branches[6 + i] *= share;
        }
    }
    if (!two) {
        b[b[0].readings > R(0) ? 1 : 0] = b[b[0].readings > R(0) ? 0 : 1];
    }
    return close_block(s, state, b, two, n, time_s, k);
}
