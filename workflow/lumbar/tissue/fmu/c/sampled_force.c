#include "sampled_force.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include MODEL_SOURCE /* the model itself: its numbers become part of the code around them */

/* Communication points are sums of many steps: they miss a sample instant by rounding. An instant counts as reached
 * within this share of the sampling time. */
#define INSTANT_TOLERANCE 1e-3

/* Numbers below this are flushed to zero: products of them would be denormal, and slow, long before they mattered. */
#define NEGLIGIBLE 1e-200

/* Largest device damping in N s/m and energy reserve in J (rotations: N m s/rad) that may be set. */
#define LARGEST_GUARD 1e3

static const char MAGIC[8] = "lumbar2";

static double sample_instant(const force_state *state, int64_t sample) {
    return state->start_time + (double)sample * MODEL.sampling_time;
}

static double tolerance(void) { return INSTANT_TOLERANCE * MODEL.sampling_time; }

static double flushed(double value) { return fabs(value) < NEGLIGIBLE ? 0.0 : value; }

#if MODEL_AXES > 1
#include "spatial_force.c"
#else /* one axis */
static double within(double value, double low, double high) {
    return value < low ? low : value > high ? high : value;
}

void force_reset(force_state *state, bool event_mode) {
    memset(state, 0, sizeof *state);
    state->input = MODEL.input_offset;
    state->input_offset = MODEL.input_offset;
    state->output_offset = MODEL.output_offset;
    state->output_limit = MODEL.output_limit;
    state->rate_limit = MODEL.rate_limit;
    state->device_damping = MODEL.device_damping;
    state->energy_reserve = MODEL.energy_reserve;
    state->gain = 1.0;
    state->mode = MODE_INSTANTIATED;
    state->event_mode = event_mode;
}

#endif /* MODEL_AXES */
bool force_start(force_state *state, double start_time) {
    if (!isfinite(start_time)) return false;
    state->start_time = start_time;
    state->time = start_time;
    state->next_sample = 0;
    state->pending = 1;
    state->input_set = 1;
    return true;
}

#if MODEL_AXES > 1
#else /* one axis */
/* Behind a tool that leaves it, the tissue stays at rest: else it would push before it is touched again. */
static double deviation(const force_state *state) {
    double depth = state->input - state->input_offset;
    return MODEL.contact && depth < 0.0 ? 0.0 : depth;
}

/* Whether the pending sample is the first one of a model that rests where it is first touched. */
static bool starts_at_rest(const force_state *state) { return MODEL.starts_at_rest && state->next_sample == 0; }

/* Deviation of the input so many samples ago. */
static double past_input(const force_state *state, int samples) {
    if (samples == 0) return deviation(state);
    int place = state->newest + 1 - samples;
    return state->history[place < 0 ? place + MODEL_HISTORY : place];
}

/* Mean of the newest inputs, as late as the model's delay. */
static double averaged_input(const force_state *state) {
    if (starts_at_rest(state)) return flushed(deviation(state));
    double sum = past_input(state, MODEL_DELAY);
    for (int i = 1; i < MODEL_WINDOW; ++i) sum += past_input(state, MODEL_DELAY + i);
    return flushed(sum / MODEL_WINDOW);
}

static double model_output(const force_state *state, double u, double next[]) {
    if (!starts_at_rest(state)) return model_sample(state->x[state->phase], &state->past, u, next);
    double rest[MODEL_STATES] = {0};
    model_rest(u, rest);
    memcpy(next, rest, sizeof rest);
    return model_sample(rest, &state->past, u, next);
}

/* Whether the output follows the input at this moment: a sample is pending and evaluated lazily. */
static bool follows_input(const force_state *state) {
    bool waits = state->event_mode ? state->mode == MODE_STEP : MODEL.guarded;
    return state->pending && !waits;
}

/* Model output at this moment. A pending sample is evaluated with the input set for it; where none was set yet, the
 * feed-through is that of the sample before, or the whole output is where the model needs the input. */
static double model_output_now(const force_state *state) {
    if (!follows_input(state)) return state->held_output;
    bool input_known = MODEL_DELAY > 0 || state->input_set || state->mode != MODE_STEP;
    if (!input_known && MODEL.waits_for_input) return state->held_output;
    double next[MODEL_STATES];
    double y = model_output(state, input_known ? averaged_input(state) : state->held_input, next);
    return isfinite(y) ? y : state->held_output;
}

