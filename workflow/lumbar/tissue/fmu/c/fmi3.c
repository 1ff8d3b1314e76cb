/* FMI 3.0 co-simulation API of a sampled model.
 *
 * With event mode the importer is led to every sample instant (eventHandlingNeeded, early return), sets the input
 * there and reads the force of the same sample, C x[k] + D u[k]. The sample is taken when Event Mode is left, so that
 * set, update and get may come in any order and be repeated. Without event mode the FMU behaves as in FMI 2.0.
 */
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "sampled_force.h"

typedef struct {
    force_state state;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    bool event_mode;
    bool early_return;
    bool not_finite_logged;
} instance;

/* `self`, or an error where an importer has none. */
#define INSTANCE        \
    instance *self = c; \
    if (!self) return fmi3Error;

static void message(const instance *self, fmi3Status status, const char *text) {
    static const char *const CATEGORIES[] = {"logAll", "logStatusWarning", "logStatusDiscard", "logStatusError"};
    if (self && self->log) self->log(self->environment, status, CATEGORIES[status], text);
}

static fmi3Status failed(const instance *self, const char *text) {
    message(self, fmi3Error, text);
    return fmi3Error;
}

/* One warning per series of values that are not finite: logging has no place in every step. */
static fmi3Status not_finite(instance *self, const char *text) {
    if (!self->not_finite_logged) message(self, fmi3Warning, text);
    self->not_finite_logged = true;
    return fmi3Warning;
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    (void)c, (void)on, (void)n, (void)categories; /* warnings and errors alone are logged, and always */
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t n_intermediate,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    (void)resources, (void)visible, (void)logging, (void)intermediate, (void)update;
    instance refused = {.environment = environment, .log = log};
    if (!name || !*name) return failed(&refused, "The instance needs a name."), NULL;
    if (n_intermediate > 0) return failed(&refused, "There is no intermediate update."), NULL;
    if (!token || strcmp(token, MODEL.token) != 0) {
        return failed(&refused, "The token is not that of this FMU: binary and modelDescription.xml differ."), NULL;
    }
    instance *self = calloc(1, sizeof *self);
    if (!self) return failed(&refused, "Out of memory."), NULL;
    self->environment = environment;
    self->log = log;
    self->event_mode = event_mode;
    self->early_return = early_return;
    force_reset(&self->state, event_mode);
    return self;
}

void fmi3FreeInstance(fmi3Instance c) { free(c); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop) {
    INSTANCE
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    if (self->state.mode != MODE_INSTANTIATED) return failed(self, "fmi3EnterInitializationMode called twice.");
    if (!force_start(&self->state, start)) {
        return failed(self, "fmi3EnterInitializationMode: the start time is not finite.");
    }
    self->state.mode = MODE_INITIALIZATION;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    INSTANCE
    if (self->state.mode != MODE_INITIALIZATION) return failed(self, "The instance is not in initialization mode.");
    self->state.mode = self->event_mode ? MODE_EVENT : MODE_STEP;
    return fmi3OK;
}

