//! Status and result of a load case.

/// How a load case ended; only [`Status::Solved`] is a stable equilibrium at the
/// given load, every other status comes with the last stable state before it. Where there is none
/// (a body that does not carry its own weight) the figures are not numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Status {
    /// Stable equilibrium at the load asked for.
    Solved,
    /// The load lies beyond a loss of stability, which was bracketed on the branch from rest: the
    /// next equilibrium after the last stable one is not stable.
    Unstable,
    /// No equilibrium was found at the load, nor a loss of stability before it.
    NotConverged,
    /// The load steps became too small because elements turn inside out.
    Inverted,
    /// The wall of a chamber touches itself: beyond, it would pass through itself.
    Collapsed,
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
            Self::Collapsed => "collapsed",
            Self::Cancelled => "cancelled",
        }
    }
}

/// Why a load case is [`Status::Unstable`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Reason {
    /// An eigenvalue of K_s reaches zero: the platform gives way under the dead wrench.
    Buckling,
    /// The body gives way where the smallest stretch is below [`CREASE`]: it creases or wrinkles at its
    /// surface. The tangent at fixed platform loses a positive pivot, or an eigenvalue of K_s reaches
    /// zero shortly before, in a mode that moves the body more than the platform.
    Crease,
    /// The same at moderate compression.
    Inner,
}

/// Principal stretch at which the compressed free surface of a neo-Hookean body in plane strain
/// creases (Hong, Zhao and Suo 2009: a strain of 0.35); it wrinkles at 0.544 (Biot 1963).
pub const CREASE: f64 = 0.65;

impl Reason {
    /// The words used in files and in Python.
    pub fn words(self) -> &'static str {
        match self {
            Self::Buckling => "buckling: the platform gives way under the dead wrench",
            Self::Crease => {
                "crease: the body loses stability where it is compressed below a stretch of 0.65"
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
    /// Smallest eigenvalue of the symmetric part of K_s with lengths divided by L, N m.
    pub smallest_eigenvalue: f64,
    /// det K_s with lengths divided by L, (N m)⁶; its sign decides on stability under a dead wrench.
    pub determinant: f64,
    /// Negative pivots beyond the number of pressures: instabilities at fixed pose.
    pub inner_instabilities: usize,
    /// Reason of [`Status::Unstable`].
    pub reason: Option<Reason>,
    /// Smallest ratio of the smallest to the largest principal stretch at a quadrature point.
    pub stretch_ratio: f64,
    /// Smallest principal stretch at a quadrature point.
    pub smallest_stretch: f64,
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
    /// What each actuator does there.
    pub actuators: Vec<Actuator>,
}

/// One actuator at a state: a chamber with its gauge pressure a and its volume change q.
#[derive(Debug, Clone, PartialEq)]
pub struct Actuator {
    /// a: gauge pressure, Pa.
    pub input: f64,
    /// q = −∂Π/∂a: change of the chamber's volume from the undeformed body, m³.
    pub amount: f64,
    /// G = ∂h/∂a at fixed pose: m² and m³.
    pub on_wrench: [f64; 6],
    /// C = ∂q/∂a of all actuators at fixed pose, m³/Pa.
    pub on_amounts: Vec<f64>,
}

impl CaseResult {
    /// Where no stable state is known: the figures are not numbers.
    pub(crate) fn without_state() -> Self {
        let nan = f64::NAN;
        Self {
            status: Status::NotConverged,
            pose: [nan; 6],
            wrench: [nan; 6],
            energy_J: nan,
            stiffness: [[nan; 6]; 6],
            hessian: [[nan; 6]; 6],
            smallest_eigenvalue: nan,
            determinant: nan,
            inner_instabilities: 0,
            reason: None,
            stretch_ratio: nan,
            smallest_stretch: nan,
            most_compressed_m: [nan; 3],
            largest_stretch: nan,
            smallest_jacobian: nan,
            iterations: 0,
            factorisations: 0,
            load_steps: 0,
            residual: nan,
            actuators: Vec::new(),
        }
    }

    /// Whether pose and wrench are those of a stable equilibrium.
    pub fn has_state(&self) -> bool {
        self.pose.iter().all(|v| v.is_finite())
    }
}
