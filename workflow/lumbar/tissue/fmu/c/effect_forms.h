/* What the C code of a form may use: the motion that reaches it, and a few functions.
 *
 * The forms themselves are in model_data.h, which is written at export and holds those that the model uses.
 */
#ifndef LUMBAR_EFFECT_FORMS_H
#define LUMBAR_EFFECT_FORMS_H

#include <math.h>
#include <stdbool.h>

#include "model.h"
#include "portable_math.h"

/* Motion at a sample; derivatives are backward differences, 0 at the first sample. */
typedef struct {
    bool first;          /* the first sample since the start */
    double time;         /* s since the first sample */
#if MODEL_AXES > 1
    double position[MODEL_AXES];
    double step[MODEL_AXES]; /* change of position since the sample before */
    double velocity[MODEL_AXES];
    double acceleration[MODEL_AXES];
#else /* one axis */
    double position;
    double step;         /* change of position since the sample before */
    double velocity;
    double acceleration;
#endif /* MODEL_AXES */
    double path;         /* distance travelled */
    const model_past *past;
} motion;

/* The position so many samples ago, 0 to the form's history; `ring` is the form's. */
static inline double earlier(const motion *now, int ring, int samples) {
#if MODEL_AXES > 1
    if (samples == 0 || now->first) return now->position[ring % MODEL_AXES]; /* rings are those of all axes in turn */
#else /* one axis */
    if (samples == 0 || now->first) return now->position;
#endif /* MODEL_AXES */
    int64_t place = now->past->newest + 1 - samples;
    return now->past->value[ring][place < 0 ? place + MODEL_RING : place];
}

static inline double sign(double value) { return (double)((value > 0) - (value < 0)); }

static inline double clipped(double value, double low, double high) {
    return value < low ? low : value > high ? high : value;
}

static inline double smaller(double a, double b) { return a < b ? a : b; }

static inline double larger(double a, double b) { return a > b ? a : b; }

/* 3 x^2 - 2 x^3 between 0 and 1, constant outside. */
static inline double smoothstep(double x) {
    double share = clipped(x, 0.0, 1.0);
    return share * share * (3.0 - 2.0 * share);
}

/* (e^x - 1) / x: the mean of e^x over a step. */
static inline double phi1(double x) { return x == 0 ? 1.0 : portable_expm1(x) / x; }

/* Exponential Rosenbrock-Euler step of a few states: next = memory + phi1(matrix) increments.
 *
 * `matrix` has `size` rows; of the sum the first `states` count, for a clock may be among the unknowns. The series is that
 * of a matrix whose norm is at most 1/2, which is then doubled. */
#if MODEL_AXES > 1
enum { LARGEST_SYSTEM = 6 * MODEL_AXES + 1, SERIES_TERMS = 14 }; /* six states along every axis and a clock */
#else /* one axis */
enum { LARGEST_SYSTEM = 7, SERIES_TERMS = 14 }; /* six states and a clock */
#endif /* MODEL_AXES */
static inline void linearised_step(int states, int size, const double increments[], const double matrix[],
                                   const double memory[], double next[]) {
    double small[LARGEST_SYSTEM * LARGEST_SYSTEM], stretch[LARGEST_SYSTEM * LARGEST_SYSTEM] = {0};
    double product[LARGEST_SYSTEM * LARGEST_SYSTEM], norm = 0.0, scale = 1.0;
    int halvings = 0;
    for (int i = 0; i < size; ++i) {
        double sum = 0.0;
        for (int j = 0; j < size; ++j) sum += fabs(matrix[i * size + j]);
        norm = larger(norm, sum);
        stretch[i * size + i] = 1.0;
    }
    for (; norm * scale > 0.5 && halvings < 1000; ++halvings) scale *= 0.5;
    for (int i = 0; i < size * size; ++i) small[i] = matrix[i] * scale;
    for (int round = SERIES_TERMS; round >= 2 - halvings; --round) {
        for (int i = 0; i < size; ++i) {
            for (int j = 0; j < size; ++j) {
                double sum = 0.0;
                for (int k = 0; k < size; ++k) sum += small[i * size + k] * stretch[k * size + j];
                product[i * size + j] = sum;
            }
        }
        if (round >= 2) { /* Horner's rule: 1 + small stretch / round */
            for (int i = 0; i < size * size; ++i) stretch[i] = product[i] / round + (i % (size + 1) == 0);
            continue;
        }
        /* phi1(2 A) = (1 + A phi1(A) / 2) phi1(A) */
        double doubled[LARGEST_SYSTEM * LARGEST_SYSTEM];
        for (int i = 0; i < size; ++i) {
            for (int j = 0; j < size; ++j) {
                double sum = 0.0;
                for (int k = 0; k < size; ++k) sum += product[i * size + k] * stretch[k * size + j];
                doubled[i * size + j] = stretch[i * size + j] + 0.5 * sum;
            }
        }
        for (int i = 0; i < size * size; ++i) {
            stretch[i] = doubled[i];
            small[i] *= 2.0;
        }
    }
    for (int i = 0; i < states; ++i) {
        double sum = 0.0;
        for (int j = 0; j < size; ++j) sum += stretch[i * size + j] * increments[j];
        next[i] = memory[i] + sum;
    }
}

/* Position behind a gap of half-width `gap`; at the start it is in the middle. */
static inline double behind_gap(double before, double position, double gap, bool first) {
    return clipped(first ? position : before, position - gap, position + gap);
}

#endif
