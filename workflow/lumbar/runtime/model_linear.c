/* Linear discrete-time state space:  x[k+1] = A x[k] + B u[k],  y[k] = C x[k] + D u[k].
 *
 * The numbers are in model_data.h, which is written at export: A, B, C, D as hexadecimal floats (exact), the
 * constants as MODEL_CONSTANTS.
 */
#include "model.h"
#include "model_data.h"

const model_constants MODEL = MODEL_CONSTANTS;

double model_output(const double x[], double u) {
    double y = MODEL_D * u;
    for (int i = 0; i < MODEL_STATES; ++i) y += MODEL_C[i] * x[i];
    return y;
}

void model_step(double x[], double u) {
    double next[MODEL_MAX_STATES];
    for (int i = 0; i < MODEL_STATES; ++i) {
        next[i] = MODEL_B[i] * u;
        for (int j = 0; j < MODEL_STATES; ++j) next[i] += MODEL_A[i][j] * x[j];
    }
    for (int i = 0; i < MODEL_STATES; ++i) x[i] = next[i];
}
