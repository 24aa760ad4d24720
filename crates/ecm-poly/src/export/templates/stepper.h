
/* Effects of time: @EFFECTS@.
 *
 * A state holds what the mechanism remembers: @STATE@ bytes of plain numbers, to be copied, stored and
 * loaded as they are. init sets it after an infinite rest at p. step takes the measured p dt seconds
 * after the step before and gives the wrench and its derivative to p; the way between two steps counts
 * as straight and even, so that dt may vary and a pause of hours is exact. dt = 0 is a sudden move.
 * settled gives the limit of a long rest at p, without friction, softening and set.
 * predict_ahead steps a copy of the state through count planned ones (p one after another, dt apart) and
 * returns how many were taken; the results of the first that is refused are NaN, those beyond it untouched.
 * For each p h takes @M@ and k @NM@ numbers. k may be 0: then the derivative is not written.
 * init, step and settled return 1. Where p, an input or the state is not finite, |theta| > pi, p is
 * farther than four times the measured ones, or dt < 0 or not finite, they return 0, the results are
 * NaN and the state stays as it was: the next dt counts from the last step that returned 1.
 *
 * Inputs: name, default (changes nothing), range for which the model was measured.
@INPUTTABLE@
 * inputs may be 0: then @NAME@_default_conditions. Outside the range steps extrapolate and stay finite.
 * Stack of step: at most @STEPSTACK@ bytes; predict_ahead @AHEADSTACK@.
 */
typedef struct {
    @NAME@_real farthest[@N@];               /* p of the largest work so far */
    @NAME@_real coordinates[@N@], force[@M@];  /* of the last step@INFRAME@ */
    @NAME@_real stretch[@SPRINGS@][@N@];             /* of springs that slip, m and rad */
    @NAME@_real memory[2][@M@], carry[2][@M@]; /* of relaxing branches, N and N m */
    @NAME@_real largest;                   /* largest work so far, J */
} @NAME@_state;

typedef struct {
    @NAME@_real temperature_degC; /* of the mechanism */
    @NAME@_real age_s;            /* since the campaign in which ageing was found began */
} @NAME@_conditions;

extern const @NAME@_conditions @NAME@_default_conditions;
extern const @NAME@_conditions @NAME@_least_conditions;
extern const @NAME@_conditions @NAME@_largest_conditions;

/* 1 where every input is in its range, else 0 */
int32_t @NAME@_inputs_inside(const @NAME@_conditions *inputs);

int32_t @NAME@_init(@NAME@_state *state, const @NAME@_real p[@N@]);
int32_t @NAME@_step(@NAME@_state *state, const @NAME@_real p[@N@], @NAME@_real dt,
                    const @NAME@_conditions *inputs, @NAME@_real h[@M@], @NAME@_real k[@NM@]);
/* The wrench of each relaxing branch with share 1, at p of the last step@FORADAPT@. */
void @NAME@_branches(const @NAME@_state *state, @NAME@_real wrenches[2 * @M@]);
int32_t @NAME@_settled(const @NAME@_real p[@N@], const @NAME@_conditions *inputs, @NAME@_real h[@M@],
                       @NAME@_real k[@NM@]);
int32_t @NAME@_predict_ahead(const @NAME@_state *state, const @NAME@_real *p, int32_t count,
                             @NAME@_real dt, const @NAME@_conditions *inputs, @NAME@_real *h,
                             @NAME@_real *k);
