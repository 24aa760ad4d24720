/* a: polynomial model of an elastic mechanism
 *
 * Inputs x_m; outputs fx_N;
 * stiffness = d(outputs)/d(inputs), row by row. Model file sha256 9440392998c725a03e72f489d943d006efbc1936a7f50344d28d5b19edaeb05d.
 * Outputs and stiffness are NaN where an input is not finite, or rotation vectors pass half a turn.
 *
 * Reentrant: nothing static is written, so that tasks and interrupts may call at the same time.
 * Time: neither loops nor branches depend on p. With double in hardware every call takes the same
 *   instructions, so that the time of one call is the worst case; software arithmetic may vary.
 * Stack: at most 432 bytes (gcc for Cortex-M, -O0 to -O3). No heap, no libm, no errno.
 * Outputs must not overlap inputs.
 */
#ifndef ECM_EXPORT_A_H
#define ECM_EXPORT_A_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { a_inputs = 1, a_outputs = 1 };

typedef double a_real;

void a_value(const a_real p[1], a_real h[1]);
void a_value_and_stiffness(const a_real p[1], a_real h[1], a_real k[1]);
/* 1 where p lies in the box and the ellipsoid of the measured inputs, else 0 */
int32_t a_inside(const a_real p[1]);

#ifdef __cplusplus
}
#endif

#endif
