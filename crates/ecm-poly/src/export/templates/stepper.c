
/* Effects of time along @N@ coordinates q; Q: force to q of the static wrench. Matrices row by row. */

typedef @NAME@_state state_t;
typedef @NAME@_conditions inputs_t;

static const real stiffness_at_rest[@NM@] = {@STIFFNESS@};
static const real share_of[2] = {@SHARES@};
static const real tau_of[2] = {@TAUS@};
static const real linear_of[2] = {@LINEAR@};
static const real friction_of[@NM@] = {@FRICTION@};
static const real slip_of[@N@] = {@SLIP@};
static const real play_of[@N@] = {@PLAY@};
static const real softer_per_kelvin = R(@WARMER@), ageing_per_s = R(@AGEING@);
static const real settling_per_s = R(@SETTLING@), growth_per_kelvin = R(@GROWTH@);
static const real softening = R(@SOFTENING@), set_share = R(@SETSHARE@);
/* Largest loads are measured as W^2 = |a (p - p0)|^2 + |b h|^2; where a and b are 0 as the work. */
static const real softening_width = R(@SOFTWIDTH@), load_of_pose[@N@] = {@LOADOFPOSE@};
static const real load_of_wrench[@M@] = {@LOADOFWRENCH@};
enum { HYPERBOLIC = @HYPERBOLIC@, BY_WORK = @BYWORK@ };
static const real damping_of[@NM@] = {@DAMPING@};
static const real farthest_of[] = {@FARTHEST@};
/* 1 for an angle of p, or a moment of h */
static const uint8_t is_angle[@N@] = {@ANGLES@}, is_moment[@M@] = {@MOMENTS@};
/* Of a load that does work p and h go in pairs. */
enum { PAIRS = @PAIRS@ };
/* Whether stiffness, friction and damping couple coordinates: in a frame they are diagonal. */
enum { COUPLED = @COUPLED@, DAMPED = @DAMPED@ };
/* Whether springs slip as one, where the length of their stretches over these limits is 1. */
enum { TOGETHER = @TOGETHER@ };
/* Springs side by side, which slip one after the other; and whether they follow p and act on h. */
enum { SPRINGS = @SPRINGS@, OF_POSE = @OFPOSE@ };

@DECAY@

@CONDITIONS@
@FRAME@
/* The static map at a pose: Q, dQ/dq, h, and the load W. */
typedef struct {
    frame_t frame;
    real force[@M@], u[@NM@], h[@M@], away[@N@], load, sign;
} here_t;

/* Of twelve lengths the sum is at most sqrt(12) times the root: seven steps have all digits. */
static real root_of(real square, real sum)
{
    for (int32_t i = 0; i < 7 && sum > R(0); i++) {
        sum = R(0.5) * (sum + square / sum);
    }
    return sum;
}

/* W of lengths. */
static real load_at(const here_t *here)
{
    real square = R(0), load = R(0);
    for (int32_t i = 0; i < @N@; i++) {
        const real x = load_of_pose[i] * here->away[i];
        square += x * x;
        load += x < R(0) ? -x : x;
    }
    for (int32_t i = 0; i < @M@; i++) {
        const real x = load_of_wrench[i] * here->h[i];
        square += x * x;
        load += x < R(0) ? -x : x;
    }
    return root_of(square, load);
}

static int32_t find_here(const real *p, here_t *here)
{
    real sum, product = R(0);
    static_at(p, &here->frame, here->force, here->u);
    wrench_of(&here->frame, here->force, here->h);
    sum = here->frame.refused;
    for (int32_t i = 0; i < @N@; i++) {
        here->away[i] = p[i] - (i == 0 ? length_m : R(0));
    }
    for (int32_t i = 0; i < PAIRS; i++) {
        product += here->away[i] * here->h[i];
    }
    for (int32_t i = 0; i < @M@; i++) {
        sum += here->h[i];
    }
    here->sign = product < R(0) ? R(-1) : R(1);
    here->load = BY_WORK ? R(0.5) * here->sign * product : load_at(here);
    return is_finite(sum) && is_near(here->frame.q);
}

