//! Status and result of a load case.

/// How a load case ended; only [`Status::Solved`] is a stable equilibrium at the
/// given load, every other status comes with the last stable state before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Status {
    /// Stable equilibrium at the load asked for.
    Solved,
    /// The load lies beyond a loss of stability: buckling, or a crease or collapse inside.
    Unstable,
    /// The load steps became too small.
    NotConverged,
    /// The load steps became too small because elements turn inside out.
    Inverted,
    /// The caller set the cancel flag.
    Cancelled,
}

impl Status {
    /// The word used in files and in Python.
    pub fn word(self) -> &'static str {
        match self {
            Self::Solved => "solved",
            Self::Unstable => "unstable",
            Self::NotConverged => "not_converged",
            Self::Inverted => "inverted",
            Self::Cancelled => "cancelled",
        }
    }
}

/// Why a load case is [`Status::Unstable`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Reason {
    /// The smallest eigenvalue of H reaches zero: the platform buckles under the dead wrench.
    Buckling,
    /// The tangent at fixed platform loses a positive pivot where the most compressed point is
    /// beyond [`CREASE`]: the body creases or wrinkles at its surface.
    Crease,
    /// The tangent at fixed platform loses a positive pivot at moderate compression.
    Inner,
}

/// Ratio of the smallest to the largest principal stretch at which the free surface of a
/// neo-Hookean body creases (Hong, Zhao and Suo 2009: 1/2.4); it wrinkles at 0.296 (Biot 1963).
pub const CREASE: f64 = 1.0 / 2.4;

impl Reason {
    /// The words used in files and in Python.
    pub fn words(self) -> &'static str {
        match self {
            Self::Buckling => "buckling: the stiffness under a dead wrench loses its positivity",
            Self::Crease => {
                "crease: the compressed surface loses stability beyond a stretch ratio of 1/2.4"
            }
            Self::Inner => "inner: the body loses stability at a fixed platform",
        }
    }
}

/// Result of one load case at the state that was reached.
#[derive(Debug, Clone, PartialEq)]
pub struct CaseResult {
    /// How it ended.
    pub status: Status,
    /// (x, y, z, θx, θy, θz) of the platform, m and rad.
    pub pose: [f64; 6],
    /// (fx, fy, fz, τx, τy, τz) that holds the pose, N and N m, base axes.
    pub wrench: [f64; 6],
    /// Stored energy, J.
    pub energy_J: f64,
    /// K = ∂h/∂p.
    pub stiffness: [[f64; 6]; 6],
    /// H = ∂(f, Jᵀτ)/∂p.
    pub hessian: [[f64; 6]; 6],
    /// Smallest eigenvalue of H with lengths divided by L, N m.
    pub smallest_eigenvalue: f64,
    /// Negative pivots beyond the number of pressures: instabilities at fixed pose.
    pub inner_instabilities: usize,
    /// Reason of [`Status::Unstable`].
    pub reason: Option<Reason>,
    /// Smallest ratio of the smallest to the largest principal stretch at a quadrature point.
    pub stretch_ratio: f64,
    /// Where that is, in the undeformed body (centre of its element), m.
    pub most_compressed_m: [f64; 3],
    /// Largest principal stretch at a quadrature point.
    pub largest_stretch: f64,
    /// Smallest det F at a quadrature point.
    pub smallest_jacobian: f64,
    /// Newton iterations of all load steps.
    pub iterations: usize,
    /// Factorisations, one of them at each equilibrium; fewer than iterations where the last
    /// steps of Newton keep a factor.
    pub factorisations: usize,
    /// Number of load steps.
    pub load_steps: usize,
    /// Norm of the residual over the force unit μ V / L.
    pub residual: f64,
}
