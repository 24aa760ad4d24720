/* @TITLE@
 *
 * Inputs @INPUTS@; outputs @OUTPUTS@;
 * stiffness = d(outputs)/d(inputs), row by row. Model file sha256 @SUM@.
 */
#ifndef @GUARD@
#define @GUARD@

#ifdef __cplusplus
extern "C" {
#endif

enum { @NAME@_inputs = @N@, @NAME@_outputs = @M@ };

typedef @REAL@ @NAME@_real;

void @NAME@_value(const @NAME@_real p[@N@], @NAME@_real h[@M@]);
void @NAME@_value_and_stiffness(const @NAME@_real p[@N@], @NAME@_real h[@M@], @NAME@_real k[@NM@]);
/* 1 where every input is in the range of the training data, 0 outside */
int @NAME@_inside(const @NAME@_real p[@N@]);

#ifdef __cplusplus
}
#endif

#endif