fmi3Status fmi3EnterEventMode(fmi3Instance c) {
    INSTANCE
    if (!self->event_mode || self->state.mode != MODE_STEP) {
        return failed(self, "Event Mode is entered from Step Mode, where eventModeUsed was true.");
    }
    self->state.mode = MODE_EVENT;
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *needs_update, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals_changed, fmi3Boolean *values_changed,
                                    fmi3Boolean *next_event_defined, fmi3Float64 *next_event) {
    INSTANCE
    if (self->state.mode != MODE_EVENT) return failed(self, "fmi3UpdateDiscreteStates outside Event Mode.");
    if (!needs_update || !terminate || !nominals_changed || !values_changed || !next_event_defined || !next_event) {
        return failed(self, "fmi3UpdateDiscreteStates: a place for a result is missing.");
    }
    *needs_update = *terminate = *nominals_changed = *values_changed = fmi3False;
    *next_event_defined = fmi3True;
    *next_event = force_next_event(&self->state);
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance c) {
    INSTANCE
    if (self->state.mode != MODE_EVENT) return failed(self, "Step Mode is entered from Event Mode.");
    step_status status = force_take_sample(&self->state);
    self->state.mode = MODE_STEP;
    if (status == STEP_OK) return fmi3OK;
    return not_finite(self, "The model's force is not finite: the last finite force is kept.");
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 from, fmi3Float64 step, fmi3Boolean no_rollback,
                      fmi3Boolean *event_needed, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last_time) {
    INSTANCE
    (void)no_rollback;
    if (!event_needed || !terminate || !early || !last_time) return failed(self, "fmi3DoStep: a place for a result is missing.");
    *event_needed = *terminate = *early = fmi3False;
    *last_time = self->state.time;
    if (self->state.mode != MODE_STEP) return failed(self, "fmi3DoStep outside Step Mode.");
    step_status status = force_advance(&self->state, from, step, self->event_mode && self->early_return);
    if (status == STEP_TOO_LONG) return failed(self, "fmi3DoStep: the step passes more than 1e7 samples.");
    if (status == STEP_WRONG_TIME) {
        return failed(self, "fmi3DoStep: step not positive, or not from where the last one ended.");
    }
    *last_time = self->state.time;
    *early = self->state.time < from + step;
    *event_needed = self->event_mode && self->state.pending;
    if (status == STEP_OK) return fmi3OK;
    return not_finite(self, "The model's force is not finite: the last finite force is kept.");
}

fmi3Status fmi3Terminate(fmi3Instance c) {
    INSTANCE
    self->state.mode = MODE_TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance c) {
    INSTANCE
    force_reset(&self->state, self->event_mode);
    self->not_finite_logged = false;
    return fmi3OK;
}

