
/* Effects of time along one coordinate. */

typedef @NAME@_state state_t;
typedef @NAME@_conditions inputs_t;

static const real stiffness_of[6] = {@STIFFNESS@};
static const real share_of[2] = {@SHARES@};
static const real tau_of[2] = {@TAUS@};
static const real linear_of[2] = {@LINEAR@};
static const real friction_of[6] = {@FRICTION@};
static const real slip_of[6] = {@SLIP@};
/* Least and largest p that is no fault */
static const real farthest_of[2] = {@FARTHEST@};
static const real softer_per_kelvin = R(@WARMER@), ageing_per_s = R(@AGEING@);

@CONDITIONS@
@DECAY@

/* NaN in both results. */
static int32_t refuse(real *h, real *k)
{
    h[0] = R(0);
    h[0] /= h[0];
    k[0] = h[0];
    return 0;
}

int32_t @NAME@_init(state_t *state, const real p[1])
{
    real h[1];
    @NAME@_value(p, h);
    if (!(is_finite(p[0] + h[0]) && p[0] >= farthest_of[0] && p[0] <= farthest_of[1])) {
        return 0;
    }
    state->pose[0] = p[0];
    state->value = h[0];
    state->stretch = R(0);
    for (int32_t b = 0; b < 2; b++) {
        state->memory[b][0] = R(0);
        state->carry[b] = R(0);
    }
    return 1;
}

int32_t @NAME@_step(state_t *state, const real p[1], real dt, const inputs_t *inputs, real h[1],
                    real k[1])
{
    const real size = size_at(inputs ? inputs : &@NAME@_default_conditions);
    real value, slope, wanted;
    @NAME@_value_and_stiffness(p, h, k);
    value = h[0];
    slope = k[0];
    if (!(dt >= R(0) && is_finite(dt) && is_finite(size) && is_finite(p[0] + value + slope) &&
          p[0] >= farthest_of[0] && p[0] <= farthest_of[1])) {
        return refuse(h, k);
    }
    h[0] = size * value;
    k[0] = size * slope;
    for (int32_t b = 0; b < 2; b++) {
        const real old = state->memory[b][0];
        real lost, left, driven = value - state->value, of_slope = slope, change, now;
        decay(dt / tau_of[b], &lost, &left);
        if (linear_of[b] > R(0)) {
            driven = stiffness_of[0] * (p[0] - state->pose[0]);
            of_slope = stiffness_of[0];
        }
        change = (left * driven - lost * old) + state->carry[b];
        now = old + change;
        /* What rounding left out: else slow branches would stand still in single precision. */
        state->carry[b] = change - (now - old);
        state->memory[b][0] = now;
        h[0] += share_of[b] * now;
        k[0] += share_of[b] * left * of_slope;
    }
    wanted = state->stretch + (p[0] - state->pose[0]);
    if (wanted > slip_of[0]) {
        state->stretch = slip_of[0];
    } else if (wanted < -slip_of[0]) {
        state->stretch = -slip_of[0];
    } else {
        state->stretch = wanted;
        k[0] += friction_of[0];
    }
    h[0] += friction_of[0] * state->stretch;
    state->pose[0] = p[0];
    state->value = value;
    return 1;
}

int32_t @NAME@_settled(const real p[1], const inputs_t *inputs, real h[1], real k[1])
{
    const real size = size_at(inputs ? inputs : &@NAME@_default_conditions);
    @NAME@_value_and_stiffness(p, h, k);
    h[0] *= size;
    k[0] *= size;
    return is_finite(p[0] + h[0] + k[0]) ? 1 : refuse(h, k);
}

@AHEAD@