/* K of a pose that is below the largest load: k += factor h dW/dp */
static void soften(const real *p, const here_t *here, real factor, real *k)
{
    real h[@M@], slope[@NM@], by_pose[@N@], by_wrench[@M@];
    const real size = BY_WORK ? R(2) * here->sign : here->load;
    if (!(size * size > R(0))) {
        return;
    }
    @NAME@_value_and_stiffness(p, h, slope);
    for (int32_t j = 0; j < @N@; j++) {
        by_pose[j] = load_of_pose[j] * load_of_pose[j] * here->away[j];
    }
    for (int32_t i = 0; i < @M@; i++) {
        by_wrench[i] = load_of_wrench[i] * load_of_wrench[i] * h[i];
    }
    /* Of work these are zero. */
    for (int32_t i = 0; i < PAIRS && BY_WORK; i++) {
        by_pose[i] = h[i];
        by_wrench[i] = here->away[i];
    }
    for (int32_t j = 0; j < @N@; j++) {
        real along = by_pose[j];
        for (int32_t i = 0; i < @M@; i++) {
            along += slope[@N@ * i + j] * by_wrench[i];
        }
        for (int32_t i = 0; i < @M@; i++) {
            k[@N@ * i + j] += factor * h[i] * along / size;
        }
    }
}

/* The share g that is lost below the largest load, and how fast it falls with the load */
static real lost_below(real load, real largest, real *falls)
{
    const real below = largest - load, all = below + softening_width;
    real lost, left;
    *falls = R(0);
    if (!(largest > R(0))) {
        return R(0);
    }
    if (!(softening_width > R(0))) {
        *falls = R(1) / largest;
        return R(1) - load / largest;
    }
    if (HYPERBOLIC) {
        *falls = softening_width / (all * all);
        return below / all;
    }
    /* tanh x of 1 - exp(-2 x) */
    decay(R(2) * below / softening_width, &lost, &left);
    lost /= R(2) - lost;
    *falls = (R(1) - lost * lost) / softening_width;
    return lost;
}

/* h and its derivative at the pose less the set, which grows at the farthest pose; 0 where it is refused */
static int32_t after_set(const state_t *state, const real *p, int32_t grows, real *h, real *k)
{
    real shifted[@N@], sum = R(0);
    for (int32_t i = 0; i < @N@; i++) {
        shifted[i] = p[i] - set_share * (grows ? p[i] : state->farthest[i]);
    }
    shifted[0] += set_share * length_m;
    @NAME@_value_and_stiffness(shifted, h, k);
    for (int32_t i = 0; i < @M@; i++) {
        sum += h[i];
    }
    for (int32_t i = 0; i < @NM@; i++) {
        k[i] *= grows ? R(1) - set_share : R(1);
    }
    return is_finite(sum);
}

/* Size of the body over that at the reference */
static real grown(const inputs_t *inputs)
{
    return R(1) + growth_per_kelvin * (inputs->temperature_degC - R(@REFERENCE@));
}

/* The pose at which the body, had it not grown, would be deformed as it is at this one */
static const real *ungrown(const real *p, const inputs_t *inputs, real *own)
{
    const real size = grown(inputs);
    if (!(growth_per_kelvin * growth_per_kelvin > R(0))) {
        return p;
    }
    for (int32_t i = 0; i < @N@; i++) {
        own[i] = is_angle[i] ? p[i] : p[i] / size;
    }
    return own;
}

/* h and k of the grown body, from those at the pose of `ungrown` */
static void regrow(const inputs_t *inputs, real *h, real *k)
{
    const real size = grown(inputs);
    if (!(growth_per_kelvin * growth_per_kelvin > R(0))) {
        return;
    }
    for (int32_t i = 0; i < @M@; i++) {
        const real power = is_moment[i] ? size * size * size : size * size;
        h[i] *= power;
        for (int32_t j = 0; j < @N@; j++) {
            k[@N@ * i + j] *= is_angle[j] ? power : power / size;
        }
    }
}

/* Change of the pose since the last step; not at all where q is the same. */
static void moved_since(const state_t *state, const real *q, real *moved)
{
    real before[@N@];
    pose_of(q, moved);
    pose_of(state->coordinates, before);
    for (int32_t i = 0; i < @N@; i++) {
        moved[i] -= before[i];
    }
}

/* Whether what is remembered is numbers: a state that was loaded may be damaged. */
static int32_t is_known(const state_t *state)
{
    real sum = state->largest;
    for (int32_t i = 0; i < @N@; i++) {
        sum += state->farthest[i] + state->coordinates[i];
        for (int32_t s = 0; s < SPRINGS; s++) {
            sum += state->stretch[s][i];
        }
    }
    for (int32_t i = 0; i < @M@; i++) {
        sum += state->force[i];
        for (int32_t b = 0; b < 2; b++) {
            sum += state->memory[b][i] + state->carry[b][i];
        }
    }
    return is_finite(sum);
}

