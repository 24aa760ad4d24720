/* The model @NAME@ as an instance of a co-simulation, for both versions of FMI.
 *
 * The inputs are the pose, those of actuators behind it, and temperature and age where the model has
 * effects of time; the outputs its wrench. What is read always belongs to the inputs as they are set.
 * With effects of time a step takes the way from the pose of the step before to the inputs as straight
 * and even; inputs that are changed after a step and read before the next one count as a sudden move,
 * which the next step takes back. Where actuators have a memory the inputs are the recorded ones.
 */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "@NAME@.h"

#define HAS_STATE @STEPS@
#define RECORDED @STEPSOFINPUTS@
#if RECORDED
#include "@NAME@_steps.h"
#endif
#define TOKEN "@TOKEN@"

#ifdef FUNCTION_PREFIX
#define JOINED(prefix, name) prefix##name
#define JOIN(prefix, name) JOINED(prefix, name)
#define FUNCTION(name) JOIN(FUNCTION_PREFIX, name)
#else
#define FUNCTION(name) name
#endif
#if defined _WIN32
#define API(type, name) __declspec(dllexport) type FUNCTION(name)
#else
#define API(type, name) __attribute__((visibility("default"))) type FUNCTION(name)
#endif

enum {
    POSE = @N@,
    INPUTS = POSE + 2 * HAS_STATE,
    OUTPUTS = @M@,
    /* value references */
    TIME = 0,
    FIRST_INPUT = 1,
    FIRST_OUTPUT = FIRST_INPUT + INPUTS,
    INSIDE = FIRST_OUTPUT + OUTPUTS
};

typedef struct {
    uint64_t mark; /* of this model: a stored state of another one is refused */
    double time;
    double input[INPUTS];
    double h[OUTPUTS], k[OUTPUTS * POSE];
    int32_t known; /* whether h and k belong to the inputs */
    int32_t begun;
#if HAS_STATE || RECORDED
    @NAME@_state state;
#endif
} values_t;

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } status_t;
typedef uint32_t reference_t;
typedef values_t instance_t;
typedef const char *text_t;

static status_t said(int32_t well)
{
    return well ? OK : ERROR;
}

/* An error ends the instance; where the model means nothing the answer is discarded, and it goes on. */
static status_t worse(status_t a, status_t b)
{
    return a > b ? a : b;
}

static const double start[INPUTS] = {@START@};

static void reset_values(values_t *v)
{
    memset(v, 0, sizeof *v);
    v->mark = @MARK@;
    memcpy(v->input, start, sizeof start);
}

/* A new instance; none for the token of another model, or without memory */
static instance_t *instance_of(text_t token)
{
    values_t *v = token && strcmp(token, TOKEN) == 0 ? malloc(sizeof *v) : 0;
    if (v) {
        reset_values(v);
    }
    return v;
}

/* h and k of the inputs, dt after the last step: 1, or 0 where the model means nothing */
static int32_t evaluate(values_t *v, double dt, int32_t keep)
{
    double sum = 0;
    if (!(dt >= 0 && dt - dt == 0)) {
        return 0;
    }
#if HAS_STATE
    const @NAME@_conditions inputs = {v->input[POSE], v->input[POSE + 1]};
    @NAME@_state state = v->state;
    if (!v->begun && !@NAME@_init(&state, v->input)) {
        return 0;
    }
    if (!@NAME@_step(&state, v->input, v->begun ? dt : 0, &inputs, v->h, v->k)) {
        v->known = 0;
        return 0;
    }
    if (keep) {
        v->state = state;
    }
#elif RECORDED
    @NAME@_state state = v->state;
    if (!v->begun) {
        @NAME@_init(&state, v->input);
    }
    if (!@NAME@_step(&state, v->input, v->begun ? dt : 0, v->h, v->k, 0)) {
        v->known = 0;
        return 0;
    }
    if (keep) {
        v->state = state;
    }
#else
    (void)dt;
    @NAME@_value_and_stiffness(v->input, v->h, v->k);
#endif
    if (keep) {
        v->begun = 1;
    }
    for (int32_t j = 0; j < OUTPUTS; j++) {
        sum += v->h[j] - v->h[j];
    }
    v->known = sum == 0;
    return v->known;
}

