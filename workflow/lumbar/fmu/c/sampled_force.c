#include "sampled_force.h"

#include <math.h>
#include <string.h>

/* Communication points are sums of many steps: they miss a sample instant by rounding. An instant counts as reached
 * within this share of the sampling time. */
#define INSTANT_TOLERANCE 1e-3

/* Numbers below this are flushed to zero: products of them would be denormal, and slow, long before they mattered. */
#define NEGLIGIBLE 1e-200

static const char MAGIC[8] = "lumbar1";

static double sample_instant(const force_state *state, int64_t sample) {
    return state->start_time + (double)sample * MODEL.sampling_time;
}

static double tolerance(void) { return INSTANT_TOLERANCE * MODEL.sampling_time; }

static double flushed(double value) { return fabs(value) < NEGLIGIBLE ? 0.0 : value; }

void force_reset(force_state *state, bool event_mode) {
    memset(state, 0, sizeof *state);
    state->input = MODEL.input_offset;
    state->input_offset = MODEL.input_offset;
    state->output_offset = MODEL.output_offset;
    state->output_limit = MODEL.output_limit;
    state->gain = 1.0;
    state->mode = MODE_INSTANTIATED;
    state->event_mode = event_mode;
}

bool force_start(force_state *state, double start_time) {
    if (!isfinite(start_time)) return false;
    state->start_time = start_time;
    state->time = start_time;
    state->next_sample = 0;
    state->pending = 1;
    state->input_set = 1;
    return true;
}

/* Mean of the newest input and those of the samples before it, as a deviation from rest. */
static double averaged_input(const force_state *state) {
    double sum = state->input - state->input_offset;
    for (int i = 0; i < MODEL.window - 1; ++i) sum += state->window[i];
    return flushed(sum / MODEL.window);
}

/* Whether the output follows the input at this moment: a sample is pending and evaluated lazily. */
static bool follows_input(const force_state *state) {
    return state->pending && !(state->event_mode && state->mode == MODE_STEP);
}

/* Model output at this moment. A pending sample is evaluated with the input set for it; where none was set yet, the
 * feed-through is that of the sample before, or the whole output is where the model needs the input. */
static double model_output_now(const force_state *state) {
    if (!follows_input(state)) return state->held_output;
    bool input_known = state->input_set || state->mode != MODE_STEP;
    if (!input_known && MODEL.waits_for_input) return state->held_output;
    double next[MODEL_STATES];
    double y = model_sample(state->x, input_known ? averaged_input(state) : state->held_input, next);
    return isfinite(y) ? y : state->held_output;
}

static double unlimited_force(const force_state *state) {
    return state->gain * model_output_now(state) + state->output_offset;
}

value_status force_get(const force_state *state, uint32_t reference, double *value) {
    switch (reference) {
        case VR_TIME: *value = state->time; return VALUE_OK;
        case VR_INPUT: *value = state->input; return VALUE_OK;
        case VR_GAIN: *value = state->gain; return VALUE_OK;
        case VR_OUTPUT_OFFSET: *value = state->output_offset; return VALUE_OK;
        case VR_OUTPUT_LIMIT: *value = state->output_limit; return VALUE_OK;
        case VR_INPUT_OFFSET: *value = state->input_offset; return VALUE_OK;
        case VR_OUTPUT: {
            *value = fmax(-state->output_limit, fmin(state->output_limit, unlimited_force(state)));
            return VALUE_OK;
        }
        default: return VALUE_UNKNOWN;
    }
}

value_status force_derivative(const force_state *state, uint32_t unknown, uint32_t known, double *value) {
    if (unknown != VR_OUTPUT) return VALUE_UNKNOWN;
    double force = unlimited_force(state);
    bool limited = fabs(force) > state->output_limit;
    double by_input = 0.0;
    if (follows_input(state)) by_input = state->gain * model_slope(state->x, averaged_input(state)) / MODEL.window;
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
        case VR_TIME:
        case VR_OUTPUT: return VALUE_NOT_SETTABLE;
        default: return VALUE_UNKNOWN;
    }
}

step_status force_take_sample(force_state *state) {
    if (!state->pending) return STEP_OK;
    double u = averaged_input(state);
    double next[MODEL_STATES];
    memcpy(next, state->x, sizeof next);
    double y = model_sample(state->x, u, next);
    bool finite = isfinite(u) && isfinite(y);
    for (int i = 0; i < MODEL_STATES; ++i) {
        finite = finite && isfinite(next[i]);
        next[i] = flushed(next[i]);
    }
    state->pending = 0;
    state->input_set = 0;
    ++state->next_sample;
    if (!finite) return STEP_NOT_FINITE;
    memcpy(state->x, next, sizeof next);
    for (int i = MODEL.window - 1; i > 0; --i) state->window[i] = state->window[i - 1];
    state->window[0] = state->input - state->input_offset;
    state->held_input = u;
    state->held_output = y;
    return STEP_OK;
}

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