/* NaN in all results. */
static int32_t refuse(real *h, real *k)
{
    real none = R(0);
    none /= none;
    for (int32_t i = 0; i < @M@; i++) {
        h[i] = none;
    }
    for (int32_t i = 0; i < @NM@; i++) {
        k[i] = none;
    }
    return 0;
}

static real limited(real x, real limit)
{
    if (x > limit) {
        return limit;
    }
    return x < -limit ? -limit : x;
}

/* Springs that slip at a share of the limits, stretched on by a path; what they pull and hold. */
static void stretch_on(real *z, const real *path, real size, real *pulls, real *grips, real *turns)
{
    const real part = R(1) / (real)SPRINGS;
    real squares = R(0), sizes = R(0), over;
    for (int32_t j = 0; j < @N@; j++) {
        if (TOGETHER && slip_of[j] > R(0)) {
            const real share = (z[j] + path[j]) / slip_of[j];
            squares += share * share;
            sizes += share < R(0) ? -share : share;
        }
    }
    over = root_of(squares, sizes);
    for (int32_t j = 0; j < @N@; j++) {
        const real wanted = z[j] + path[j], limit = size * slip_of[j], play = size * play_of[j];
        /* Where nothing moves rounding is no slip. */
        if (over > R(1.00001) && slip_of[j] > R(0)) {
            z[j] = pulls[j] = wanted / over;
            grips[j] = R(1) / over;
            turns[j] = wanted / (over * over * slip_of[j] * slip_of[j]);
            continue;
        }
        z[j] = limited(wanted, limit);
        pulls[j] += part * (z[j] - limited(z[j], play));
        grips[j] += part * (real)(-limit <= wanted && wanted <= limit
                                  && !(-play < z[j] && z[j] < play));
    }
}

int32_t @NAME@_init(state_t *state, const real p[@N@])
{
    here_t here;
    if (!find_here(p, &here)) {
        return 0;
    }
    for (int32_t i = 0; i < @N@; i++) {
        state->farthest[i] = p[i];
        state->coordinates[i] = here.frame.q[i];
        for (int32_t s = 0; s < SPRINGS; s++) {
            state->stretch[s][i] = R(0);
        }
    }
    for (int32_t i = 0; i < @M@; i++) {
        state->force[i] = here.force[i];
        for (int32_t b = 0; b < 2; b++) {
            state->memory[b][i] = R(0);
            state->carry[b][i] = R(0);
        }
    }
    state->largest = here.load;
    return 1;
}

