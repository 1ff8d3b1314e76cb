/* FMI 2.0 co-simulation API of a sampled model.
 *
 * In FMI 2.0 an output may be read only after a step, and the input of a communication point is set after that. At a
 * sample instant the client therefore sees C x[k] + D u[k-1]: the feed-through is one sample late.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "sampled_force.h"

typedef struct {
    force_state state;
    fmi2CallbackFunctions callbacks;
    char *name;
    bool not_finite_logged;
} instance;

/* `self`, or an error where an importer has none. */
#define INSTANCE        \
    instance *self = c; \
    if (!self) return fmi2Error;

static void message(const instance *self, fmi2Status status, const char *text) {
    static const char *const CATEGORIES[] = {"logAll", "logStatusWarning", "logStatusDiscard", "logStatusError"};
    if (self && self->callbacks.logger) {
        /* No text has a '%': importers that do not format, as those in C# cannot, show it too. */
        self->callbacks.logger(self->callbacks.componentEnvironment, self->name, status, CATEGORIES[status], text);
    }
}

static fmi2Status failed(const instance *self, const char *text) {
    message(self, fmi2Error, text);
    return fmi2Error;
}

/* One warning per series of values that are not finite: logging has no place in every step. */
static fmi2Status not_finite(instance *self, const char *text) {
    if (!self->not_finite_logged) message(self, fmi2Warning, text);
    self->not_finite_logged = true;
    return fmi2Warning;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)c, (void)on, (void)n, (void)categories; /* warnings and errors alone are logged, and always */
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    (void)resources, (void)visible, (void)logging;
    if (!functions) return NULL;
    instance refused = {.callbacks = *functions, .name = (char *)"lumbar"};
    if (!name || !*name) return failed(&refused, "The instance needs a name."), NULL;
    if (type != fmi2CoSimulation) return failed(&refused, "The FMU is for co-simulation only."), NULL;
    if (!guid || strcmp(guid, MODEL.token) != 0) {
        return failed(&refused, "The GUID is not that of this FMU: binary and modelDescription.xml differ."), NULL;
    }
    instance *self = calloc(1, sizeof *self);
    char *copy = malloc(strlen(name) + 1);
    if (!self || !copy) {
        free(self);
        free(copy);
        return failed(&refused, "Out of memory."), NULL;
    }
    strcpy(copy, name);
    self->name = copy;
    self->callbacks = *functions;
    force_reset(&self->state, false);
    return self;
}

