/* @TITLE@
 *
 * Inputs @INPUTS@; outputs @OUTPUTS@;
 * k = d(outputs)/d(inputs), @M@ x @N@ row by row. Model file sha256 @SUM@.
 * h and k are NaN where an input is not finite, or rotation vectors pass half a turn.
 *
 * Reentrant: nothing static is written, so that tasks and interrupts may call at the same time.
 * Time: neither loops nor branches depend on p. With @REAL@ in hardware every call takes the same
 *   instructions, so that the time of one call is the worst case; software arithmetic may vary.
 * Stack: at most @STACK@ bytes (gcc for Cortex-M, -O0 to -O3). No heap, no libm, no errno.
 * Outputs must not overlap inputs.
 */
#ifndef @GUARD@
#define @GUARD@

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { @NAME@_inputs = @N@, @NAME@_outputs = @M@ };

typedef @REAL@ @NAME@_real;

void @NAME@_value(const @NAME@_real p[@N@], @NAME@_real h[@M@]);
void @NAME@_value_and_stiffness(const @NAME@_real p[@N@], @NAME@_real h[@M@], @NAME@_real k[@NM@]);
/* 1 where @INSIDEWORDS@, else 0 */
int32_t @NAME@_inside(const @NAME@_real p[@N@]);
@FREEPOSEAPI@@STEPPERAPI@
#ifdef __cplusplus
}
#endif

#endif
