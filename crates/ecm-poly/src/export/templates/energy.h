/* @TITLE@
 *
 * Pose p = (x, y, z, theta_x, theta_y, theta_z) in m and rad, wrench h in N and N m,
 * K = dh/dp (6 x 6, row by row). Model file sha256 @SUM@.
 */
#ifndef @GUARD@
#define @GUARD@

#ifdef __cplusplus
extern "C" {
#endif

typedef @REAL@ @NAME@_real;

/* U in J */
@NAME@_real @NAME@_energy(const @NAME@_real p[6]);
void @NAME@_value(const @NAME@_real p[6], @NAME@_real h[6]);
void @NAME@_value_and_stiffness(const @NAME@_real p[6], @NAME@_real h[6], @NAME@_real k[36]);

#ifdef __cplusplus
}
#endif

#endif
