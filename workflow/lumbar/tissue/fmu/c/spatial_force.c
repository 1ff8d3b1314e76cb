/* What differs in `sampled_force.c`, which includes this, where position and force are vectors.
 *
 * Bounds are those of a vector's length, and keep its direction: a device that is stronger in one direction than in another is
 * bounded by its weakest. There is no contact: where a tissue ends in space, no position alone says. */

typedef struct {
    double along[MODEL_AXES];
} vector;

static double dot(const double a[], const double b[]) {
    double sum = 0.0;
    for (int i = 0; i < MODEL_AXES; ++i) sum += a[i] * b[i];
    return sum;
}

/* Nothing longer than `most` in the same direction; a share of it that is rounded may be longer by its last digit. */
static vector shortened(vector whole, double most) {
    double length = sqrt(dot(whole.along, whole.along));
    if (!(length > most)) return whole;
    for (int i = 0; i < MODEL_AXES; ++i) whole.along[i] = whole.along[i] / length * most;
    return whole;
}

void force_reset(force_state *state, bool event_mode) {
    static const double rest[MODEL_AXES] = MODEL_REST;
    memset(state, 0, sizeof *state);
    for (int i = 0; i < MODEL_AXES; ++i) {
        state->input[i] = state->input_offset[i] = rest[i];
        state->output_offset[i] = MODEL.output_offset;
    }
    state->output_limit = MODEL.output_limit;
    state->rate_limit = MODEL.rate_limit;
    state->device_damping = MODEL.device_damping;
    state->energy_reserve = MODEL.energy_reserve;
    state->gain = 1.0;
    state->mode = MODE_INSTANTIATED;
    state->event_mode = event_mode;
}

/* Whether the pending sample is the first one of a model that rests where it is first touched. */
static bool starts_at_rest(const force_state *state) { return MODEL.starts_at_rest && state->next_sample == 0; }

/* Deviation of the input along an axis so many samples ago. */
static double past_input(const force_state *state, int axis, int samples) {
    if (samples == 0) return state->input[axis] - state->input_offset[axis];
    int place = state->newest + 1 - samples;
    return state->history[place < 0 ? place + MODEL_HISTORY : place][axis];
}

/* Mean of the newest inputs, as late as the model's delay. */
static vector averaged_input(const force_state *state) {
    vector mean;
    bool rests = starts_at_rest(state);
    for (int axis = 0; axis < MODEL_AXES; ++axis) {
        double sum = past_input(state, axis, rests ? 0 : MODEL_DELAY);
        for (int i = 1; i < MODEL_WINDOW && !rests; ++i) sum += past_input(state, axis, MODEL_DELAY + i);
        mean.along[axis] = flushed(rests ? sum : sum / MODEL_WINDOW);
    }
    return mean;
}

static bool all_finite(const double values[]) {
    bool finite = true;
    for (int i = 0; i < MODEL_AXES; ++i) finite &= isfinite(values[i]) != 0;
    return finite;
}

static vector model_output(const force_state *state, vector u, double next[]) {
    vector y;
    if (!starts_at_rest(state)) {
        model_sample(state->x[state->phase], &state->past, u.along, next, y.along);
        return y;
    }
    double rest[MODEL_STATES] = {0};
    model_rest(u.along, rest);
    memcpy(next, rest, sizeof rest);
    model_sample(rest, &state->past, u.along, next, y.along);
    return y;
}

/* Whether the output follows the input at this moment: a sample is pending and evaluated lazily. */
static bool follows_input(const force_state *state) {
    bool waits = state->event_mode ? state->mode == MODE_STEP : MODEL.guarded;
    return state->pending && !waits;
}

static vector copied(const double values[]) {
    vector copy;
    memcpy(copy.along, values, sizeof copy.along);
    return copy;
}

