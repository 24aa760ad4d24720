//! From an energy of mid-frame coordinates to wrench and stiffness, without std or allocation.

use ecm_se3::mid_frame::MidFrame;
use ecm_se3::stiffness::{StiffnessKind, convert};
use ecm_se3::{Mat6, Pose, Real, Vec6, Wrench};

use crate::energy::invariants::Symmetry;
use crate::energy::potential::{MAX_POWER, Powers};
use crate::shape::ShapeError;

/// U(q) = Σ_t β_t Π v_i^e_ti with v the variables of [`Symmetry`] at (c/l, θ/α).
///
/// The tables are borrowed, so that they may lie in flash.
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

    /// The wrench h that the pose needs.
    pub fn wrench(&self, pose: &Pose<R>) -> Wrench<R> {
        let frame = MidFrame::new(pose, self.length_m);
        let q = self.dimensionless(&frame);
        let powers = Powers::new(&self.symmetry.variables(&q));
        frame.wrench(&self.force(&q, &self.slope(&powers)))
    }

    /// h and its stiffness of the kind asked for.
    pub fn wrench_and_stiffness(
        &self,
        pose: &Pose<R>,
        kind: StiffnessKind,
    ) -> (Wrench<R>, Mat6<R>) {
        let frame = MidFrame::new(pose, self.length_m);
        let q = self.dimensionless(&frame);
        let powers = Powers::new(&self.symmetry.variables(&q));
        let first = self.slope(&powers);
        let force = self.force(&q, &first);
        let wrench = frame.wrench(&force);
        let hessian = frame.hessian(&force, &self.curvature(&q, &first, &powers));
        let stiffness = match kind {
            StiffnessKind::Generalised => hessian,
            StiffnessKind::Partial => frame.partial_from_generalised(&hessian, &wrench),
            StiffnessKind::Screw => {
                convert(&hessian, pose, &wrench, StiffnessKind::Generalised, kind)
            }
        };
        (wrench, stiffness)
    }

    /// The wrench of one term with coefficient 1: a column of the regressor.
    pub fn term_wrench(&self, point: &TermPoint<R>, exponents: &[u8; 6]) -> Vec6<R> {
        let first = point.powers.gradient(exponents);
        point.frame.wrench(&self.force(&point.q, &first)).to_array()
    }

    /// What all terms share at one pose.
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

    /// ∂U/∂v.
    #[inline(always)]
    fn slope(&self, powers: &Powers<R>) -> Vec6<R> {
        let mut first = [R::ZERO; 6];
        for (row, &weight) in self.exponents.iter().zip(self.coefficients) {
            let term = powers.gradient(row);
            for i in 0..6 {
                first[i] += weight * term[i];
            }
        }
        first
    }

    /// Q = ∂U/∂q (N, N m) from ∂U/∂v.
    #[inline(always)]
    fn force(&self, q: &Vec6<R>, first: &Vec6<R>) -> Vec6<R> {
        let gradient = self.symmetry.gradient(q, first);
        core::array::from_fn(|i| gradient[i] / self.scale[i / 3])
    }

    /// ∂²U/∂q².
    #[inline(always)]
    fn curvature(&self, q: &Vec6<R>, first: &Vec6<R>, powers: &Powers<R>) -> Mat6<R> {
        let mut second = [[R::ZERO; 6]; 6];
        for (row, &weight) in self.exponents.iter().zip(self.coefficients) {
            powers.add_hessian(row, weight, &mut second);
        }
        for j in 0..6 {
            for i in 0..j {
                second[j][i] = second[i][j];
            }
        }
        let mut hessian = self.symmetry.hessian(q, first, &second);
        for i in 0..6 {
            for j in 0..6 {
                hessian[i][j] = hessian[i][j] / (self.scale[i / 3] * self.scale[j / 3]);
            }
        }
        hessian
    }
}

/// One pose, ready for the wrench of any term.
#[derive(Clone, Copy, Debug)]
pub struct TermPoint<R> {
    powers: Powers<R>,
    frame: MidFrame<R>,
    q: Vec6<R>,
}
