/* @TITLE@
 *
 * Pose p = (x, y, z, theta_x, theta_y, theta_z) in m and rad, wrench h in N and N m@BEHINDPOSE@ Model file sha256 @SUM@.
 * h and K (and U) are NaN where p is not finite or |theta| > pi.
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

typedef @REAL@ @NAME@_real;

/* U in J */
@NAME@_real @NAME@_energy(const @NAME@_real p[@N@]);
void @NAME@_value(const @NAME@_real p[@N@], @NAME@_real h[6]);
void @NAME@_value_and_stiffness(const @NAME@_real p[@N@], @NAME@_real h[6], @NAME@_real k[@NM@]);
/* 1 where @INSIDEWORDS@, else 0 */
int32_t @NAME@_inside(const @NAME@_real p[@N@]);
@FREEPOSEAPI@@STEPPERAPI@
#ifdef __cplusplus
}
#endif

#endif
