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

#include "model_size.h" /* MODEL_STATES, written at export */

#define MODEL_MAX_WINDOW 16

typedef struct {
    const char *token;       /* content hash: the FMU's GUID (FMI 2) and instantiation token (FMI 3) */
    double sampling_time;    /* s */
    double input_offset;     /* input at which the model is at rest */
    double output_offset;    /* output at rest */
    double output_limit;     /* largest magnitude of the output that the device may receive */
    double gain_limit;       /* largest factor on the model's output */
    int window;              /* samples of the moving average on the input, 1 = off, at most MODEL_MAX_WINDOW */
    int feedthrough;         /* 1 where the output depends on the input of the same sample */
    int waits_for_input;     /* 1 where an output without the input of its sample would be meaningless */
} model_constants;

extern const model_constants MODEL;

/* Sample k: returns y[k] = h(x[k], u[k]) and writes x[k+1] = f(x[k], u[k]) to `next`, which must not be `x`. */
double model_sample(const double x[], double u, double next[]);

/* Derivative of y[k] by u[k]. */
double model_slope(const double x[], double u);

#endif
