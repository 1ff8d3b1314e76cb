/* FMI 3.0 functions for variable types and abilities that the FMU does not have: the standard wants all exported. */
#include <stdlib.h>

#include "fmi3Functions.h"

static fmi3Status only_without_variables(size_t n) { return n == 0 ? fmi3OK : fmi3Error; }

#define NO_VARIABLES(type)                                                                                     \
    fmi3Status fmi3Get##type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##type value[],       \
                             size_t n_values) {                                                                \
        (void)c, (void)vr, (void)value, (void)n_values;                                                        \
        return only_without_variables(n);                                                                      \
    }                                                                                                          \
    fmi3Status fmi3Set##type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##type value[], \
                             size_t n_values) {                                                                \
        (void)c, (void)vr, (void)value, (void)n_values;                                                        \
        return only_without_variables(n);                                                                      \
    }

NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(Int32)
NO_VARIABLES(UInt32)
NO_VARIABLES(Int64)
NO_VARIABLES(UInt64)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)

#define VR const fmi3ValueReference vr[], size_t n
#define UNUSED(...)                    \
    {                                  \
        (void)c, __VA_ARGS__;          \
        return only_without_variables(n); \
    }
#define REFUSED(...)          \
    {                         \
        (void)c, __VA_ARGS__; \
        return fmi3Error;     \
    }

fmi3Status fmi3GetBinary(fmi3Instance c, VR, size_t sizes[], fmi3Binary value[], size_t m)
UNUSED((void)vr, (void)sizes, (void)value, (void)m)
fmi3Status fmi3SetBinary(fmi3Instance c, VR, const size_t sizes[], const fmi3Binary value[], size_t m)
UNUSED((void)vr, (void)sizes, (void)value, (void)m)
fmi3Status fmi3GetClock(fmi3Instance c, VR, fmi3Clock value[])
UNUSED((void)vr, (void)value)
fmi3Status fmi3SetClock(fmi3Instance c, VR, const fmi3Clock value[])
UNUSED((void)vr, (void)value)
fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, VR, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
UNUSED((void)vr, (void)intervals, (void)qualifiers)
fmi3Status fmi3GetIntervalFraction(fmi3Instance c, VR, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[])
UNUSED((void)vr, (void)counters, (void)resolutions, (void)qualifiers)
fmi3Status fmi3GetShiftDecimal(fmi3Instance c, VR, fmi3Float64 shifts[])
UNUSED((void)vr, (void)shifts)
fmi3Status fmi3GetShiftFraction(fmi3Instance c, VR, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
UNUSED((void)vr, (void)counters, (void)resolutions)
fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, VR, const fmi3Float64 intervals[])
UNUSED((void)vr, (void)intervals)
fmi3Status fmi3SetIntervalFraction(fmi3Instance c, VR, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
UNUSED((void)vr, (void)counters, (void)resolutions)
fmi3Status fmi3SetShiftDecimal(fmi3Instance c, VR, const fmi3Float64 shifts[])
UNUSED((void)vr, (void)shifts)
fmi3Status fmi3SetShiftFraction(fmi3Instance c, VR, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
UNUSED((void)vr, (void)counters, (void)resolutions)
fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, VR, const fmi3Int32 orders[], fmi3Float64 value[], size_t m)
UNUSED((void)vr, (void)orders, (void)value, (void)m)

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference vr, size_t *n)
REFUSED((void)vr, (void)n)
fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent, size_t elements[],
                                       fmi3ValueReference independents[], size_t independent_elements[],
                                       fmi3DependencyKind kinds[], size_t n)
REFUSED((void)dependent, (void)elements, (void)independents, (void)independent_elements, (void)kinds, (void)n)
fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
REFUSED((void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)n_seed, (void)sensitivity,
        (void)n_sensitivity)
fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) { (void)c; return fmi3Error; }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) { (void)c; return fmi3Error; }
fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) { (void)c; return fmi3Error; }

/* Model exchange and scheduled execution are not offered. */

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    if (log) log(environment, fmi3Error, "logStatusError", "The FMU is for co-simulation only.");
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)update, (void)lock, (void)unlock;
    if (log) log(environment, fmi3Error, "logStatusError", "The FMU is for co-simulation only.");
    return NULL;
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
REFUSED((void)clock, (void)time)
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) { (void)c; return fmi3Error; }
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean no_rollback, fmi3Boolean *event, fmi3Boolean *terminate)
REFUSED((void)no_rollback, (void)event, (void)terminate)
fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time)
REFUSED((void)time)
fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n)
UNUSED((void)x)
fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n)
UNUSED((void)x)
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 dx[], size_t n)
UNUSED((void)dx)
fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 indicators[], size_t n)
UNUSED((void)indicators)
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominals[], size_t n)
UNUSED((void)nominals)
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n)
REFUSED((void)n)
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n)
REFUSED((void)n)
