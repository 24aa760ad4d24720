
/* Effects of time. q: mid-frame coordinates, Q: force to q of the static wrench. */

typedef @NAME@_state state_t;
typedef @NAME@_inputs inputs_t;

static const real stiffness_at_rest[6] = {@STIFFNESS@};
static const real share_of[2] = {@SHARES@};
static const real tau_of[2] = {@TAUS@};
static const real linear_of[2] = {@LINEAR@};
static const real friction_of[6] = {@FRICTION@};
static const real slip_of[6] = {@SLIP@};
static const real softer_per_kelvin = R(@WARMER@), ageing_per_s = R(@AGEING@);
static const real softening = R(@SOFTENING@);
static const real damping_of[2] = {@DAMPING@};
/* 1/k! */
static const real inverse_factorial[10] = {@FACTORIALS@};

const inputs_t @NAME@_default_inputs = {R(@REFERENCE@), R(0)};

/* The static map at a pose, and the work |(p - p0) . h| / 2 with its derivative. */
typedef struct {
    frame_t frame;
    real h[6], k[36], force[6], work, slope[6];
} here_t;

static int32_t finite(real x) { return x - x == R(0); }

/* 1 - exp(-x) by its series at x / 1024, then s <- s (2 - s) ten times, and (1 - exp(-x)) / x */
static void decay(real x, real *lost, real *left)
{
    real y = (x < R(64) ? x : R(64)) / R(1024), sum = R(0);
    if (x < R(@EPSILON@)) {
        *lost = x;
        *left = R(1);
        return;
    }
    for (int32_t j = 9; j >= 1; j--) {
        sum = inverse_factorial[j] - y * sum;
    }
    y *= sum;
    for (int32_t j = 0; j < 10; j++) {
        y *= R(2) - y;
    }
    *lost = y;
    *left = y / x;
}

/* Wrench h of the force Q to q, and K = dh/dp at dQ/dq = u */
static void carried(const frame_t *at, const real *force, const real *u, real *h, real *k)
{
    const frame_t f = *at;
    real cc[9], ct[9], g[9], t1[9], t2[9], cc_g[9], across[9], mixed[9], bent[9], form[9], d[9];
    wrench_of(&f, force, h);
@PARTIAL@
}

static int32_t find_here(const real *p, here_t *here)
{
    real jacobian[9], lever[3], turned[3], sum = R(0), product = R(0), half, away[6];
    frame_t *f = &here->frame;
    prepare(p, f);
    @NAME@_value_and_stiffness(p, here->h, here->k);
    for (int32_t i = 0; i < 6; i++) {
        away[i] = p[i];
        sum += here->h[i];
    }
    if (!finite(sum)) {
        return 0;
    }
    /* Q_c = A' f, Q_theta = J' tau + W' (r x f) */
    with_parts(f->theta, f->whole[1], f->whole[2], f->whole[3], jacobian);
    cross(f->r, here->h, lever);
    apply_transposed(f->a, here->h, here->force);
    apply_transposed(jacobian, here->h + 3, here->force + 3);
    apply_transposed(f->w, lever, turned);
    for (int32_t i = 0; i < 3; i++) {
        here->force[3 + i] += turned[i];
    }
    away[0] -= length_m;
    for (int32_t i = 0; i < 6; i++) {
        product += away[i] * here->h[i];
    }
    half = product < R(0) ? R(-0.5) : R(0.5);
    here->work = half * product;
    for (int32_t j = 0; j < 6; j++) {
        real slope = here->h[j];
        for (int32_t i = 0; i < 6; i++) {
            slope += here->k[6 * i + j] * away[i];
        }
        here->slope[j] = half * slope;
    }
    return 1;
}

static real size_at(const inputs_t *inputs)
{
    return R(1) - softer_per_kelvin * (inputs->temperature_degC - R(@REFERENCE@)) +
           ageing_per_s * inputs->age_s;
}

/* NaN in all results. */
static int32_t refuse(real *h, real *k)
{
    real none = R(0);
    none /= none;
    for (int32_t i = 0; i < 6; i++) {
        h[i] = none;
    }
    for (int32_t i = 0; i < 36; i++) {
        k[i] = none;
    }
    return 0;
}

