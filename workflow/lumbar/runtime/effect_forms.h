/* Forces and transformations of a model with effects, one function per mathematical form.
 *
 * All have the same signature. `p` holds the form's numbers as written at export, `x` and `next` its part of the state
 * before and after the sample. `value` is what the form transforms: the position for forms on the way to the tissue,
 * the force for forms on the way to the sensor; forms that add a force return it and do not use `value`.
 */
#ifndef LUMBAR_EFFECT_FORMS_H
#define LUMBAR_EFFECT_FORMS_H

#include <stdbool.h>

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

typedef double form_function(const double p[], const double x[], double next[], const motion *now, double value);

form_function base_spring, base_dashpot, base_maxwell_branch;
form_function hardening_stiffness_cubic, hardening_stiffness_exponential, hardening_stiffness_bilinear;
form_function quadratic_stiffness_quadratic, quadratic_stiffness_two_sided;
form_function coulomb_friction_coulomb, coulomb_friction_arctangent, coulomb_friction_stribeck;
form_function hysteresis_dahl, hysteresis_bouc_wen, hysteresis_elastoplastic;
form_function contact_loss_sharp, contact_loss_soft;
form_function depth_dependent_damping_bilinear, depth_dependent_damping_one_sided;
form_function quadratic_damping_quadratic, quadratic_damping_power, quadratic_damping_sinh;
form_function inertia_mass;
form_function delay_pure;
form_function saturation_sharp, saturation_soft;
form_function drift_linear, drift_settling;
form_function softening_path, softening_time, softening_whole_force;
form_function periodic_disturbance_sine;
form_function backlash_play;

#endif