int32_t @NAME@_step(state_t *state, const real p[@N@], real dt, const inputs_t *inputs,
                    real h[@M@], real k[@NM@])
{
    here_t here;
    real lost[2], left[2], total[@M@], steep[@NM@] = {R(0)}, set_h[@M@], set_k[@NM@];
    real along[@N@], pulls[@N@], grips[@N@], turns[@N@] = {R(0)};
    real own[@N@], moved[@N@] = {R(0)}, elastic = R(0), falls, size, slope[@NM@];
    int32_t grows;
    const int32_t sets = set_share * set_share > R(0);
    k = k ? k : slope;
    inputs = inputs ? inputs : &@NAME@_default_conditions;
    size = size_at(inputs);
    p = ungrown(p, inputs, own);
    if (!(dt >= R(0) && is_finite(dt + size) && is_known(state) && find_here(p, &here))) {
        return refuse(h, k);
    }
    grows = here.load > state->largest;
    if (sets && !after_set(state, p, grows, set_h, set_k)) {
        return refuse(h, k);
    }
    for (int32_t b = 0; b < 2; b++) {
        decay(dt / tau_of[b], &lost[b], &left[b]);
        elastic += (R(1) - linear_of[b]) * share_of[b] * left[b];
    }
    for (int32_t j = 0; j < @N@; j++) {
        along[j] = here.frame.q[j] - state->coordinates[j];
        pulls[j] = grips[j] = R(0);
    }
    if (DAMPED || OF_POSE) {
        moved_since(state, here.frame.q, moved);
    }
    for (int32_t s = 0; s < SPRINGS; s++) {
        stretch_on(state->stretch[s], OF_POSE ? moved : along, (real)(2 * s + 1) / (real)SPRINGS,
                   pulls, grips, turns);
    }
    for (int32_t i = 0; i < @M@; i++) {
        const real *stiffness = stiffness_at_rest + @N@ * i, *friction = friction_of + @N@ * i;
        const real driven = here.force[i] - state->force[i];
        const int32_t first = COUPLED ? 0 : i, end = COUPLED ? @N@ : i + 1;
        real linear = R(0), pulled = R(0);
        for (int32_t j = first; j < end; j++) {
            linear += stiffness[j] * along[j];
            pulled += friction[j] * pulls[j];
        }
        total[i] = R(0);
        for (int32_t b = 0; b < 2; b++) {
            const real x = linear_of[b] > R(0) ? linear : driven;
            const real old = state->memory[b][i];
            const real change = (left[b] * x - lost[b] * old) + state->carry[b][i];
            const real now = old + change;
            /* What rounding left out: else slow branches would stand still in single precision. */
            state->carry[b][i] = change - (now - old);
            state->memory[b][i] = now;
            total[i] += share_of[b] * now;
            for (int32_t j = first; j < end; j++) {
                steep[@N@ * i + j] += linear_of[b] * share_of[b] * left[b] * stiffness[j];
            }
        }
        for (int32_t j = first; j < end && !OF_POSE; j++) {
            steep[@N@ * i + j] += friction[j] * grips[j] - pulled * turns[j];
        }
        total[i] += OF_POSE ? R(0) : pulled;
    }
    if (grows) {
        state->largest = here.load;
    }
    /* With a set the wrench at the pose less the set stands for that at the pose. */
    size -= softening * lost_below(here.load, state->largest, &falls) + (sets ? R(1) : R(0));
    for (int32_t i = 0; i < @M@; i++) {
        total[i] += size * here.force[i];
    }
    for (int32_t i = 0; i < @NM@; i++) {
        steep[i] += (size + elastic) * here.u[i];
    }
    carried(&here.frame, total, steep, h, k);
    for (int32_t i = 0; i < @M@ && OF_POSE; i++) {
        for (int32_t j = COUPLED ? 0 : i; j < (COUPLED ? @N@ : i + 1); j++) {
            h[i] += friction_of[@N@ * i + j] * pulls[j];
            k[@N@ * i + j] += friction_of[@N@ * i + j] * grips[j];
        }
    }
    if (state->largest > here.load && softening * softening > R(0)) {
        soften(p, &here, softening * falls, k);
    }
    if (sets) {
        for (int32_t i = 0; i < @M@; i++) {
            h[i] += set_h[i];
        }
        for (int32_t i = 0; i < @NM@; i++) {
            k[i] += set_k[i];
        }
    }
    for (int32_t i = 0; i < @M@ && DAMPED; i++) {
        const int32_t first = COUPLED ? 0 : i, end = COUPLED ? @N@ : i + 1;
        for (int32_t j = first; j < end; j++) {
            const real damping = dt > R(0) ? damping_of[@N@ * i + j] / dt : R(0);
            /* A dt so short that this overflows is a sudden move as well. */
            if (is_finite(damping)) {
                h[i] += damping * moved[j];
                k[@N@ * i + j] += damping;
            }
        }
    }
    for (int32_t j = 0; j < @N@; j++) {
        if (grows) {
            state->farthest[j] = p[j];
        }
        state->coordinates[j] = here.frame.q[j];
    }
    for (int32_t i = 0; i < @M@; i++) {
        state->force[i] = here.force[i];
    }
    regrow(inputs, h, k);
    return 1;
}

void @NAME@_branches(const state_t *state, real wrenches[2 * @M@])
{
    frame_t f;
    real p[@N@];
    pose_of(state->coordinates, p);
    prepare(p, &f);
    wrench_of(&f, state->memory[0], wrenches);
    wrench_of(&f, state->memory[1], wrenches + @M@);
}

int32_t @NAME@_settled(const real p[@N@], const inputs_t *inputs, real h[@M@], real k[@NM@])
{
    real own[@N@], size, sum, slope[@NM@];
    k = k ? k : slope;
    inputs = inputs ? inputs : &@NAME@_default_conditions;
    sum = size = size_at(inputs);
    @NAME@_value_and_stiffness(ungrown(p, inputs, own), h, k);
    for (int32_t i = 0; i < @M@; i++) {
        h[i] *= size;
        sum += h[i];
    }
    for (int32_t i = 0; i < @NM@; i++) {
        k[i] *= size;
    }
    regrow(inputs, h, k);
    return is_finite(sum) ? 1 : refuse(h, k);
}

@AHEAD@