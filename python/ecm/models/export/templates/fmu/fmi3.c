/* FMI 3.0 for co-simulation: the functions of the standard, declared here as far as they are used.
 *
 * -DFMI3_FUNCTION_PREFIX=NAME_ puts NAME_ before each function, for FMUs that are linked statically.
 */
#include <stdbool.h>

#ifdef FMI3_FUNCTION_PREFIX
#define FUNCTION_PREFIX FMI3_FUNCTION_PREFIX
#endif
#include "instance.h"

API(text_t, fmi3GetVersion)(void) { return "3.0"; }

API(status_t, fmi3SetDebugLogging)(instance_t *v, bool on, size_t count, const text_t *categories)
{
    (void)v, (void)on, (void)count, (void)categories;
    return OK;
}

API(instance_t *, fmi3InstantiateCoSimulation)(text_t name, text_t token, text_t resources,
                                               bool visible, bool logging, bool events, bool early,
                                               const reference_t *between, size_t count,
                                               void *environment, void (*log)(void),
                                               void (*update)(void))
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early;
    (void)between, (void)count, (void)environment, (void)log, (void)update;
    return instance_of(token);
}

API(void, fmi3FreeInstance)(instance_t *v) { free(v); }

API(status_t, fmi3EnterInitializationMode)(instance_t *v, bool tolerant, double tolerance,
                                           double begin, bool ends, double end)
{
    (void)tolerant, (void)tolerance, (void)ends, (void)end;
    v->time = begin;
    return OK;
}

API(status_t, fmi3ExitInitializationMode)(instance_t *v) { return said(evaluate(v, 0, 1)); }

API(status_t, fmi3Terminate)(instance_t *v)
{
    (void)v;
    return OK;
}

API(status_t, fmi3Reset)(instance_t *v)
{
    reset_values(v);
    return OK;
}

API(status_t, fmi3GetFloat64)(instance_t *v, const reference_t *which, size_t count,
                              double *numbers, size_t room)
{
    return room == count ? get_numbers(v, which, count, numbers) : ERROR;
}

API(status_t, fmi3SetFloat64)(instance_t *v, const reference_t *which, size_t count,
                              const double *numbers, size_t room)
{
    return said(room == count && set_numbers(v, which, count, numbers));
}

API(status_t, fmi3GetInt32)(instance_t *v, const reference_t *which, size_t count,
                            int32_t *numbers, size_t room)
{
    return said(room == count && get_inside(v, which, count, numbers));
}

API(status_t, fmi3GetFMUState)(instance_t *v, void **saved)
{
    return said(save(v, saved));
}

API(status_t, fmi3SetFMUState)(instance_t *v, void *saved)
{
    memcpy(v, saved, sizeof *v);
    return OK;
}

API(status_t, fmi3FreeFMUState)(instance_t *v, void **saved)
{
    (void)v;
    free(*saved);
    *saved = 0;
    return OK;
}

API(status_t, fmi3SerializedFMUStateSize)(instance_t *v, void *saved, size_t *size)
{
    (void)saved;
    *size = sizeof *v;
    return OK;
}

API(status_t, fmi3SerializeFMUState)(instance_t *v, void *saved, uint8_t *bytes, size_t size)
{
    (void)v;
    return said(to_bytes(saved, bytes, size));
}

API(status_t, fmi3DeserializeFMUState)(instance_t *v, const uint8_t *bytes, size_t size,
                                       void **saved)
{
    return said(from_bytes(v, bytes, size, saved));
}

API(status_t, fmi3GetDirectionalDerivative)(instance_t *v, const reference_t *unknown, size_t rows,
                                            const reference_t *input, size_t columns,
                                            const double *seed, size_t seeds, double *change,
                                            size_t room)
{
    return seeds == columns && room == rows
               ? directional(v, unknown, rows, input, columns, seed, change)
               : ERROR;
}

API(status_t, fmi3GetAdjointDerivative)(instance_t *v, const reference_t *unknown, size_t rows,
                                        const reference_t *input, size_t columns,
                                        const double *seed, size_t seeds, double *change,
                                        size_t room)
{
    status_t status = said(seeds == rows && room == columns);
    for (size_t i = 0; status != ERROR && i < columns; i++) {
        change[i] = 0;
        for (size_t j = 0; j < rows; j++) {
            double one = 0;
            status = worse(status, slope(v, unknown[j], input[i], &one));
            change[i] += one * seed[j];
        }
    }
    return status;
}

/* Discarded where the model means nothing: the state and the time stay. */
API(status_t, fmi3DoStep)(instance_t *v, double time, double dt, bool no_way_back, bool *events,
                          bool *terminate, bool *early, double *last)
{
    const int32_t well = evaluate(v, dt, 1);
    (void)no_way_back;
    if (well) {
        v->time = time + dt;
    }
    *events = *terminate = *early = false;
    *last = v->time;
    return well ? OK : DISCARD;
}