/* A tissue does not pull; and never more than the limit leaves the FMU. */
static double limited_force(const force_state *state, double y) {
    double force = state->gain * y + state->output_offset;
    if (MODEL.contact && MODEL.resistance * force < 0.0) force = 0.0;
    return within(force, -state->output_limit, state->output_limit);
}

/* The energy in J that model and device's damping together have taken in up to the pending sample, where this force was
 * displayed since the sample before and that much had been taken in until then.
 *
 * A held force f does the work f d over a displacement d, however the device gets there; a damping b takes at least
 * b d^2 / T meanwhile (Cauchy and Schwarz). Hannaford and Ryu, IEEE Trans. Robotics and Automation 18 (2002) 1-10. */
static double energy_taken(const force_state *state, double shown, double before) {
    if (state->next_sample == 0) return 0.0;
    double moved = (state->input - state->last_input) * MODEL.input_unit;
    double damped = state->device_damping * moved * moved / MODEL.sampling_time;
    double energy = before + (MODEL.resistance * (shown * MODEL.output_unit) * moved + damped);
    return energy > state->energy_reserve ? state->energy_reserve : energy;
}

/* Without event mode nobody knows when the force of a step is displayed: at the step's begin by who lets the device's clock
 * wait for it, at its end by the rules of co-simulation. Both accounts are kept. */
typedef struct {
    double at_once, late;
} energies;

/* Most energy in J that a force in N held for a sample can give out, over its square, whatever the device does: the least of
 * f d + b d^2 / T over all d is -f^2 T / (4 b). */
static double worst_case(const force_state *state) { return MODEL.sampling_time / (4.0 * state->device_damping); }

/* What the force of the sample before can still give out where it is displayed late. */
static double owed(const force_state *state) {
    double force = state->held_force * MODEL.output_unit;
    return state->event_mode || !(state->device_damping > 0.0) ? 0.0 : force * force * worst_case(state);
}

