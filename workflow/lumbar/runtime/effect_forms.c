#include "effect_forms.h"

#include <math.h>

#include "portable_math.h"

#define FORM(name) double name(const double p[], const double x[], double next[], const motion *now, double value)
#define UNUSED_MEMORY (void)x, (void)next
#define ADDS_FORCE (void)value
#define MEMORYLESS UNUSED_MEMORY, ADDS_FORCE

static double sign(double value) { return (double)((value > 0) - (value < 0)); }

static double clipped(double value, double low, double high) { return value < low ? low : value > high ? high : value; }

/* Base models: p = stiffness; viscosity; stiffness, pole and gain of the ramp-invariant relaxation. */

FORM(base_spring) {
    MEMORYLESS;
    return p[0] * now->position;
}

FORM(base_dashpot) {
    MEMORYLESS;
    return p[0] * now->velocity;
}

FORM(base_maxwell_branch) {
    ADDS_FORCE;
    next[0] = p[1] * x[0] + p[2] * now->step;
    return p[0] * next[0];
}

/* Stiffness. */

FORM(hardening_stiffness_cubic) {
    MEMORYLESS;
    return p[0] * (now->position * now->position * now->position);
}

FORM(hardening_stiffness_exponential) {
    MEMORYLESS;
    return p[0] * (sign(now->position) * portable_expm1(fabs(now->position) / p[1]));
}

FORM(hardening_stiffness_bilinear) {
    MEMORYLESS;
    double beyond = fabs(now->position) - p[1];
    return p[0] * (sign(now->position) * (beyond > 0 ? beyond : 0.0));
}

FORM(quadratic_stiffness_quadratic) {
    MEMORYLESS;
    return p[0] * (now->position * now->position);
}

FORM(quadratic_stiffness_two_sided) {
    MEMORYLESS;
    return p[0] * fabs(now->position);
}

/* Friction. */

FORM(coulomb_friction_coulomb) {
    MEMORYLESS;
    return p[0] * portable_tanh(now->velocity / p[1]);
}

FORM(coulomb_friction_arctangent) {
    static const double TWO_OVER_PI = 0.63661977236758134308;
    MEMORYLESS;
    return p[0] * (TWO_OVER_PI * portable_arctan(now->velocity / p[1]));
}

FORM(coulomb_friction_stribeck) {
    MEMORYLESS;
    double sliding = portable_tanh(now->velocity / p[2]), ratio = now->velocity / p[3];
    return p[0] * sliding + p[1] * (sliding * portable_decay(ratio * ratio));
}

/* Memory: share of the limit. Along one direction it approaches 1 exponentially with the distance. */
FORM(hysteresis_dahl) {
    ADDS_FORCE;
    double direction = sign(now->step);
    next[0] = direction == 0 ? x[0] : direction + (x[0] - direction) * portable_decay(fabs(now->step) / p[1]);
    return p[0] * next[0];
}

/* Memory: share of the limit. Unloading is straight; loading adds travels as tanh(a + b) does. */
FORM(hysteresis_bouc_wen) {
    ADDS_FORCE;
    double direction = sign(now->step), share = direction * x[0], travel = fabs(now->step) / p[1];
    if (direction == 0) {
        next[0] = x[0];
    } else if (share + travel < 0) {
        next[0] = direction * (share + travel);
    } else {
        if (share < 0) {
            travel += share;
            share = 0;
        }
        double added = portable_tanh(travel);
        next[0] = direction * ((share + added) / (1.0 + share * added));
    }
    return p[0] * next[0];
}

/* Position behind a gap of half-width `gap`; at the start it is in the middle. */
static double behind_gap(double before, double position, double gap, bool first) {
    return clipped(first ? position : before, position - gap, position + gap);
}

/* Memory: the slider's position. */
FORM(hysteresis_elastoplastic) {
    ADDS_FORCE;
    next[0] = behind_gap(x[0], now->position, p[1], now->first);
    return p[0] * ((now->position - next[0]) / p[1]);
}

/* Damping and inertia. */

FORM(depth_dependent_damping_bilinear) {
    MEMORYLESS;
    return p[0] * (now->position * now->velocity) + p[1] * now->velocity;
}

FORM(depth_dependent_damping_one_sided) {
    MEMORYLESS;
    double depth = now->position > 0 ? now->position : 0.0;
    return p[0] * (depth * now->velocity) + p[1] * now->velocity;
}

FORM(quadratic_damping_quadratic) {
    MEMORYLESS;
    return p[0] * (now->velocity * fabs(now->velocity));
}

FORM(quadratic_damping_power) {
    MEMORYLESS;
    return p[0] * (sign(now->velocity) * portable_power(fabs(now->velocity), p[1]));
}

FORM(quadratic_damping_sinh) {
    MEMORYLESS;
    return p[0] * portable_sinh(now->velocity / p[1]);
}

FORM(inertia_mass) {
    MEMORYLESS;
    return p[0] * now->acceleration;
}

/* Time and path. */

FORM(drift_linear) {
    MEMORYLESS;
    return p[0] * now->time;
}

FORM(drift_settling) {
    MEMORYLESS;
    return p[0] * -portable_expm1(-now->time / p[1]);
}

FORM(softening_path) {
    MEMORYLESS;
    return p[0] * (-now->position * portable_expm1(-now->path / p[1]));
}

FORM(softening_time) {
    MEMORYLESS;
    return p[0] * (-now->position * portable_expm1(-now->time / p[1]));
}

FORM(softening_whole_force) {
    UNUSED_MEMORY;
    return value * (1.0 + p[0] * portable_expm1(-now->path / p[1]));
}

FORM(periodic_disturbance_sine) {
    MEMORYLESS;
    double turns = p[2] * now->time;
    return p[0] * portable_sine(turns) + p[1] * portable_cosine(turns);
}

/* On the way to the tissue. */

FORM(backlash_play) {
    next[0] = behind_gap(x[0], value, p[0], now->first);
    return next[0];
}

/* p = whole samples, share of a sample. Memory: the positions before, newest first; linear in between. */
FORM(delay_pure) {
    int whole = (int)p[0];
    if (now->first) {
        for (int i = 0; i <= whole; ++i) next[i] = value;
        return value;
    }
    for (int i = whole; i > 0; --i) next[i] = x[i - 1];
    next[0] = value;
    double newer = whole == 0 ? value : x[whole - 1], older = x[whole];
    return newer + p[1] * (older - newer);
}

/* On the way to the sensor. */

FORM(contact_loss_sharp) {
    UNUSED_MEMORY, (void)now;
    return value > -p[0] ? value : -p[0];
}

FORM(contact_loss_soft) {
    UNUSED_MEMORY, (void)now;
    return p[1] * portable_softplus((value + p[0]) / p[1]) - p[0];
}

FORM(saturation_sharp) {
    UNUSED_MEMORY, (void)now;
    return clipped(value, -p[0], p[0]);
}

FORM(saturation_soft) {
    UNUSED_MEMORY, (void)now;
    return p[0] * portable_tanh(value / p[0]);
}