static int32_t known(values_t *v)
{
    return v->known || evaluate(v, 0, 0);
}

static int32_t set_number(values_t *v, uint32_t reference, double number)
{
    const uint32_t i = reference - FIRST_INPUT;
    if (reference < FIRST_INPUT || i >= INPUTS) {
        return 0;
    }
    if (v->input[i] != number) {
        v->input[i] = number;
        v->known = 0;
    }
    return 1;
}

static status_t get_number(values_t *v, uint32_t reference, double *number)
{
    if (reference == TIME) {
        *number = v->time;
    } else if (reference < FIRST_OUTPUT) {
        *number = v->input[reference - FIRST_INPUT];
    } else if (reference >= INSIDE) {
        return ERROR;
    } else if (known(v)) {
        *number = v->h[reference - FIRST_OUTPUT];
    } else {
        return DISCARD;
    }
    return OK;
}

/* The derivative of an output to an input at the inputs as they are set */
static status_t slope(values_t *v, uint32_t output, uint32_t input, double *found)
{
    const uint32_t j = output - FIRST_OUTPUT, i = input - FIRST_INPUT;
    if (output < FIRST_OUTPUT || j >= OUTPUTS || input < FIRST_INPUT || i >= INPUTS) {
        return ERROR;
    }
    if (!known(v)) {
        return DISCARD;
    }
    if (i < POSE) {
        *found = v->k[POSE * j + i];
    } else { /* linear in temperature and age: the difference is exact */
        values_t here = *v, more = *v;
        more.input[i] += 1;
        if (!evaluate(&here, 0, 0) || !evaluate(&more, 0, 0)) {
            return DISCARD;
        }
        *found = more.h[j] - here.h[j];
    }
    return OK;
}

/* The functions below serve arrays, as both versions of FMI do: the worst status of an element, or
 * 1, or 0 where one fails. */
static status_t get_numbers(values_t *v, const reference_t *which, size_t count, double *numbers)
{
    status_t status = OK;
    for (size_t i = 0; i < count; i++) {
        status = worse(status, get_number(v, which[i], &numbers[i]));
    }
    return status;
}

static int32_t set_numbers(values_t *v, const reference_t *which, size_t count,
                           const double *numbers)
{
    int32_t well = 1;
    for (size_t i = 0; i < count; i++) {
        well &= set_number(v, which[i], numbers[i]);
    }
    return well;
}

static int32_t get_inside(const values_t *v, const reference_t *which, size_t count,
                          int32_t *numbers)
{
    int32_t well = 1;
    for (size_t i = 0; i < count; i++) {
        well &= which[i] == INSIDE;
        numbers[i] = @NAME@_inside(v->input);
    }
    return well;
}

/* change = d unknown / d input · seed */
static status_t directional(values_t *v, const reference_t *unknown, size_t rows,
                            const reference_t *input, size_t columns, const double *seed,
                            double *change)
{
    status_t status = OK;
    for (size_t j = 0; j < rows; j++) {
        change[j] = 0;
        for (size_t i = 0; i < columns; i++) {
            double one = 0;
            status = worse(status, slope(v, unknown[j], input[i], &one));
            change[j] += one * seed[i];
        }
    }
    return status;
}

static int32_t save(const values_t *v, void **saved)
{
    if (!*saved) {
        *saved = malloc(sizeof *v);
    }
    if (*saved) {
        memcpy(*saved, v, sizeof *v);
    }
    return *saved != 0;
}

static int32_t to_bytes(const void *saved, void *bytes, size_t size)
{
    if (size != sizeof(values_t)) {
        return 0;
    }
    memcpy(bytes, saved, size);
    return 1;
}

/* A stored state of another model is refused */
static int32_t from_bytes(const values_t *v, const void *bytes, size_t size, void **saved)
{
    values_t read;
    if (size != sizeof read) {
        return 0;
    }
    memcpy(&read, bytes, size);
    return read.mark == v->mark && save(&read, saved);
}
