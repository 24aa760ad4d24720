/* Fewer than all columns have no frame: q is p, and Q is h. At rest p is 0. */
typedef struct {
    real q[@N@], refused;
} frame_t;

static const real length_m = R(0);

static int32_t is_near(const real *q)
{
    /* Least, then largest p that is no fault */
    int32_t near = 1;
    for (int32_t i = 0; i < @N@; i++) {
        near &= (int32_t)(q[i] >= farthest_of[i]) & (int32_t)(q[i] <= farthest_of[@N@ + i]);
    }
    return near;
}

static void pose_of(const real *q, real *p)
{
    for (int32_t i = 0; i < @N@; i++) {
        p[i] = q[i];
    }
}

static void prepare(const real *p, frame_t *f)
{
    pose_of(p, f->q);
    f->refused = R(0);
    for (int32_t i = 0; i < @N@; i++) {
        f->refused += p[i] - p[i];
    }
}

static void static_at(const real *p, frame_t *f, real *force, real *u)
{
    prepare(p, f);
    @NAME@_value_and_stiffness(p, force, u);
    f->refused += u[0] - u[0];
}

static void wrench_of(const frame_t *f, const real *force, real *h)
{
    for (int32_t i = 0; i < @M@; i++) {
        h[i] = force[i] + f->refused;
    }
}

static void carried(const frame_t *f, const real *force, const real *u, real *h, real *k)
{
    wrench_of(f, force, h);
    for (int32_t i = 0; i < @NM@; i++) {
        k[i] = u[i];
    }
}
