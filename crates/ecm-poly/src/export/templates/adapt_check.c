/* Runs @NAME@_adapt through golden readings; exits 0 where all agree. */
#include "@NAME@.h"
#include "@NAME@_adapt.h"

#define R(x) ((@NAME@_adapt_real)(x))
enum { READINGS = @READINGS@, COUNT = @COUNT@ };

/* Pose, wrench, seconds since the reading before. */
static const @NAME@_adapt_real reading[READINGS][13] = {
    @READINGLIST@};
static const uint8_t outcome[READINGS] = {@OUTCOMES@};
static const @NAME@_adapt_real values[READINGS][COUNT] = {
    @VALUES@};
static const @NAME@_adapt_real variances[READINGS][COUNT] = {
    @VARIANCES@};

static int differs(@NAME@_adapt_real a, @NAME@_adapt_real b, @NAME@_adapt_real size)
{
    const @NAME@_adapt_real e = a - b, most = @TOLERANCE@ * size;
    return !(e <= most && e >= -most);
}

/* One reading; the outcome. */
static int32_t read_one(@NAME@_adapt_state *state, int32_t i)
{
    @NAME@_adapt_real h[6], k[36], branches[12];
    @NAME@_value_and_stiffness(reading[i], h, k);
    for (int32_t a = 0; a < 6; a++) {
        branches[a] = R(0.3) * h[a];
        branches[6 + a] = R(0.1) * h[(a + 1) % 6];
    }
    return @NAME@_adapt(state, 0, reading[i], reading[i] + 6, reading[i][12], h, k, branches);
}

int main(void)
{
    @NAME@_adapt_state state, saved;
    int wrong = 0;
    @NAME@_adapt_init(&state, 0);
    for (int32_t i = 0; i < READINGS; i++) {
        @NAME@_adapt_real none[6] = {0}, h[6], k[36];
        saved = state;
        wrong += read_one(&state, i) != (int32_t)outcome[i];
        wrong += read_one(&saved, i) != (int32_t)outcome[i];
        for (int32_t j = 0; j < COUNT; j++) {
            const @NAME@_adapt_real sd = @NAME@_adapt_defaults.priors[j].sd;
            wrong += differs(state.values[j], values[i][j], sd);
            wrong += differs(state.covariance[j][j], variances[i][j], sd * sd);
            wrong += state.values[j] != saved.values[j];
            wrong += state.covariance[j][0] != saved.covariance[j][0];
        }
        none[0] /= none[0];
        @NAME@_value_and_stiffness(reading[i], h, k);
        wrong += @NAME@_adapt(&state, 0, none, reading[i] + 6, reading[i][12], h, k, 0) != @NAME@_refused;
        wrong += @NAME@_adapt(&state, 0, reading[i], reading[i] + 6, none[1], h, k, 0) != @NAME@_refused;
        for (int32_t j = 0; j < COUNT; j++) {
            wrong += state.values[j] != saved.values[j];
        }
    }
    return wrong > 0;
}
