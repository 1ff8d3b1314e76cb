/* The model part of an FMU: what a model must provide, whatever its equations.
 *
 * Files that include this header do not know the model; `model_linear.c` is one that does. Input and output are
 * deviations from rest: position less its offset, force less its offset.
 */
#ifndef LUMBAR_MODEL_H
#define LUMBAR_MODEL_H

#define MODEL_MAX_STATES 16
#define MODEL_MAX_WINDOW 16

typedef struct {
    const char *token;       /* content hash: the FMU's GUID (FMI 2) and instantiation token (FMI 3) */
    double sampling_time;    /* s */
    double input_offset;     /* input at which the model is at rest */
    double output_offset;    /* output at rest */
    double output_limit;     /* largest magnitude of the output that the device may receive */
    double gain_limit;       /* largest factor on the model's output */
    int states;              /* number of states, at most MODEL_MAX_STATES */
    int window;              /* samples of the moving average on the input, 1 = off, at most MODEL_MAX_WINDOW */
    int feedthrough;         /* 1 where the output depends on the input of the same sample */
} model_constants;

extern const model_constants MODEL;

/* y[k] = h(x[k], u[k]) */
double model_output(const double x[], double u);

/* x[k+1] = f(x[k], u[k]), in place */
void model_step(double x[], double u);

#endif