/* Modes of a co-simulation without events; each is entered and left without work. */
#define MODE(name)                                                                                \
    API(status_t, name)(instance_t * v)                                                           \
    {                                                                                             \
        (void)v;                                                                                  \
        return OK;                                                                                \
    }
MODE(fmi3EnterStepMode)
MODE(fmi3EnterConfigurationMode)
MODE(fmi3ExitConfigurationMode)
MODE(fmi3EnterEventMode)
MODE(fmi3EnterContinuousTimeMode)
MODE(fmi3EvaluateDiscreteStates)

/* There are no variables of these types. */
#define NONE(name, type)                                                                          \
    API(status_t, name)(instance_t * v, const reference_t *which, size_t count, type *values,     \
                        size_t room)                                                              \
    {                                                                                             \
        (void)v, (void)which, (void)values, (void)room;                                           \
        return said(count == 0);                                                                  \
    }
#define NO_TYPE(name, type) NONE(fmi3Get##name, type) NONE(fmi3Set##name, const type)
NO_TYPE(Float32, float)
NO_TYPE(Int8, int8_t)
NO_TYPE(UInt8, uint8_t)
NO_TYPE(Int16, int16_t)
NO_TYPE(UInt16, uint16_t)
NO_TYPE(UInt32, uint32_t)
NO_TYPE(Int64, int64_t)
NO_TYPE(UInt64, uint64_t)
NO_TYPE(Boolean, bool)
NO_TYPE(String, text_t)
NONE(fmi3SetInt32, const int32_t)

/* What this FMU says that it cannot do, with the parameters of the standard. */
#if defined __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
#define NOT(name, ...)                                                                            \
    API(status_t, name)(instance_t * v, __VA_ARGS__)                                              \
    {                                                                                             \
        (void)v;                                                                                  \
        return ERROR;                                                                             \
    }
#define OF const reference_t *which, size_t count
NOT(fmi3GetBinary, OF, size_t *sizes, const uint8_t **values, size_t room)
NOT(fmi3SetBinary, OF, const size_t *sizes, const uint8_t *const *values, size_t room)
NOT(fmi3GetClock, OF, bool *values)
NOT(fmi3SetClock, OF, const bool *values)
NOT(fmi3GetOutputDerivatives, OF, const int32_t *orders, double *values, size_t room)
NOT(fmi3GetNumberOfVariableDependencies, reference_t one, size_t *count)
NOT(fmi3GetVariableDependencies, reference_t one, size_t *rows, reference_t *on, size_t *columns,
    int *kinds, size_t count)
NOT(fmi3GetIntervalDecimal, OF, double *intervals, int *qualifiers)
NOT(fmi3GetIntervalFraction, OF, uint64_t *counters, uint64_t *resolutions, int *qualifiers)
NOT(fmi3GetShiftDecimal, OF, double *shifts)
NOT(fmi3GetShiftFraction, OF, uint64_t *counters, uint64_t *resolutions)
NOT(fmi3SetIntervalDecimal, OF, const double *intervals)
NOT(fmi3SetIntervalFraction, OF, const uint64_t *counters, const uint64_t *resolutions)
NOT(fmi3SetShiftDecimal, OF, const double *shifts)
NOT(fmi3SetShiftFraction, OF, const uint64_t *counters, const uint64_t *resolutions)
NOT(fmi3UpdateDiscreteStates, bool *more, bool *terminate, bool *nominals, bool *values, bool *next,
    double *time)
NOT(fmi3CompletedIntegratorStep, bool no_way_back, bool *events, bool *terminate)
NOT(fmi3SetTime, double time)
NOT(fmi3SetContinuousStates, const double *states, size_t count)
NOT(fmi3GetContinuousStates, double *states, size_t count)
NOT(fmi3GetContinuousStateDerivatives, double *slopes, size_t count)
NOT(fmi3GetNominalsOfContinuousStates, double *nominals, size_t count)
NOT(fmi3GetEventIndicators, double *indicators, size_t count)
NOT(fmi3GetNumberOfContinuousStates, size_t *count)
NOT(fmi3GetNumberOfEventIndicators, size_t *count)
NOT(fmi3ActivateModelPartition, reference_t clock, double time)

/* Other kinds of instances. */
API(instance_t *, fmi3InstantiateModelExchange)(text_t name, text_t token, text_t resources,
                                                bool visible, bool logging, void *environment,
                                                void (*log)(void))
{
    return 0;
}

API(instance_t *, fmi3InstantiateScheduledExecution)(text_t name, text_t token, text_t resources,
                                                     bool visible, bool logging, void *environment,
                                                     void (*log)(void), void (*clock)(void),
                                                     void (*lock)(void), void (*unlock)(void))
{
    return 0;
}
