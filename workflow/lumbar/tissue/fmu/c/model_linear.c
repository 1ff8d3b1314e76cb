/* Linear discrete-time state space:  x[k+1] = A x[k] + B u[k],  y[k] = C x[k] + D u[k].
 *
 * The numbers are in model_data.h, which is written at export: A, B, C, D as hexadecimal floats (exact), the
 * constants as MODEL_CONSTANTS; MODEL_REST is x at rest at u = 1.
 */
#include "model.h"
#include "model_data.h"

const model_constants MODEL = MODEL_CONSTANTS;

double model_sample(const double x[], const model_past *past, double u, double next[]) {
    (void)past;
    double y = MODEL_D * u;
    for (int i = 0; i < LINEAR_STATES; ++i) {
        y += MODEL_C[i] * x[i];
        next[i] = MODEL_B[i] * u;
        for (int j = 0; j < LINEAR_STATES; ++j) next[i] += MODEL_A[i][j] * x[j];
    }
    return y;
}

void model_keep(const double x[], const double next[], model_past *past) { (void)x, (void)next, (void)past; }

void model_rest(double u, double x[]) {
    for (int i = 0; i < LINEAR_STATES; ++i) x[i] = MODEL_REST[i] * u;
}

double model_slope(const double x[], const model_past *past, double u, bool at_rest) {
    (void)x, (void)past, (void)u;
    if (!at_rest) return MODEL_D;
    double slope = MODEL_D;
    for (int i = 0; i < LINEAR_STATES; ++i) slope += MODEL_C[i] * MODEL_REST[i];
    return slope;
}
