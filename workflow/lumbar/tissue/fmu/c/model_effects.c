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

#include "model_data.h"

const model_constants MODEL = MODEL_CONSTANTS;

/* The state: samples taken; position, velocity and path of the tool and behind each input form; the forms' memories. */
enum { SAMPLES_TAKEN, TOOL };
#if MODEL_AXES > 1
enum { POSITION, VELOCITY = POSITION + MODEL_AXES, PATH = VELOCITY + MODEL_AXES, MOTION_STATES };

static motion moved_to(const double position[], double samples_taken, const model_past *past, const double x[],
                       double next[]) {
    bool first = samples_taken == 0.0;
    motion now = {.first = first, .time = samples_taken * MODEL.sampling_time, .past = past};
    double square = 0.0;
    for (int i = 0; i < MODEL_AXES; ++i) {
        now.position[i] = position[i];
        if (!first) {
            now.step[i] = position[i] - x[POSITION + i];
            now.velocity[i] = now.step[i] / MODEL.sampling_time;
            now.acceleration[i] = (now.velocity[i] - x[VELOCITY + i]) / MODEL.sampling_time;
        }
        square += now.step[i] * now.step[i];
        next[POSITION + i] = now.position[i];
        next[VELOCITY + i] = now.velocity[i];
    }
    if (!first) now.path = x[PATH] + sqrt(square);
    next[PATH] = now.path;
    return now;
}
#else /* one axis */
enum { POSITION, VELOCITY, PATH, MOTION_STATES };

static motion moved_to(double position, double samples_taken, const model_past *past, const double x[], double next[]) {
    bool first = samples_taken == 0.0;
    motion now = {.first = first, .time = samples_taken * MODEL.sampling_time, .position = position, .past = past};
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
#endif /* MODEL_AXES */

/* MODEL_FORMS names the forms in their order, each with the place of its memory in the state and, input forms, of the motion
 * behind it: one call after the other, which the compiler can draw together. */
#if MODEL_AXES > 1
#define INPUT_FORM(form, memory, behind)                                                      \
    form(x + (memory), next + (memory), &tissue, moved);                                      \
    tissue = moved_to(moved, samples_taken, past, x + (behind), next + (behind));
#define PARALLEL_FORM(form, memory) form(x + (memory), next + (memory), &tissue, force);
#define OUTPUT_FORM(form, memory) form(x + (memory), next + (memory), &tool, force);

void model_sample(const double x[], const model_past *past, const double u[], double next[], double force[]) {
    double samples_taken = x[SAMPLES_TAKEN], moved[MODEL_AXES] = {0};
    next[SAMPLES_TAKEN] = samples_taken + 1.0;
    for (int i = 0; i < MODEL_AXES; ++i) force[i] = 0.0;
    motion tool = moved_to(u, samples_taken, past, x + TOOL, next + TOOL), tissue = tool;
    MODEL_FORMS
    (void)tissue, (void)moved;
}
#else /* one axis */
#define INPUT_FORM(form, memory, behind) \
    tissue = moved_to(form(x + (memory), next + (memory), &tissue, 0.0), samples_taken, past, x + (behind), next + (behind));
#define PARALLEL_FORM(form, memory) force += form(x + (memory), next + (memory), &tissue, 0.0);
#define OUTPUT_FORM(form, memory) force = form(x + (memory), next + (memory), &tool, force);

double model_sample(const double x[], const model_past *past, double u, double next[]) {
    double samples_taken = x[SAMPLES_TAKEN], force = 0.0;
    next[SAMPLES_TAKEN] = samples_taken + 1.0;
    motion tool = moved_to(u, samples_taken, past, x + TOOL, next + TOOL), tissue = tool;
    MODEL_FORMS
    (void)tissue;
    return force;
}
#endif /* MODEL_AXES */

/* Before the first sample every signal was what it is then. */
void model_keep(const double x[], const double next[], model_past *past) {
    past->newest = past->newest + 1 < MODEL_RING ? past->newest + 1 : 0;
    for (int ring = 0; ring < MODEL_RINGS; ++ring) {
        double value = next[MODEL_KEPT[ring]];
        past->value[ring][past->newest] = value;
        if (x[SAMPLES_TAKEN] != 0.0) continue;
        for (int i = 0; i < MODEL_RING; ++i) past->value[ring][i] = value;
    }
}

/* At the first sample every form rests where it is. */
#if MODEL_AXES > 1
void model_rest(const double u[], double x[]) {
#else /* one axis */
void model_rest(double u, double x[]) {
#endif /* MODEL_AXES */
    (void)u;
    for (int i = 0; i < MODEL_STATES; ++i) x[i] = 0.0;
}
#if MODEL_AXES > 1
#else /* one axis */

/* Central difference: the forms have kinks, where a derivative does not exist; far from them it is good to 1e-6. */
double model_slope(const double x[], const model_past *past, double u, bool at_rest) {
    (void)at_rest;
    static const double STEP = 0x1p-23; /* about 1e-7 of the input's unit; a power of two is added without error */
    double next[MODEL_STATES];
    return (model_sample(x, past, u + STEP, next) - model_sample(x, past, u - STEP, next)) / (2.0 * STEP);
}
#endif /* MODEL_AXES */
