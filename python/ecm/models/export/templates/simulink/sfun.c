/* A level-2 S-function of the model @NAME@. Compile: mex @NAME@_sfun.c @NAME@.c
 *
 * Input 1: pose (6). Output 1: wrench that holds the platform (6); output 2: K = dh/dp (6 x 6).
 * With effects of time also input 2: temperature_degC and age_s, and one parameter: the sample time.
 *
 * A C Caller block needs no S-function: @NAME@_value and @NAME@_value_and_stiffness of @NAME@.h have
 * arrays of fixed size; set the ports of h and k to Output.
 */
#define S_FUNCTION_NAME @NAME@_sfun
#define S_FUNCTION_LEVEL 2

#include <string.h>

#include "simstruc.h"

#include "@NAME@.h"

#define HAS_STATE @STEPS@

static void mdlInitializeSizes(SimStruct *s)
{
    ssSetNumSFcnParams(s, HAS_STATE);
    if (ssGetNumSFcnParams(s) != ssGetSFcnParamsCount(s)) {
        return; /* Simulink says so */
    }
    if (!ssSetNumInputPorts(s, 1 + HAS_STATE) || !ssSetNumOutputPorts(s, 2)) {
        return;
    }
    ssSetInputPortWidth(s, 0, 6);
    ssSetInputPortDirectFeedThrough(s, 0, 1);
    ssSetInputPortRequiredContiguous(s, 0, 1);
#if HAS_STATE
    ssSetInputPortWidth(s, 1, 2);
    ssSetInputPortDirectFeedThrough(s, 1, 1);
    ssSetInputPortRequiredContiguous(s, 1, 1);
    ssSetNumDWork(s, 2); /* the state, and whether it has begun */
    ssSetDWorkWidth(s, 0, sizeof(@NAME@_state) / sizeof(double));
    ssSetDWorkDataType(s, 0, SS_DOUBLE);
    ssSetDWorkUsedAsDState(s, 0, SS_DWORK_USED_AS_DSTATE);
    ssSetDWorkWidth(s, 1, 1);
    ssSetDWorkDataType(s, 1, SS_DOUBLE);
    ssSetDWorkUsedAsDState(s, 1, SS_DWORK_USED_AS_DSTATE);
#endif
    ssSetOutputPortWidth(s, 0, 6);
    ssSetOutputPortMatrixDimensions(s, 1, 6, 6);
    ssSetNumSampleTimes(s, 1);
    ssSetOptions(s, SS_OPTION_EXCEPTION_FREE_CODE);
}

static void mdlInitializeSampleTimes(SimStruct *s)
{
    ssSetSampleTime(s, 0, HAS_STATE ? mxGetScalar(ssGetSFcnParam(s, 0)) : INHERITED_SAMPLE_TIME);
    ssSetOffsetTime(s, 0, 0.0);
}

#if HAS_STATE
#define MDL_INITIALIZE_CONDITIONS
static void mdlInitializeConditions(SimStruct *s)
{
    *(double *)ssGetDWork(s, 1) = 0.0;
}

/* The state after a step to the input, with h and k. */
static void stepped(SimStruct *s, @NAME@_state *state, double *h, double *k)
{
    const double *pose = (const double *)ssGetInputPortSignal(s, 0);
    const double *given = (const double *)ssGetInputPortSignal(s, 1);
    const @NAME@_conditions inputs = {given[0], given[1]};
    const double begun = *(double *)ssGetDWork(s, 1);
    memcpy(state, ssGetDWork(s, 0), sizeof *state);
    if (begun == 0.0) {
        @NAME@_init(state, pose);
    }
    @NAME@_step(state, pose, begun * mxGetScalar(ssGetSFcnParam(s, 0)), &inputs, h, k);
}

#define MDL_UPDATE
static void mdlUpdate(SimStruct *s, int_T task)
{
    double h[6], k[36];
    @NAME@_state state;
    (void)task;
    stepped(s, &state, h, k);
    memcpy(ssGetDWork(s, 0), &state, sizeof state);
    *(double *)ssGetDWork(s, 1) = 1.0;
}
#endif

static void mdlOutputs(SimStruct *s, int_T task)
{
    double k[36];
    double *h = (double *)ssGetOutputPortSignal(s, 0);
    double *turned = (double *)ssGetOutputPortSignal(s, 1);
    (void)task;
#if HAS_STATE
    @NAME@_state state;
    stepped(s, &state, h, k);
#else
    @NAME@_value_and_stiffness((const double *)ssGetInputPortSignal(s, 0), h, k);
#endif
    for (int i = 0; i < 36; i++) {
        turned[6 * (i % 6) + i / 6] = k[i]; /* column by column */
    }
}

static void mdlTerminate(SimStruct *s)
{
    (void)s;
}

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