int32_t @NAME@_init(state_t *state, const real p[6])
{
    here_t here;
    if (!find_here(p, &here)) {
        return 0;
    }
    for (int32_t i = 0; i < 6; i++) {
        state->pose[i] = p[i];
        state->coordinates[i] = here.frame.q[i];
        state->force[i] = here.force[i];
        state->stretch[i] = R(0);
        for (int32_t b = 0; b < 2; b++) {
            state->memory[b][i] = R(0);
            state->carry[b][i] = R(0);
        }
    }
    state->largest = here.work;
    return 1;
}

int32_t @NAME@_step(state_t *state, const real p[6], real dt, const inputs_t *inputs, real h[6],
                    real k[36])
{
    here_t here;
    real lost[2], left[2], total[6], turning[6], steep[36] = {R(0)}, beside[36], more[6];
    real elastic = R(0), below = R(0), size, loss;
    inputs = inputs ? inputs : &@NAME@_default_inputs;
    size = size_at(inputs);
    if (!(dt >= R(0) && finite(dt) && finite(size) && find_here(p, &here))) {
        return refuse(h, k);
    }
    for (int32_t b = 0; b < 2; b++) {
        decay(dt / tau_of[b], &lost[b], &left[b]);
        elastic += (R(1) - linear_of[b]) * share_of[b] * left[b];
    }
    for (int32_t j = 0; j < 6; j++) {
        const real along = here.frame.q[j] - state->coordinates[j];
        const real driven = here.force[j] - state->force[j];
        const real wanted = state->stretch[j] + along;
        total[j] = R(0);
        for (int32_t b = 0; b < 2; b++) {
            const real x = linear_of[b] > R(0) ? stiffness_at_rest[j] * along : driven;
            const real old = state->memory[b][j];
            const real change = (left[b] * x - lost[b] * old) + state->carry[b][j];
            const real new = old + change;
            /* What rounding left out: else slow branches would stand still in single precision. */
            state->carry[b][j] = change - (new - old);
            state->memory[b][j] = new;
            total[j] += share_of[b] * new;
            steep[7 * j] += linear_of[b] * share_of[b] * left[b] * stiffness_at_rest[j];
        }
        if (wanted > slip_of[j]) {
            state->stretch[j] = slip_of[j];
        } else if (wanted < -slip_of[j]) {
            state->stretch[j] = -slip_of[j];
        } else {
            state->stretch[j] = wanted;
            steep[7 * j] += friction_of[j];
        }
        total[j] += friction_of[j] * state->stretch[j];
        turning[j] = total[j] - elastic * here.force[j];
    }
    if (here.work > state->largest) {
        state->largest = here.work;
    }
    if (state->largest > R(0)) {
        below = R(1) - here.work / state->largest;
    }
    loss = softening * below;
    carried(&here.frame, turning, steep, more, beside);
    wrench_of(&here.frame, total, more);
    for (int32_t i = 0; i < 6; i++) {
        h[i] = (size - loss) * here.h[i] + more[i];
        for (int32_t j = 0; j < 6; j++) {
            real slope = (size - loss + elastic) * here.k[6 * i + j] + beside[6 * i + j];
            if (state->largest > here.work) {
                slope += softening * here.h[i] * here.slope[j] / state->largest;
            }
            k[6 * i + j] = slope;
        }
    }
    for (int32_t j = 0; j < 6; j++) {
        if (dt > R(0)) {
            const real damping = damping_of[j / 3] / dt;
            h[j] += damping * (p[j] - state->pose[j]);
            k[7 * j] += damping;
        }
        state->pose[j] = p[j];
        state->coordinates[j] = here.frame.q[j];
        state->force[j] = here.force[j];
    }
    return 1;
}

int32_t @NAME@_settled(const real p[6], const inputs_t *inputs, real h[6], real k[36])
{
    here_t here;
    const real size = size_at(inputs ? inputs : &@NAME@_default_inputs);
    if (!(finite(size) && find_here(p, &here))) {
        return refuse(h, k);
    }
    for (int32_t i = 0; i < 6; i++) {
        h[i] = size * here.h[i];
    }
    for (int32_t i = 0; i < 36; i++) {
        k[i] = size * here.k[i];
    }
    return 1;
}
