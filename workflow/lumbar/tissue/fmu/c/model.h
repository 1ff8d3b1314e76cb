/* The model part of an FMU: what a model must provide, whatever its equations.
 *
 * Files that include this header do not know the model; `model_linear.c` and `model_effects.c` are two that do. Input
 * and output are deviations from rest: position less its offset, force less its offset.
 */
#ifndef LUMBAR_MODEL_H
#define LUMBAR_MODEL_H

/* Products and sums rounded one by one, as on every platform. gcc knows the option -ffp-contract=off instead, which
 * -std=c99 implies. */
#if defined(__clang__) || !defined(__GNUC__)
#pragma STDC FP_CONTRACT OFF
#endif

/* MODEL_STATES, and the samples of: MODEL_WINDOW, the moving average on the input, 1 = off; MODEL_DELAY, how late the
 * model gets it; MODEL_PHASES, the time between two samples of the model itself, which has as many states in turn;
 * MODEL_HISTORY, earlier inputs kept; MODEL_RING, earlier values kept of each of MODEL_RINGS of its own signals. Written at
 * export. */
#include <stdbool.h>
#include <stdint.h>

#include "model_size.h"

typedef struct {
    const char *token;       /* content hash: the FMU's GUID (FMI 2) and instantiation token (FMI 3) */
    double sampling_time;    /* s */
    double input_offset;     /* input at which the model is at rest */
    double output_offset;    /* output at rest */
    double output_limit;     /* largest magnitude of the output that the device may receive */
    double gain_limit;       /* largest factor on the model's output */
    double rate_limit;       /* largest change of the output in a second; 0 = none */
    double device_damping;   /* N s/m that the device surely has; 0 = the model is not made passive */
    double energy_reserve;   /* most energy that counts as taken in, J */
    double input_unit;       /* of the input in m or rad, for energies */
    double output_unit;      /* of the output in N or N m */
    double resistance;       /* sign of the output that resists a growing input: 1 or -1 */
    int contact;             /* 1 where the model ends at rest: no input below it, no output that pulls */
    int guarded;             /* 1 with a limit on the rate, or passive */
    int starts_at_rest;      /* 1 where the model rests at the first input, 0 at its offset */
    int feedthrough;         /* 1 where the output depends on the input of the same sample */
    int waits_for_input;     /* 1 where an output without the input of its sample would be meaningless */
} model_constants;

extern const model_constants MODEL;

/* Values of a model's own signals at the samples before, as rings: a long delay costs a step no more than a short one. */
#define AT_LEAST_ONE(size) ((size) > 0 ? (size) : 1) /* C has no arrays of length 0 */
typedef struct {
    double value[AT_LEAST_ONE(MODEL_RINGS)][AT_LEAST_ONE(MODEL_RING)];
    int64_t newest; /* place of the newest value in every ring */
} model_past;

#if MODEL_AXES > 1
/* Sample k: writes y[k] = h(x[k], u[k]), a force along every axis, and x[k+1] = f(x[k], u[k]) to `next`, which must not be `x`. */
void model_sample(const double x[], const model_past *past, const double u[], double next[], double y[]);
#else /* one axis */
/* Sample k: returns y[k] = h(x[k], u[k]) and writes x[k+1] = f(x[k], u[k]) to `next`, which must not be `x`. */
double model_sample(const double x[], const model_past *past, double u, double next[]);
#endif /* MODEL_AXES */

/* Keep of sample k, which led from x to next, what later samples ask for. */
void model_keep(const double x[], const double next[], model_past *past);

#if MODEL_AXES > 1
/* States at rest at a constant input. */
void model_rest(const double u[], double x[]);
#else /* one axis */
/* States at rest at a constant input. */
void model_rest(double u, double x[]);

/* Derivative of y[k] by u[k]; at rest, by an input that has always been u. */
double model_slope(const double x[], const model_past *past, double u, bool at_rest);
#endif /* MODEL_AXES */

#endif
