//! The constants of the effects of time that a stepper carries.

use ecm_se3::{Real, Vec6};

/// Relaxing branches of a stepper.
pub const BRANCHES: usize = 2;

/// One relaxing branch: m' = x' − m/τ, and the force share · m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Branch<R> {
    /// Factor of the branch, over the static force.
    pub share: R,
    /// Time constant τ (s).
    pub tau_s: R,
    /// x is k q with the stiffness k at rest, which is passive; else the static force Q(q) itself.
    pub linear: bool,
}

/// Effects of time beside a static map; an effect that is zero is absent.
///
/// All act in the mid-frame coordinates q and their forces Q, and add to the static wrench h.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effects<R> {
    /// Undeformed length L (m).
    pub length_m: R,
    /// k (N/m, N m/rad): diagonal of the stiffness at rest along q.
    pub stiffness: Vec6<R>,
    /// Stress relaxation.
    pub branches: [Branch<R>; BRANCHES],
    /// Stiffness (N/m, N m/rad) of the springs that slip.
    pub friction: Vec6<R>,
    /// Stretch (m, rad) at which each of them slips.
    pub slip: Vec6<R>,
    /// β (1/K): h (1 − β (T − T0)).
    pub softer_per_kelvin: R,
    /// T0 (°C).
    pub reference_degc: R,
    /// α (1/s): h (1 + α t).
    pub ageing_per_s: R,
    /// D (N s/m, N m s/rad) of translation and of rotation.
    pub damping: [R; 2],
    /// η: h (1 − η (1 − W/W_max)), W = |(p − p0) · h|/2.
    pub softening: R,
}

impl<R: Real> Effects<R> {
    /// No effect.
    pub const fn none(length_m: R) -> Self {
        let branch = Branch {
            share: R::ZERO,
            tau_s: R::ONE,
            linear: true,
        };
        Self {
            length_m,
            stiffness: [R::ZERO; 6],
            branches: [branch; BRANCHES],
            friction: [R::ZERO; 6],
            slip: [R::ZERO; 6],
            softer_per_kelvin: R::ZERO,
            reference_degc: R::ZERO,
            ageing_per_s: R::ZERO,
            damping: [R::ZERO; 2],
            softening: R::ZERO,
        }
    }

    /// The inputs at which temperature and age change nothing.
    pub const fn default_inputs(&self) -> Inputs<R> {
        Inputs {
            temperature_degc: self.reference_degc,
            age_s: R::ZERO,
        }
    }
}

/// What a step is told beside pose and time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inputs<R> {
    /// Temperature of the mechanism (°C).
    pub temperature_degc: R,
    /// Time since the campaign began in which ageing was found (s).
    pub age_s: R,
}

impl<R: Real> Inputs<R> {
    #[inline(always)]
    pub(crate) fn are_finite(&self) -> bool {
        self.temperature_degc.is_finite() && self.age_s.is_finite()
    }
}