#if MODEL_AXES > 1
/* All values of the variables, one after the other. */
static size_t total_size(const fmi3ValueReference vr[], size_t n) {
    size_t total = 0;
    for (size_t i = 0; i < n; ++i) total += force_size(vr[i]);
    return total;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[], size_t n_values) {
    INSTANCE
    if (n_values != total_size(vr, n)) return failed(self, "fmi3GetFloat64: as many values as the variables have are needed.");
    for (size_t i = 0; i < n; value += force_size(vr[i++])) {
        if (force_get_all(&self->state, vr[i], value) != VALUE_OK) {
            return failed(self, "fmi3GetFloat64: unknown value reference.");
        }
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[],
                          size_t n_values) {
    INSTANCE
    fmi3Status status = fmi3OK;
    if (n_values != total_size(vr, n)) return failed(self, "fmi3SetFloat64: as many values as the variables have are needed.");
    if (self->state.mode == MODE_TERMINATED) return failed(self, "fmi3SetFloat64 after fmi3Terminate.");
    for (size_t i = 0; i < n; value += force_size(vr[i++])) {
        switch (force_set_all(&self->state, vr[i], value)) {
            case VALUE_OK:
                if (vr[i] == VR_INPUT) self->not_finite_logged = false;
                break;
            case VALUE_NOT_FINITE:
                status = not_finite(self, "The input is not finite: the last finite value is kept.");
                break;
            case VALUE_OUT_OF_RANGE: return failed(self, "fmi3SetFloat64: the value is outside min and max; not set.");
            case VALUE_NOT_SETTABLE: return failed(self, "fmi3SetFloat64: this variable cannot be set.");
            default: return failed(self, "fmi3SetFloat64: unknown value reference.");
        }
    }
    return status;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    INSTANCE
    if (n_seed != total_size(knowns, n_knowns) || n_sensitivity != total_size(unknowns, n_unknowns)) {
        return failed(self, "fmi3GetDirectionalDerivative: as many values as the variables have are needed.");
    }
    size_t row = 0;
    for (size_t i = 0; i < n_unknowns; ++i) {
        for (uint32_t u = 0; u < force_size(unknowns[i]); ++u, ++row) {
            size_t column = 0;
            sensitivity[row] = 0.0;
            for (size_t j = 0; j < n_knowns; ++j) {
                for (uint32_t k = 0; k < force_size(knowns[j]); ++k, ++column) {
                    double derivative;
                    if (force_derivative(&self->state, unknowns[i] + u * VR_ELEMENT, knowns[j] + k * VR_ELEMENT,
                                         &derivative) != VALUE_OK) {
                        return failed(self, "fmi3GetDirectionalDerivative: of the output by inputs and parameters only.");
                    }
                    sensitivity[row] += derivative * seed[column];
                }
            }
        }
    }
    return fmi3OK;
}

#else /* one axis */
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[], size_t n_values) {
    INSTANCE
    if (n != n_values) return failed(self, "fmi3GetFloat64: all variables are scalars.");
    for (size_t i = 0; i < n; ++i) {
        if (force_get(&self->state, vr[i], &value[i]) != VALUE_OK) {
            return failed(self, "fmi3GetFloat64: unknown value reference.");
        }
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[],
                          size_t n_values) {
    INSTANCE
    fmi3Status status = fmi3OK;
    if (n != n_values) return failed(self, "fmi3SetFloat64: all variables are scalars.");
    if (self->state.mode == MODE_TERMINATED) return failed(self, "fmi3SetFloat64 after fmi3Terminate.");
    for (size_t i = 0; i < n; ++i) {
        switch (force_set(&self->state, vr[i], value[i])) {
            case VALUE_OK:
                if (vr[i] == VR_INPUT) self->not_finite_logged = false;
                break;
            case VALUE_NOT_FINITE:
                status = not_finite(self, "The input is not finite: the last finite value is kept.");
                break;
            case VALUE_OUT_OF_RANGE: return failed(self, "fmi3SetFloat64: the value is outside min and max; not set.");
            case VALUE_NOT_SETTABLE: return failed(self, "fmi3SetFloat64: this variable cannot be set.");
            default: return failed(self, "fmi3SetFloat64: unknown value reference.");
        }
    }
    return status;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    INSTANCE
    if (n_seed != n_knowns || n_sensitivity != n_unknowns) {
        return failed(self, "fmi3GetDirectionalDerivative: all variables are scalars.");
    }
    for (size_t i = 0; i < n_unknowns; ++i) {
        sensitivity[i] = 0.0;
        for (size_t j = 0; j < n_knowns; ++j) {
            double derivative;
            if (force_derivative(&self->state, unknowns[i], knowns[j], &derivative) != VALUE_OK) {
                return failed(self, "fmi3GetDirectionalDerivative: of the output by inputs and parameters only.");
            }
            sensitivity[i] += derivative * seed[j];
        }
    }
    return fmi3OK;
}

#endif /* MODEL_AXES */
fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *saved) {
    INSTANCE
    if (!saved) return failed(self, "fmi3GetFMUState: no place for it given.");
    if (!*saved) *saved = calloc(1, sizeof(force_state));
    if (!*saved) return failed(self, "Out of memory.");
    memcpy(*saved, &self->state, sizeof(force_state));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState saved) {
    INSTANCE
    if (!saved) return failed(self, "fmi3SetFMUState: no state given.");
    if ((((const force_state *)saved)->event_mode != 0) != self->event_mode) {
        return failed(self, "fmi3SetFMUState: the state was saved with another eventModeUsed.");
    }
    memcpy(&self->state, saved, sizeof(force_state));
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *saved) {
    (void)c;
    if (!saved) return fmi3OK; /* as the standard has it */
    free(*saved);
    *saved = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState saved, size_t *size) {
    (void)c, (void)saved;
    *size = force_serialized_size();
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState saved, fmi3Byte bytes[], size_t size) {
    INSTANCE
    if (!saved || !bytes || size < force_serialized_size()) return failed(self, "fmi3SerializeFMUState: no state or no room.");
    force_serialize(saved, bytes);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *saved) {
    INSTANCE
    force_state state;
    if (!bytes || !saved || !force_deserialize(&state, bytes, size)) {
        return failed(self, "fmi3DeserializeFMUState: these bytes are no state of this FMU, or damaged.");
    }
    if (!*saved) *saved = calloc(1, sizeof(force_state));
    if (!*saved) return failed(self, "Out of memory.");
    memcpy(*saved, &state, sizeof state);
    return fmi3OK;
}
