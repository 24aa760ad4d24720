/* FMI 2.0 for co-simulation: the functions of the standard, declared here as far as they are used.
 *
 * -DFMI2_FUNCTION_PREFIX=NAME_ puts NAME_ before each function, for FMUs that are linked statically.
 */
#ifdef FMI2_FUNCTION_PREFIX
#define FUNCTION_PREFIX FMI2_FUNCTION_PREFIX
#endif
#include "instance.h"

API(text_t, fmi2GetTypesPlatform)(void) { return "default"; }
API(text_t, fmi2GetVersion)(void) { return "2.0"; }

API(status_t, fmi2SetDebugLogging)(instance_t *v, int on, size_t count, const text_t *categories)
{
    (void)v, (void)on, (void)count, (void)categories;
    return OK;
}

API(instance_t *, fmi2Instantiate)(text_t name, int type, text_t token, text_t resources,
                                   const void *functions, int visible, int logging)
{
    (void)name, (void)resources, (void)functions, (void)visible, (void)logging;
    return type == 1 ? instance_of(token) : 0;
}

API(void, fmi2FreeInstance)(instance_t *v) { free(v); }

API(status_t, fmi2SetupExperiment)(instance_t *v, int tolerant, double tolerance, double begin,
                                   int ends, double end)
{
    (void)tolerant, (void)tolerance, (void)ends, (void)end;
    v->time = begin;
    return OK;
}

API(status_t, fmi2EnterInitializationMode)(instance_t *v)
{
    (void)v;
    return OK;
}

API(status_t, fmi2ExitInitializationMode)(instance_t *v) { return said(evaluate(v, 0, 1)); }

API(status_t, fmi2Terminate)(instance_t *v)
{
    (void)v;
    return OK;
}

API(status_t, fmi2Reset)(instance_t *v)
{
    reset_values(v);
    return OK;
}

API(status_t, fmi2GetReal)(instance_t *v, const reference_t *which, size_t count, double *numbers)
{
    return get_numbers(v, which, count, numbers);
}

API(status_t, fmi2SetReal)(instance_t *v, const reference_t *which, size_t count,
                           const double *numbers)
{
    return said(set_numbers(v, which, count, numbers));
}

API(status_t, fmi2GetInteger)(instance_t *v, const reference_t *which, size_t count, int *numbers)
{
    return said(get_inside(v, which, count, numbers));
}

/* There are no variables of these types. */
#define NONE(name, type)                                                                          \
    API(status_t, name)(instance_t * v, const reference_t *which, size_t count, type *values)     \
    {                                                                                             \
        (void)v, (void)which, (void)values;                                                       \
        return said(count == 0);                                                                  \
    }
NONE(fmi2GetBoolean, int)
NONE(fmi2GetString, text_t)
NONE(fmi2SetInteger, const int)
NONE(fmi2SetBoolean, const int)
NONE(fmi2SetString, const text_t)

API(status_t, fmi2GetFMUstate)(instance_t *v, void **saved)
{
    return said(save(v, saved));
}

API(status_t, fmi2SetFMUstate)(instance_t *v, void *saved)
{
    memcpy(v, saved, sizeof *v);
    return OK;
}

API(status_t, fmi2FreeFMUstate)(instance_t *v, void **saved)
{
    (void)v;
    free(*saved);
    *saved = 0;
    return OK;
}

API(status_t, fmi2SerializedFMUstateSize)(instance_t *v, void *saved, size_t *size)
{
    (void)saved;
    *size = sizeof *v;
    return OK;
}

API(status_t, fmi2SerializeFMUstate)(instance_t *v, void *saved, char *bytes, size_t size)
{
    (void)v;
    return said(to_bytes(saved, bytes, size));
}

API(status_t, fmi2DeSerializeFMUstate)(instance_t *v, const char *bytes, size_t size, void **saved)
{
    return said(from_bytes(v, bytes, size, saved));
}

API(status_t, fmi2GetDirectionalDerivative)(instance_t *v, const reference_t *unknown, size_t rows,
                                            const reference_t *input, size_t columns,
                                            const double *seed, double *change)
{
    return directional(v, unknown, rows, input, columns, seed, change);
}

API(status_t, fmi2SetRealInputDerivatives)(instance_t *v, const reference_t *which, size_t count,
                                           const int *order, const double *numbers)
{
    (void)v, (void)which, (void)order, (void)numbers;
    return said(count == 0);
}

API(status_t, fmi2GetRealOutputDerivatives)(instance_t *v, const reference_t *which, size_t count,
                                            const int *order, double *numbers)
{
    (void)v, (void)which, (void)order, (void)numbers;
    return said(count == 0);
}

/* Discarded where the model means nothing: the state and the time stay. */
API(status_t, fmi2DoStep)(instance_t *v, double time, double dt, int no_way_back)
{
    (void)no_way_back;
    if (!evaluate(v, dt, 1)) {
        return DISCARD;
    }
    v->time = time + dt;
    return OK;
}

API(status_t, fmi2CancelStep)(instance_t *v)
{
    (void)v;
    return ERROR;
}

API(status_t, fmi2GetRealStatus)(instance_t *v, int kind, double *number)
{
    *number = v->time;
    return kind == 2 ? OK : DISCARD;
}

/* A step is finished when it returns. */
#define UNSAID(name, type)                                                                        \
    API(status_t, name)(instance_t * v, int kind, type *value)                                    \
    {                                                                                             \
        (void)v, (void)kind, (void)value;                                                         \
        return DISCARD;                                                                           \
    }
UNSAID(fmi2GetStatus, status_t)
UNSAID(fmi2GetIntegerStatus, int)
UNSAID(fmi2GetBooleanStatus, int)
UNSAID(fmi2GetStringStatus, text_t)
