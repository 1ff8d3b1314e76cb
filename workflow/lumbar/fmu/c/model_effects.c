/* A base model with effects, sample by sample:
 *
 *   position --(input forms)--> position at the tissue --(base and parallel forms, summed)--> force --(output forms)-->
 *
 * The forms with their numbers are in model_data.h, which is written at export. Velocity and acceleration are backward
 * differences of the sampled position: no later sample is known while the device runs.
 */
#include "effect_forms.h"
#include "model.h"
#include "portable_math.c" /* what is constant in a form is then computed by the compiler */

typedef struct {
    form_function *run;
    int memory; /* where its part of the state begins */
} term;

#include "model_data.h"

const model_constants MODEL = MODEL_CONSTANTS;

/* The state: samples taken; position, velocity and path of the tool and behind each input form; the forms' memories. */
enum { SAMPLES_TAKEN, TOOL };
enum { POSITION, VELOCITY, PATH, MOTION_STATES };

static motion moved_to(double position, double samples_taken, const double x[], double next[]) {
    bool first = samples_taken == 0.0;
    motion now = {.first = first, .time = samples_taken * MODEL.sampling_time, .position = position};
    if (!first) {
        now.step = position - x[POSITION];
        now.velocity = now.step / MODEL.sampling_time;
        now.acceleration = (now.velocity - x[VELOCITY]) / MODEL.sampling_time;
        now.path = x[PATH] + fabs(now.step);
    }
    next[POSITION] = now.position;
    next[VELOCITY] = now.velocity;
    next[PATH] = now.path;
    return now;
}

double model_sample(const double x[], double u, double next[]) {
    const term *form = MODEL_TERMS;
    double samples_taken = x[SAMPLES_TAKEN];
    next[SAMPLES_TAKEN] = samples_taken + 1.0;
    motion tool = moved_to(u, samples_taken, x + TOOL, next + TOOL);
    motion tissue = tool;
    for (int i = 1; i <= MODEL_INPUT_FORMS; ++i, ++form) {
        double position = form->run(x + form->memory, next + form->memory, &tissue, 0.0);
        tissue = moved_to(position, samples_taken, x + TOOL + i * MOTION_STATES, next + TOOL + i * MOTION_STATES);
    }
    double force = 0.0;
    for (int i = 0; i < MODEL_PARALLEL_FORMS; ++i, ++form) {
        force += form->run(x + form->memory, next + form->memory, &tissue, 0.0);
    }
    for (int i = 0; i < MODEL_OUTPUT_FORMS; ++i, ++form) {
        force = form->run(x + form->memory, next + form->memory, &tool, force);
    }
    return force;
}

/* At the first sample every form rests where it is. */
void model_rest(double u, double x[]) {
    (void)u;
    for (int i = 0; i < MODEL_STATES; ++i) x[i] = 0.0;
}

/* Central difference: the forms have kinks, where a derivative does not exist; far from them it is good to 1e-6. */
double model_slope(const double x[], double u, bool at_rest) {
    (void)at_rest;
    static const double STEP = 0x1p-23; /* about 1e-7 of the input's unit; a power of two is added without error */
    double next[MODEL_STATES];
    return (model_sample(x, u + STEP, next) - model_sample(x, u - STEP, next)) / (2.0 * STEP);
}