/* Model output at this moment; as for one axis. */
static vector model_output_now(const force_state *state) {
    vector held = copied(state->held_output);
    bool input_known = MODEL_DELAY > 0 || state->input_set || state->mode != MODE_STEP;
    if (!follows_input(state) || (!input_known && MODEL.waits_for_input)) return held;
    double next[MODEL_STATES];
    vector y = model_output(state, input_known ? averaged_input(state) : copied(state->held_input), next);
    return all_finite(y.along) ? y : held;
}

/* Never more than the limit leaves the FMU. */
static vector limited_force(const force_state *state, vector y) {
    for (int i = 0; i < MODEL_AXES; ++i) y.along[i] = state->gain * y.along[i] + state->output_offset[i];
    return shortened(y, state->output_limit);
}

/* The energy in J that model and device's damping together have taken in up to the pending sample, where this force was
 * displayed since the sample before and that much had been taken in until then.
 *
 * A held force f does the work f.d over a displacement d, however the device gets there; a damping b takes at least
 * b |d|^2 / T meanwhile (Cauchy and Schwarz). Hannaford and Ryu, IEEE Trans. Robotics and Automation 18 (2002) 1-10. */
static double energy_taken(const force_state *state, const double shown[], double before) {
    if (state->next_sample == 0) return 0.0;
    double moved[MODEL_AXES];
    for (int i = 0; i < MODEL_AXES; ++i) moved[i] = (state->input[i] - state->last_input[i]) * MODEL.input_unit;
    double damped = state->device_damping * dot(moved, moved) / MODEL.sampling_time;
    double energy = before + (MODEL.resistance * (dot(shown, moved) * MODEL.output_unit) + damped);
    return energy > state->energy_reserve ? state->energy_reserve : energy;
}

/* Without event mode both accounts are kept, as for one axis. */
typedef struct {
    double at_once, late;
} energies;

/* Most energy in J that a force in N held for a sample can give out, over its square, whatever the device does: the least of
 * f.d + b |d|^2 / T over all d is -|f|^2 T / (4 b). */
static double worst_case(const force_state *state) { return MODEL.sampling_time / (4.0 * state->device_damping); }

/* What the force of the sample before can still give out where it is displayed late. */
static double owed(const force_state *state) {
    double square = dot(state->held_force, state->held_force) * MODEL.output_unit * MODEL.output_unit;
    return state->event_mode || !(state->device_damping > 0.0) ? 0.0 : square * worst_case(state);
}

static energies energies_taken(const force_state *state) {
    energies taken = {.at_once = energy_taken(state, state->held_force, state->energy)};
    taken.late = state->event_mode ? taken.at_once : energy_taken(state, state->earlier_force, state->late_energy);
    if (state->gain > state->held_gain) { /* what comes of a sudden has not been pressed together by anybody */
        double share = state->held_gain / state->gain, rest = taken.late - owed(state);
        taken.at_once *= share;
        taken.late = owed(state) + share * rest;
    }
    return taken;
}

/* The largest force that, held for a sample, cannot give out more than the energy at hand. */
static double passive_limit(const force_state *state, energies taken) {
    if (!(state->device_damping > 0.0)) return 0.0;
    double rest = taken.late - owed(state), energy = rest < taken.at_once ? rest : taken.at_once;
    return energy > 0.0 ? sqrt(energy / worst_case(state)) / MODEL.output_unit : 0.0;
}

/* The force of the pending sample: steady enough, and passive whatever that takes. */
static vector guarded_force(const force_state *state, vector y, energies taken) {
    vector force = limited_force(state, y);
    if (MODEL.rate_limit > 0.0) {
        for (int i = 0; i < MODEL_AXES; ++i) force.along[i] -= state->held_force[i];
        force = shortened(force, state->rate_limit * MODEL.sampling_time);
        for (int i = 0; i < MODEL_AXES; ++i) force.along[i] += state->held_force[i];
    }
    return MODEL.device_damping > 0.0 ? shortened(force, passive_limit(state, taken)) : force;
}

