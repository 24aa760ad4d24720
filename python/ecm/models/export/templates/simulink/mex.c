/* [h, K] = @NAME@_mex(p), and with effects of time [h, K, state] = @NAME@_mex(p, dt, state, inputs).
 *
 * p: pose (6); h: wrench that holds the platform (6 x 1); K = dh/dp (6 x 6).
 * state: 49 numbers, [] for an infinite rest at p; inputs: [temperature_degC, age_s], [] for none.
 * Compile: mex @NAME@_mex.c @NAME@.c   (MATLAB, or Octave: mkoctfile --mex @NAME@_mex.c @NAME@.c)
 */
#include <string.h>

#include "mex.h"

#include "@NAME@.h"

/* Whether an argument is real, double, and of this many numbers */
static int is_real(const mxArray *array, size_t count)
{
    return mxIsDouble(array) && !mxIsComplex(array) && mxGetNumberOfElements(array) == count;
}

void mexFunction(int outputs, mxArray *out[], int inputs, const mxArray *in[])
{
    double k[36];
    double *h, *turned;
    if (inputs < 1 || !is_real(in[0], 6)) {
        mexErrMsgTxt("@NAME@: expected a pose of 6 numbers");
    }
    out[0] = mxCreateDoubleMatrix(6, 1, mxREAL);
    h = mxGetPr(out[0]);
#if @STEPS@
    if (inputs == 2) {
        mexErrMsgTxt("@NAME@: a step needs p, dt and a state, [] at the beginning");
    }
    if (inputs > 2) {
        @NAME@_state state;
        const int begins = mxIsEmpty(in[2]);
        const int known = inputs > 3 && !mxIsEmpty(in[3]);
        @NAME@_conditions conditions = @NAME@_default_conditions;
        if (!is_real(in[1], 1)) {
            mexErrMsgTxt("@NAME@: expected dt, one number");
        }
        if (known && !is_real(in[3], 2)) {
            mexErrMsgTxt("@NAME@: expected [temperature_degC, age_s], or []");
        }
        if (!begins && !is_real(in[2], sizeof state / sizeof(double))) {
            mexErrMsgTxt("@NAME@: expected the state of an earlier call, or []");
        }
        if (begins) {
            if (!@NAME@_init(&state, mxGetPr(in[0]))) {
                mexErrMsgTxt("@NAME@: no wrench at this pose");
            }
        } else {
            memcpy(&state, mxGetPr(in[2]), sizeof state);
        }
        if (known) {
            conditions.temperature_degC = mxGetPr(in[3])[0];
            conditions.age_s = mxGetPr(in[3])[1];
        }
        if (!@NAME@_step(&state, mxGetPr(in[0]), mxGetScalar(in[1]), &conditions, h, k)) {
            mexErrMsgTxt("@NAME@: no step to this pose");
        }
        if (outputs > 2) {
            out[2] = mxCreateDoubleMatrix(sizeof state / sizeof(double), 1, mxREAL);
            memcpy(mxGetPr(out[2]), &state, sizeof state);
        }
    } else
#endif
    {
        @NAME@_value_and_stiffness(mxGetPr(in[0]), h, k);
    }
    if (outputs > 1) {
        out[1] = mxCreateDoubleMatrix(6, 6, mxREAL);
        turned = mxGetPr(out[1]);
        for (int i = 0; i < 36; i++) {
            turned[6 * (i % 6) + i / 6] = k[i]; /* column by column */
        }
    }
}
