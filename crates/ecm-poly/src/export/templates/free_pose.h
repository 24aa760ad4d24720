/* Newton's method from pose to the pose at which the mechanism with the inputs a of its actuators takes
 * a wrench (N, N m; 0 of a free platform), best from the pose of the cycle before. The number of
 * iterations, each a call of @NAME@_value_and_stiffness and a 6 x 6 solve; 0 where none was found: pose
 * is then as it was. */
enum { @NAME@_most_iterations = 30 };
int32_t @NAME@_free_pose(const @NAME@_real a[@ACTUATORS@], const @NAME@_real wrench[6], @NAME@_real pose[6]);