static energies energies_taken(const force_state *state) {
    energies taken = {.at_once = energy_taken(state, state->held_force, state->energy)};
    taken.late = state->event_mode ? taken.at_once : energy_taken(state, state->earlier_force, state->late_energy);
    if (state->gain > state->held_gain) {
        /* What comes of a sudden has not been pressed together by anybody. Of what was taken in before it gets the share that
         * the tissue before it is of it: one that is switched on begins with nothing. */
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
static double guarded_force(const force_state *state, double y, energies taken) {
    double force = limited_force(state, y);
    if (MODEL.rate_limit > 0.0) {
        double step = state->rate_limit * MODEL.sampling_time;
        force = within(force, state->held_force - step, state->held_force + step);
    }
    if (MODEL.device_damping > 0.0) {
        double largest = passive_limit(state, taken);
        force = within(force, -largest, largest);
    }
    return force;
}

/* The force at this moment. With guards it is a whole sample late where there is no event mode, and held from one
 * sample's instant to the next: what the device displays must be known. */
static double force_now(const force_state *state) {
    if (!MODEL.guarded) return limited_force(state, model_output_now(state));
    if (follows_input(state)) return guarded_force(state, model_output_now(state), energies_taken(state));
    return state->event_mode || state->pending ? state->held_force : state->earlier_force;
}

/* Derivative of the model's output by the input of the pending sample. */
static double output_slope(const force_state *state) {
    if (starts_at_rest(state)) {
        double rest[MODEL_STATES] = {0}, u = averaged_input(state);
        model_rest(u, rest);
        return model_slope(rest, &state->past, u, true);
    }
    return MODEL_DELAY > 0 ? 0.0 : model_slope(state->x[state->phase], &state->past, averaged_input(state), false) / MODEL_WINDOW;
}

static double *parameter(force_state *state, uint32_t reference) {
    switch (reference) {
        case VR_INPUT: return &state->input;
        case VR_GAIN: return &state->gain;
        case VR_OUTPUT_OFFSET: return &state->output_offset;
        case VR_OUTPUT_LIMIT: return &state->output_limit;
        case VR_INPUT_OFFSET: return &state->input_offset;
        case VR_RATE_LIMIT: return MODEL.rate_limit > 0.0 ? &state->rate_limit : NULL;
        case VR_DEVICE_DAMPING: return MODEL.device_damping > 0.0 ? &state->device_damping : NULL;
        case VR_ENERGY_RESERVE: return MODEL.device_damping > 0.0 ? &state->energy_reserve : NULL;
        default: return NULL;
    }
}

value_status force_get(const force_state *state, uint32_t reference, double *value) {
    switch (reference) {
        case VR_TIME: *value = state->time; return VALUE_OK;
        case VR_OUTPUT: *value = force_now(state); return VALUE_OK;
        case VR_ENERGY:
            if (!(MODEL.device_damping > 0.0)) return VALUE_UNKNOWN;
            *value = state->late_energy < state->energy ? state->late_energy : state->energy;
            return VALUE_OK;
        default: {
            const double *found = parameter((force_state *)state, reference);
            if (!found) return VALUE_UNKNOWN;
            *value = *found;
            return VALUE_OK;
        }
    }
}

/* Central difference: with effects and guards the force has kinks, where a derivative does not exist; far from them it is
 * good to 1e-6. */
static double difference_quotient(const force_state *state, uint32_t known) {
    static const double STEP = 0x1p-23; /* about 1e-7 of the unit; a power of two is added without error */
    double force[2];
    for (int i = 0; i < 2; ++i) {
        force_state moved = *state;
        *parameter(&moved, known) += i ? STEP : -STEP;
        force[i] = force_now(&moved);
    }
    return (force[1] - force[0]) / (2.0 * STEP);
}

value_status force_derivative(const force_state *state, uint32_t unknown, uint32_t known, double *value) {
    if (unknown != VR_OUTPUT || !parameter((force_state *)state, known)) return VALUE_UNKNOWN;
    if (MODEL.guarded || MODEL.contact) {
        *value = difference_quotient(state, known);
        return VALUE_OK;
    }
    double force = state->gain * model_output_now(state) + state->output_offset;
    bool limited = fabs(force) > state->output_limit;
    double by_input = 0.0;
    if (follows_input(state)) by_input = state->gain * output_slope(state);
    switch (known) {
        case VR_INPUT: *value = limited ? 0.0 : by_input; return VALUE_OK;
        case VR_INPUT_OFFSET: *value = limited ? 0.0 : -by_input; return VALUE_OK;
        case VR_GAIN: *value = limited ? 0.0 : model_output_now(state); return VALUE_OK;
        case VR_OUTPUT_OFFSET: *value = limited ? 0.0 : 1.0; return VALUE_OK;
        case VR_OUTPUT_LIMIT: *value = limited ? (force > 0 ? 1.0 : -1.0) : 0.0; return VALUE_OK;
        default: return VALUE_UNKNOWN;
    }
}

static value_status set_within(double *target, double value, double low, double high) {
    if (!(value >= low && value <= high)) return VALUE_OUT_OF_RANGE;
    *target = value;
    return VALUE_OK;
}

static value_status set_guard(force_state *state, uint32_t reference, double value) {
    double *target = parameter(state, reference);
    if (!target) return VALUE_UNKNOWN;
    return set_within(target, value, 0.0, reference == VR_RATE_LIMIT ? MODEL.rate_limit : LARGEST_GUARD);
}

value_status force_set(force_state *state, uint32_t reference, double value) {
    switch (reference) {
        case VR_INPUT:
            if (!isfinite(value)) return VALUE_NOT_FINITE;
            state->input = value;
            state->input_set = 1;
            return VALUE_OK;
        case VR_INPUT_OFFSET:
            if (!isfinite(value)) return VALUE_OUT_OF_RANGE;
            state->input_offset = value;
            return VALUE_OK;
        case VR_GAIN: return set_within(&state->gain, value, 0.0, MODEL.gain_limit);
        case VR_OUTPUT_LIMIT: return set_within(&state->output_limit, value, 0.0, MODEL.output_limit);
        case VR_OUTPUT_OFFSET:
            return set_within(&state->output_offset, value, -MODEL.output_limit, MODEL.output_limit);
        case VR_RATE_LIMIT:
        case VR_DEVICE_DAMPING:
        case VR_ENERGY_RESERVE: return set_guard(state, reference, value);
        case VR_TIME:
        case VR_OUTPUT: return VALUE_NOT_SETTABLE;
        case VR_ENERGY: return MODEL.device_damping > 0.0 ? VALUE_NOT_SETTABLE : VALUE_UNKNOWN;
        default: return VALUE_UNKNOWN;
    }
}

/* What the samples after this one need to know of it. */
static void remember(force_state *state, double u, const double next[]) {
    if (starts_at_rest(state)) {
        for (int i = 0; i < MODEL_HISTORY; ++i) state->history[i] = deviation(state);
        for (int i = 0; i < MODEL_PHASES; ++i) model_rest(u, state->x[i]);
    }
    model_keep(state->x[state->phase], next, &state->past);
    memcpy(state->x[state->phase], next, sizeof state->x[0]);
    state->newest = state->newest + 1 < MODEL_HISTORY ? state->newest + 1 : 0;
    state->history[state->newest] = deviation(state);
    state->held_input = u;
}

step_status force_take_sample(force_state *state) {
    if (!state->pending) return STEP_OK;
    double u = averaged_input(state);
    double next[MODEL_STATES];
    memcpy(next, state->x[state->phase], sizeof next);
    double y = model_output(state, u, next);
    int wild = !isfinite(u) || !isfinite(y);
    for (int i = 0; i < MODEL_STATES; ++i) { /* without branches: several at a time */
        wild |= !(fabs(next[i]) <= DBL_MAX);
        next[i] = flushed(next[i]);
    }
    bool finite = !wild;
    if (finite) {
        remember(state, u, next);
        state->held_output = y;
    }
    if (MODEL.guarded) {
        energies taken = energies_taken(state);
        double force = guarded_force(state, state->held_output, taken);
        state->energy = taken.at_once;
        state->late_energy = taken.late;
        state->earlier_force = state->held_force;
        state->held_force = force;
        state->last_input = state->input;
        state->held_gain = state->gain;
    }
    state->phase = state->phase + 1 < MODEL_PHASES ? state->phase + 1 : 0;
    state->pending = 0;
    state->input_set = 0;
    ++state->next_sample;
    return finite ? STEP_OK : STEP_NOT_FINITE;
}

#endif /* MODEL_AXES */
step_status force_advance(force_state *state, double from, double step, bool stop_at_sample) {
    double end = from + step;
    if (!(step > 0.0) || !isfinite(end) || !(fabs(from - state->time) <= tolerance())) return STEP_WRONG_TIME;
    if (step > LONGEST_STEP * MODEL.sampling_time) return STEP_TOO_LONG;
    step_status status = STEP_OK;
    for (;;) {
        if (force_take_sample(state) != STEP_OK) status = STEP_NOT_FINITE;
        double instant = sample_instant(state, state->next_sample);
        if (!(instant <= end + tolerance())) break;
        state->pending = 1;
        state->input_set = 0; /* what was set before the instant is not its input */
        if (instant >= end - tolerance()) break;
        if (stop_at_sample) {
            state->time = instant;
            return status;
        }
    }
    state->time = end;
    return status;
}

double force_next_event(const force_state *state) {
    return sample_instant(state, state->next_sample + (state->pending ? 1 : 0));
}

/* FNV-1a over bytes. */
static uint64_t checksum(const uint8_t bytes[], size_t size) {
    uint64_t hash = 14695981039346656037u;
    for (size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * 1099511628211u;
    return hash;
}

size_t force_serialized_size(void) {
    return sizeof MAGIC + strlen(MODEL.token) + sizeof(force_state) + sizeof(uint64_t);
}

void force_serialize(const force_state *state, uint8_t bytes[]) {
    const size_t size = force_serialized_size() - sizeof(uint64_t);
    memcpy(bytes, MAGIC, sizeof MAGIC);
    memcpy(bytes + sizeof MAGIC, MODEL.token, strlen(MODEL.token));
    memcpy(bytes + sizeof MAGIC + strlen(MODEL.token), state, sizeof *state);
    const uint64_t sum = checksum(bytes, size);
    memcpy(bytes + size, &sum, sizeof sum);
}

bool force_deserialize(force_state *state, const uint8_t bytes[], size_t size) {
    uint64_t sum;
    if (size != force_serialized_size() || memcmp(bytes, MAGIC, sizeof MAGIC) != 0) return false;
    if (memcmp(bytes + sizeof MAGIC, MODEL.token, strlen(MODEL.token)) != 0) return false;
    memcpy(&sum, bytes + size - sizeof sum, sizeof sum);
    if (sum != checksum(bytes, size - sizeof sum)) return false;
    memcpy(state, bytes + sizeof MAGIC + strlen(MODEL.token), sizeof *state);
    return true;
}
