//! An energy of mid-frame coordinates term by term: its value, and the wrench of each term.
//!
//! This is the definition from which the regressor is made; [`crate::energy::plan`] evaluates wrench
//! and stiffness of a fitted energy fast.

use ecm_se3::mid_frame::MidFrame;
use ecm_se3::{Pose, Real, Vec6};

use crate::energy::invariants::Symmetry;
use crate::energy::potential::{MAX_POWER, Powers};
use crate::shape::ShapeError;

/// U(q) = Σ_t β_t Π v_i^e_ti with v the variables of [`Symmetry`] at (c/l, θ/α).
///
/// The tables are borrowed, so that they can be constants in flash memory.
#[derive(Clone, Copy, Debug)]
pub struct EnergyMap<'a, R> {
    symmetry: Symmetry,
    exponents: &'a [[u8; 6]],
    coefficients: &'a [R],
    scale: [R; 2],
    length_m: R,
}

impl<'a, R: Real> EnergyMap<'a, R> {
    /// From exponents of the six variables, coefficients (J), `scale` = (length l in m, angle α
    /// in rad) that makes the coordinates dimensionless, and the mechanism's length (m).
    pub fn new(
        symmetry: Symmetry,
        exponents: &'a [[u8; 6]],
        coefficients: &'a [R],
        scale: [R; 2],
        length_m: R,
    ) -> Result<Self, ShapeError> {
        ShapeError::check("coefficients", coefficients.len(), exponents.len())?;
        let highest = exponents.iter().flatten().max().copied().unwrap_or(0);
        if usize::from(highest) > MAX_POWER {
            return Err(ShapeError {
                name: "largest power",
                found: usize::from(highest),
                expected: MAX_POWER,
            });
        }
        Ok(Self {
            symmetry,
            exponents,
            coefficients,
            scale,
            length_m,
        })
    }

    /// U (J) at a pose.
    pub fn energy(&self, pose: &Pose<R>) -> R {
        let q = self.dimensionless(&MidFrame::new(pose, self.length_m));
        let powers = Powers::new(&self.symmetry.variables(&q));
        let mut sum = R::ZERO;
        for (row, &weight) in self.exponents.iter().zip(self.coefficients) {
            sum += weight * powers.value(row);
        }
        sum
    }

    /// The wrench of one term with coefficient 1: a column of the regressor.
    pub fn term_wrench(&self, point: &TermPoint<R>, exponents: &[u8; 6]) -> Vec6<R> {
        let first = point.powers.gradient(exponents);
        point.frame.wrench(&self.force(&point.q, &first)).to_array()
    }

    /// The part of the evaluation at one pose that all terms share.
    pub fn term_point(&self, pose: &Pose<R>) -> TermPoint<R> {
        let frame = MidFrame::new(pose, self.length_m);
        let q = self.dimensionless(&frame);
        TermPoint {
            powers: Powers::new(&self.symmetry.variables(&q)),
            frame,
            q,
        }
    }

    #[inline(always)]
    fn dimensionless(&self, frame: &MidFrame<R>) -> Vec6<R> {
        let q = frame.coordinates();
        core::array::from_fn(|i| q[i] / self.scale[i / 3])
    }

    /// Q = ∂U/∂q (N, N m) from ∂U/∂v.
    #[inline(always)]
    fn force(&self, q: &Vec6<R>, first: &Vec6<R>) -> Vec6<R> {
        let gradient = self.symmetry.gradient(q, first);
        core::array::from_fn(|i| gradient[i] / self.scale[i / 3])
    }
}

/// Powers of the variables at one pose, for [`EnergyMap::term_wrench`].
#[derive(Clone, Copy, Debug)]
pub struct TermPoint<R> {
    powers: Powers<R>,
    frame: MidFrame<R>,
    q: Vec6<R>,
}
