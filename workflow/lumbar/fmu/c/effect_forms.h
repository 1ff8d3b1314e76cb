/* What the C code of a form may use: the motion that reaches it, and a few functions.
 *
 * The forms themselves are in model_data.h, which is written at export and holds those that the model uses.
 */
#ifndef LUMBAR_EFFECT_FORMS_H
#define LUMBAR_EFFECT_FORMS_H

#include <math.h>
#include <stdbool.h>

#include "portable_math.h"

/* Motion at a sample; derivatives are backward differences, 0 at the first sample. */
typedef struct {
    bool first;          /* the first sample since the start */
    double time;         /* s since the first sample */
    double position;
    double step;         /* change of position since the sample before */
    double velocity;
    double acceleration;
    double path;         /* distance travelled */
} motion;

/* `memory` and `next` are the form's part of the state before and after the sample, `force` is what output forms
 * transform. Returned is the position that an input form passes on, else a force. */
typedef double form_function(const double memory[], double next[], const motion *now, double force);

static inline double sign(double value) { return (double)((value > 0) - (value < 0)); }

static inline double clipped(double value, double low, double high) {
    return value < low ? low : value > high ? high : value;
}

/* Position behind a gap of half-width `gap`; at the start it is in the middle. */
static inline double behind_gap(double before, double position, double gap, bool first) {
    return clipped(first ? position : before, position - gap, position + gap);
}

#endif