void fmi2FreeInstance(fmi2Component c) {
    instance *self = c;
    if (!self) return;
    free(self->name);
    free(self);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop) {
    INSTANCE
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    if (self->state.mode != MODE_INSTANTIATED) return failed(self, "fmi2SetupExperiment after initialization.");
    if (!isfinite(start)) return failed(self, "fmi2SetupExperiment: the start time is not finite.");
    self->state.start_time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    INSTANCE
    if (self->state.mode != MODE_INSTANTIATED) return failed(self, "fmi2EnterInitializationMode called twice.");
    force_start(&self->state, self->state.start_time); /* finite: fmi2SetupExperiment saw to it */
    self->state.mode = MODE_INITIALIZATION;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    INSTANCE
    if (self->state.mode != MODE_INITIALIZATION) return failed(self, "The instance is not in initialization mode.");
    self->state.mode = MODE_STEP;
    if (MODEL.feedthrough || MODEL.guarded) {
        message(self, fmi2Warning,
                MODEL.waits_for_input || MODEL.guarded
                    ? "FMI 2.0: the force read is that of the sample before (documentation/index.html); the FMI 3.0 "
                      "FMU with event mode has none of this delay."
                    : "FMI 2.0: the feed-through from position to force is one sample late, C x[k] + D u[k-1] "
                      "(documentation/index.html); the FMI 3.0 FMU with event mode has none of this delay.");
    }
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) {
    INSTANCE
    self->state.mode = MODE_TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    INSTANCE
    force_reset(&self->state, false);
    self->not_finite_logged = false;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    INSTANCE
    for (size_t i = 0; i < n; ++i) {
        if (vr[i] == VR_TIME || force_get(&self->state, vr[i], &value[i]) != VALUE_OK) {
            return failed(self, "fmi2GetReal: unknown value reference.");
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    INSTANCE
    fmi2Status status = fmi2OK;
    if (self->state.mode == MODE_TERMINATED) return failed(self, "fmi2SetReal after fmi2Terminate.");
    for (size_t i = 0; i < n; ++i) {
        switch (force_set(&self->state, vr[i], value[i])) {
            case VALUE_OK:
#if MODEL_AXES > 1
#else /* one axis */
                if (vr[i] == VR_INPUT) self->not_finite_logged = false;
#endif /* MODEL_AXES */
                break;
            case VALUE_NOT_FINITE:
                status = not_finite(self, "The input is not finite: the last finite value is kept.");
                break;
            case VALUE_OUT_OF_RANGE: return failed(self, "fmi2SetReal: the value is outside min and max; not set.");
            case VALUE_NOT_SETTABLE: return failed(self, "fmi2SetReal: an output cannot be set.");
            default: return failed(self, "fmi2SetReal: unknown value reference.");
        }
    }
#if MODEL_AXES > 1
    if (status == fmi2OK) self->not_finite_logged = false;
    return status;
#else /* one axis */
    return status;
#endif /* MODEL_AXES */
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real from, fmi2Real step, fmi2Boolean no_rollback) {
    INSTANCE
    (void)no_rollback;
    if (self->state.mode != MODE_STEP) return failed(self, "fmi2DoStep before initialization or after termination.");
    switch (force_advance(&self->state, from, step, false)) {
        case STEP_OK: return fmi2OK;
        case STEP_NOT_FINITE: return not_finite(self, "The model's force is not finite: the last finite force is kept.");
        case STEP_TOO_LONG: return failed(self, "fmi2DoStep: the step passes more than 1e7 samples.");
        default: return failed(self, "fmi2DoStep: step not positive, or not from where the last one ended.");
    }
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *saved) {
    INSTANCE
    if (!saved) return failed(self, "fmi2GetFMUstate: no place for it given.");
    if (!*saved) *saved = calloc(1, sizeof(force_state));
    if (!*saved) return failed(self, "Out of memory.");
    memcpy(*saved, &self->state, sizeof(force_state));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate saved) {
    INSTANCE
    if (!saved) return failed(self, "fmi2SetFMUstate: no state given.");
    memcpy(&self->state, saved, sizeof(force_state));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *saved) {
    (void)c;
    if (!saved) return fmi2OK; /* as the standard has it */
    free(*saved);
    *saved = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate saved, size_t *size) {
    (void)c, (void)saved;
    *size = force_serialized_size();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate saved, fmi2Byte bytes[], size_t size) {
    INSTANCE
    if (!saved || !bytes || size < force_serialized_size()) return failed(self, "fmi2SerializeFMUstate: no state or no room.");
    force_serialize(saved, (uint8_t *)bytes);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *saved) {
    INSTANCE
    force_state state;
    if (!bytes || !saved || !force_deserialize(&state, (const uint8_t *)bytes, size)) {
        return failed(self, "fmi2DeSerializeFMUstate: these bytes are no state of this FMU, or damaged.");
    }
    if (!*saved) *saved = calloc(1, sizeof(force_state));
    if (!*saved) return failed(self, "Out of memory.");
    memcpy(*saved, &state, sizeof state);
    return fmi2OK;
}

/* What the FMU has no variables or abilities for. */

#define NO_VARIABLES(function, type)                                                                         \
    fmi2Status function(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[]) {             \
        (void)vr, (void)value;                                                                               \
        return n == 0 ? fmi2OK : failed(c, #function ": all variables are of type Real.");                   \
    }

NO_VARIABLES(fmi2GetInteger, fmi2Integer)
NO_VARIABLES(fmi2GetBoolean, fmi2Boolean)
NO_VARIABLES(fmi2GetString, fmi2String)
NO_VARIABLES(fmi2SetInteger, const fmi2Integer)
NO_VARIABLES(fmi2SetBoolean, const fmi2Boolean)
NO_VARIABLES(fmi2SetString, const fmi2String)

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seed[],
                                        fmi2Real sensitivity[]) {
    INSTANCE
    for (size_t i = 0; i < n_unknowns; ++i) {
        sensitivity[i] = 0.0;
        for (size_t j = 0; j < n_knowns; ++j) {
            double derivative;
            if (force_derivative(&self->state, unknowns[i], knowns[j], &derivative) != VALUE_OK) {
                return failed(self, "fmi2GetDirectionalDerivative: of the output by inputs and parameters only.");
            }
            sensitivity[i] += derivative * seed[j];
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    return n == 0 ? fmi2OK : failed(c, "Inputs are not interpolated: the model samples them.");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    return n == 0 ? fmi2OK : failed(c, "The output is held between samples: it has no derivatives.");
}

fmi2Status fmi2CancelStep(fmi2Component c) { return failed(c, "Steps are never asynchronous."); }

#define NO_STATUS(function, type)                                                 \
    fmi2Status function(fmi2Component c, const fmi2StatusKind kind, type *value) { \
        (void)c, (void)kind, (void)value;                                         \
        return fmi2Discard;                                                       \
    }

NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetStringStatus, fmi2String)

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    INSTANCE
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = self->state.time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)c;
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = fmi2False; /* the FMU never ends a simulation by itself */
    return fmi2OK;
}
