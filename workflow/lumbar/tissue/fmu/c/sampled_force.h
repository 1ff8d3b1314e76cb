/* A model played in time: sampling, moving average, delay, limits and guards. Knows neither an FMI version nor a model's equations.
 *
 * Sample k is due at start_time + k * sampling_time. It is *pending* from the moment time reaches that instant until
 * the input of the instant is known for certain; only then is it *taken*: the input enters the moving average, the
 * output is held until the next sample, the state moves on.
 */
#ifndef LUMBAR_SAMPLED_FORCE_H
#define LUMBAR_SAMPLED_FORCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "model.h"

/* Value references, the same in both FMI versions (time exists in FMI 3.0 alone). */
enum {
    VR_TIME,
    VR_INPUT,
    VR_OUTPUT,
    VR_GAIN,
    VR_OUTPUT_OFFSET,
    VR_OUTPUT_LIMIT,
    VR_INPUT_OFFSET,
    VR_RATE_LIMIT,     /* with a limit on the output's rate alone */
    VR_DEVICE_DAMPING, /* this and the next two: of passive models alone */
    VR_ENERGY_RESERVE,
#if MODEL_AXES > 1
    VR_ENERGY,
    VR_ELEMENT = 16    /* of variables with a value for every axis: what is added for the element along the next one */
};
#else /* one axis */
    VR_ENERGY
};
#endif /* MODEL_AXES */

typedef enum { MODE_INSTANTIATED, MODE_INITIALIZATION, MODE_STEP, MODE_EVENT, MODE_TERMINATED } fmu_mode;

/* Everything a simulation depends on, without pointers: saving it saves the simulation. */
typedef struct {
    double x[MODEL_PHASES][MODEL_STATES];
    model_past past;               /* of the model's own signals */
#if MODEL_AXES > 1
    double history[MODEL_HISTORY][MODEL_AXES]; /* inputs of earlier samples, as deviations from rest: a ring */
    double input[MODEL_AXES];      /* last finite values set */
    double gain;
    double output_offset[MODEL_AXES];
    double output_limit;           /* of the force's length, as the two below */
    double input_offset[MODEL_AXES];
#else /* one axis */
    double history[MODEL_HISTORY]; /* inputs of earlier samples, as deviations from rest: a ring */
    double input;                  /* last finite value set */
    double gain;
    double output_offset;
    double output_limit;
    double input_offset;
#endif /* MODEL_AXES */
    double rate_limit;
    double device_damping;         /* N s/m */
    double energy_reserve;         /* most energy that counts as taken in, J */
#if MODEL_AXES > 1
    double held_input[MODEL_AXES];    /* averaged input of the last sample taken */
    double held_output[MODEL_AXES];   /* model output of the last sample taken */
    double held_force[MODEL_AXES];    /* of the last sample taken; this and the next five: with guards */
    double earlier_force[MODEL_AXES]; /* of the sample before that */
    double last_input[MODEL_AXES];    /* of the last sample taken */
#else /* one axis */
    double held_input;             /* averaged input of the last sample taken */
    double held_output;            /* model output of the last sample taken */
    double held_force;             /* of the last sample taken; this and the next five: with guards */
    double earlier_force;          /* of the sample before that */
    double last_input;             /* of the last sample taken */
#endif /* MODEL_AXES */
    double held_gain;              /* with which that was taken */
    double energy;                 /* taken in by model and device's damping up to then, J */
    double late_energy;            /* the same where every force was displayed a sample later */
    double start_time;
    double time;
    int64_t next_sample;
    int32_t newest;                /* place of the newest input in `history` */
    int32_t phase;                 /* of the next sample: which of the states it continues */
    int32_t mode;                  /* fmu_mode */
    int32_t event_mode;            /* 1: samples are taken in FMI 3.0's Event Mode */
    int32_t pending;               /* 1: next_sample is due now */
    int32_t input_set;             /* 1: the input was set since the sample became pending */
} force_state;

typedef enum { VALUE_OK, VALUE_NOT_FINITE, VALUE_OUT_OF_RANGE, VALUE_NOT_SETTABLE, VALUE_UNKNOWN } value_status;

typedef enum { STEP_OK, STEP_NOT_FINITE, STEP_WRONG_TIME, STEP_TOO_LONG } step_status;

/* Samples that one step may pass: 28 hours at 100 Hz. A step that never returned would stop the device's loop. */
#define LONGEST_STEP 1e7

/* Bring the state to that of a new instance. */
void force_reset(force_state *state, bool event_mode);

/* Begin at start_time with the first sample pending; false where that is no finite time. */
bool force_start(force_state *state, double start_time);

#if MODEL_AXES > 1
/* How many values a variable has: one, or one for every axis. References are those of first elements. */
size_t force_size(uint32_t reference);

value_status force_get_all(const force_state *state, uint32_t reference, double values[]);
value_status force_get(const force_state *state, uint32_t element, double *value);
/* Derivative of one element by another at this moment. Not for time or of anything but the output. */
value_status force_derivative(const force_state *state, uint32_t unknown, uint32_t known, double *value);

/* Of a variable: all of its values, or none where one is refused. */
value_status force_set_all(force_state *state, uint32_t reference, const double values[]);
value_status force_set(force_state *state, uint32_t element, double value);
#else /* one axis */
value_status force_get(const force_state *state, uint32_t reference, double *value);
/* Derivative of one variable by another at this moment. Not for time or of anything but the output. */
value_status force_derivative(const force_state *state, uint32_t unknown, uint32_t known, double *value);

value_status force_set(force_state *state, uint32_t reference, double value);
#endif /* MODEL_AXES */

/* Take the pending sample, if there is one. STEP_NOT_FINITE: state and held output stay as they were. */
step_status force_take_sample(force_state *state);

/* Move from `from` by `step` seconds, taking every sample passed with the input as it stands. With
 * `stop_at_sample` time ends at the first sample instant reached. */
step_status force_advance(force_state *state, double from, double step, bool stop_at_sample);

/* Instant of the next sample that is not yet pending or taken. */
double force_next_event(const force_state *state);

/* States as bytes: magic and token come first and a checksum last, so that foreign and damaged bytes are refused. */
size_t force_serialized_size(void);
void force_serialize(const force_state *state, uint8_t bytes[]);
bool force_deserialize(force_state *state, const uint8_t bytes[], size_t size);

#endif
