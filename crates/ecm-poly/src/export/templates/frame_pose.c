/* The mid frame of a pose carries q and Q. */

static int32_t is_near(const real *q)
{
    /* Largest |c| and |theta| of a pose that is no fault */
    return dot(q, q) <= farthest_of[0] * farthest_of[0] &&
           dot(q + 3, q + 3) <= farthest_of[1] * farthest_of[1];
}

/* Pose of mid-frame coordinates */
static void pose_of(const real *q, real *p)
{
    const real half_theta[3] = {R(0.5) * q[3], R(0.5) * q[4], R(0.5) * q[5]};
    const real c[3] = {q[0] + length_m, q[1], q[2]};
    real series[8], a[9];
    stumpff(dot(half_theta, half_theta), series);
    with_parts(half_theta, series[0], series[1], series[2], a);
    apply(a, c, p);
    for (int32_t i = 3; i < 6; i++) {
        p[i] = q[i];
    }
}

/* The frame of a pose, Q and dQ/dq */
static void static_at(const real *p, frame_t *f, real *force, real *u)
{
    real m[OFSLOPES + 1];
    prepare(p, f);
    monomials_at(f->q, OFSLOPES, m);
    forces_at(f->q, m, force, u);
}