/* The force at this moment; as for one axis. */
static vector force_now(const force_state *state) {
    if (!MODEL.guarded) return limited_force(state, model_output_now(state));
    if (follows_input(state)) return guarded_force(state, model_output_now(state), energies_taken(state));
    return copied(state->event_mode || state->pending ? state->held_force : state->earlier_force);
}

size_t force_size(uint32_t reference) {
    switch (reference) {
        case VR_INPUT:
        case VR_OUTPUT:
        case VR_OUTPUT_OFFSET:
        case VR_INPUT_OFFSET: return MODEL_AXES;
        default: return 1;
    }
}

static double *parameter(force_state *state, uint32_t element) {
    uint32_t reference = element % VR_ELEMENT, axis = element / VR_ELEMENT;
    if (axis >= force_size(reference)) return NULL;
    switch (reference) {
        case VR_INPUT: return &state->input[axis];
        case VR_GAIN: return &state->gain;
        case VR_OUTPUT_OFFSET: return &state->output_offset[axis];
        case VR_OUTPUT_LIMIT: return &state->output_limit;
        case VR_INPUT_OFFSET: return &state->input_offset[axis];
        case VR_RATE_LIMIT: return MODEL.rate_limit > 0.0 ? &state->rate_limit : NULL;
        case VR_DEVICE_DAMPING: return MODEL.device_damping > 0.0 ? &state->device_damping : NULL;
        case VR_ENERGY_RESERVE: return MODEL.device_damping > 0.0 ? &state->energy_reserve : NULL;
        default: return NULL;
    }
}

value_status force_get_all(const force_state *state, uint32_t reference, double values[]) {
    if (reference >= VR_ELEMENT) return VALUE_UNKNOWN;
    if (reference == VR_OUTPUT) {
        vector force = force_now(state);
        memcpy(values, force.along, sizeof force.along);
        return VALUE_OK;
    }
    for (uint32_t i = 0; i < force_size(reference); ++i) {
        if (force_get(state, reference + i * VR_ELEMENT, &values[i]) != VALUE_OK) return VALUE_UNKNOWN;
    }
    return VALUE_OK;
}

value_status force_get(const force_state *state, uint32_t element, double *value) {
    const double *found = parameter((force_state *)state, element);
    if (element == VR_TIME) {
        *value = state->time;
    } else if (element % VR_ELEMENT == VR_OUTPUT && element / VR_ELEMENT < MODEL_AXES) {
        *value = force_now(state).along[element / VR_ELEMENT];
    } else if (element == VR_ENERGY && MODEL.device_damping > 0.0) {
        *value = state->late_energy < state->energy ? state->late_energy : state->energy;
    } else if (found) {
        *value = *found;
    } else {
        return VALUE_UNKNOWN;
    }
    return VALUE_OK;
}

/* Central difference: with effects, limits and guards the force has kinks, where a derivative does not exist; far from them it
 * is good to 1e-6. */
value_status force_derivative(const force_state *state, uint32_t unknown, uint32_t known, double *value) {
    static const double STEP = 0x1p-23; /* about 1e-7 of the unit; a power of two is added without error */
    if (unknown % VR_ELEMENT != VR_OUTPUT || unknown / VR_ELEMENT >= MODEL_AXES) return VALUE_UNKNOWN;
    if (!parameter((force_state *)state, known)) return VALUE_UNKNOWN;
    double force[2];
    for (int i = 0; i < 2; ++i) {
        force_state moved = *state;
        *parameter(&moved, known) += i ? STEP : -STEP;
        force[i] = force_now(&moved).along[unknown / VR_ELEMENT];
    }
    *value = (force[1] - force[0]) / (2.0 * STEP);
    return VALUE_OK;
}

