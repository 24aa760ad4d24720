//! Cosserat rod under a dead tip wrench: a cheap first guess of the pose.

/// A straight rod clamped at its base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rod {
    /// Length, m.
    pub length_m: f64,
}
