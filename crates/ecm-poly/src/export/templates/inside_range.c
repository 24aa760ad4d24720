/* Squares of the largest |c| (m) and |theta| (rad) of the training data and 1 %. */
static const real c_squared = @CSQUARED@;
static const real theta_squared = @THETASQUARED@;

static int32_t within(const real *q)
{
    return (int32_t)(dot(q, q) <= c_squared) & (int32_t)(dot(q + 3, q + 3) <= theta_squared);
}
