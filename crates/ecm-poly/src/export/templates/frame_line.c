/* A single coordinate has no frame: q is p, and Q is h. At rest p is 0. */
typedef struct {
    real q[1], refused;
} frame_t;

static const real length_m = R(0);

static int32_t is_near(const real *q)
{
    /* Least and largest p that is no fault */
    return q[0] >= farthest_of[0] && q[0] <= farthest_of[1];
}

static void pose_of(const real *q, real *p) { p[0] = q[0]; }

static void prepare(const real *p, frame_t *f)
{
    f->q[0] = p[0];
    f->refused = p[0] - p[0];
}

static void static_at(const real *p, frame_t *f, real *force, real *u)
{
    prepare(p, f);
    @NAME@_value_and_stiffness(p, force, u);
    f->refused += u[0] - u[0];
}

static void wrench_of(const frame_t *f, const real *force, real *h) { h[0] = force[0] + f->refused; }

static void carried(const frame_t *f, const real *force, const real *u, real *h, real *k)
{
    wrench_of(f, force, h);
    k[0] = u[0];
}