/* Whether a value may be set. */
static value_status settable(uint32_t element, double value) {
    double low = 0.0, high;
    switch (element % VR_ELEMENT) {
        case VR_INPUT: return isfinite(value) ? VALUE_OK : VALUE_NOT_FINITE;
        case VR_INPUT_OFFSET: return isfinite(value) ? VALUE_OK : VALUE_OUT_OF_RANGE;
        case VR_GAIN: high = MODEL.gain_limit; break;
        case VR_OUTPUT_LIMIT: high = MODEL.output_limit; break;
        case VR_OUTPUT_OFFSET: low = -MODEL.output_limit, high = MODEL.output_limit; break;
        case VR_RATE_LIMIT: high = MODEL.rate_limit; break;
        default: high = LARGEST_GUARD; break;
    }
    return value >= low && value <= high ? VALUE_OK : VALUE_OUT_OF_RANGE;
}

value_status force_set(force_state *state, uint32_t element, double value) {
    double *target = parameter(state, element), unused;
    if (!target) return force_get(state, element, &unused) == VALUE_OK ? VALUE_NOT_SETTABLE : VALUE_UNKNOWN;
    value_status status = settable(element, value);
    if (status != VALUE_OK) return status;
    *target = value;
    if (element % VR_ELEMENT == VR_INPUT) state->input_set = 1;
    return VALUE_OK;
}

value_status force_set_all(force_state *state, uint32_t reference, const double values[]) {
    if (reference >= VR_ELEMENT) return VALUE_UNKNOWN;
    for (uint32_t i = 0; i < force_size(reference); ++i) {
        value_status status = settable(reference, values[i]);
        if (status != VALUE_OK && parameter(state, reference)) return status;
    }
    value_status status = VALUE_OK;
    for (uint32_t i = 0; i < force_size(reference) && status == VALUE_OK; ++i) {
        status = force_set(state, reference + i * VR_ELEMENT, values[i]);
    }
    return status;
}

/* What the samples after this one need to know of it. */
static void remember(force_state *state, vector u, const double next[]) {
    state->newest = state->newest + 1 < MODEL_HISTORY ? state->newest + 1 : 0;
    bool rests = starts_at_rest(state);
    for (int axis = 0; axis < MODEL_AXES; ++axis) {
        double deviation = past_input(state, axis, 0);
        for (int i = 0; i < MODEL_HISTORY; ++i) {
            if (rests || i == state->newest) state->history[i][axis] = deviation;
        }
        state->held_input[axis] = u.along[axis];
    }
    for (int i = 0; i < MODEL_PHASES && rests; ++i) model_rest(u.along, state->x[i]);
    model_keep(state->x[state->phase], next, &state->past);
    memcpy(state->x[state->phase], next, sizeof state->x[0]);
}

step_status force_take_sample(force_state *state) {
    if (!state->pending) return STEP_OK;
    double next[MODEL_STATES];
    memcpy(next, state->x[state->phase], sizeof next);
    vector u = averaged_input(state), y = model_output(state, u, next);
    int wild = !all_finite(u.along) || !all_finite(y.along);
    for (int i = 0; i < MODEL_STATES; ++i) { /* without branches: several at a time */
        wild |= !(fabs(next[i]) <= DBL_MAX);
        next[i] = flushed(next[i]);
    }
    if (!wild) {
        remember(state, u, next);
        memcpy(state->held_output, y.along, sizeof y.along);
    }
    if (MODEL.guarded) {
        energies taken = energies_taken(state);
        vector force = guarded_force(state, copied(state->held_output), taken);
        state->energy = taken.at_once;
        state->late_energy = taken.late;
        memcpy(state->earlier_force, state->held_force, sizeof force.along);
        memcpy(state->held_force, force.along, sizeof force.along);
        memcpy(state->last_input, state->input, sizeof force.along);
        state->held_gain = state->gain;
    }
    state->phase = state->phase + 1 < MODEL_PHASES ? state->phase + 1 : 0;
    state->pending = 0;
    state->input_set = 0;
    ++state->next_sample;
    return wild ? STEP_NOT_FINITE : STEP_OK;
}
