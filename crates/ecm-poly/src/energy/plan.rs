//! Fast evaluation of any energy: all monomials once, then sparse sums. The cost does not depend on
//! the pose.
//!
//! U, ∂U/∂v and ∂²U/∂v² are 28 polynomials of the same few monomials of the six variables v.
//! Each monomial is one product of an earlier one with a variable; each polynomial is one row
//! of a sparse matrix. The tables are made once, by `EnergyTables` (std) or by an export.

use ecm_se3::mid_frame::MidFrame;
use ecm_se3::stiffness::{StiffnessKind, convert};
use ecm_se3::{Mat6, Pose, Real, Vec6, Wrench};

use crate::arithmetic::Arithmetic;
use crate::energy::invariants::Symmetry;
use crate::shape::ShapeError;

/// Rows of the sparse matrix: U, six slopes, 21 curvatures (upper triangle, row by row).
pub const ROWS: usize = 28;

/// Tables of one energy; monomial 0 is 1, and scales are folded into the weights.
#[derive(Clone, Copy, Debug)]
pub struct EnergyPlan<'a, R> {
    /// Symmetry of the mechanism.
    pub symmetry: Symmetry,
    /// Undeformed length (m).
    pub length_m: R,
    /// Monomial t + 1 is monomial `.0` times variable `.1`.
    pub products: &'a [(u16, u8)],
    /// End of the entries of each row.
    pub ends: [u16; ROWS],
    /// Monomial of each entry.
    pub columns: &'a [u16],
    /// Weight of each entry (J and powers of 1/m).
    pub weights: &'a [R],
}

impl<R: Real> EnergyPlan<'_, R> {
    /// `Ok` where memory for `S` monomials, a power of two, is sufficient.
    pub fn check<const S: usize>(&self) -> Result<(), ShapeError> {
        ShapeError::check("weights", self.weights.len(), self.columns.len())?;
        if S.is_power_of_two() && self.products.len() < S {
            return Ok(());
        }
        Err(ShapeError {
            name: "monomials",
            found: self.products.len() + 1,
            expected: S,
        })
    }

    /// U (J) at a pose.
    #[inline(always)]
    pub fn energy<A: Arithmetic<R>, const S: usize>(&self, pose: &Pose<R>) -> R {
        let q = MidFrame::new(pose, self.length_m).coordinates();
        let monomials = self.monomials::<S>(&self.symmetry.variables(&q));
        self.row::<A, S>(0, &monomials)
    }

    /// The wrench h that holds the pose.
    #[inline(always)]
    pub fn wrench<A: Arithmetic<R>, const S: usize>(&self, pose: &Pose<R>) -> Wrench<R> {
        let frame = MidFrame::new(pose, self.length_m);
        let q = frame.coordinates();
        let monomials = self.monomials::<S>(&self.symmetry.variables(&q));
        let first = core::array::from_fn(|i| self.row::<A, S>(1 + i, &monomials));
        frame.wrench(&self.symmetry.gradient(&q, &first))
    }

    /// h, and the stiffness of one kind.
    #[inline(always)]
    pub fn wrench_and_stiffness<A: Arithmetic<R>, const S: usize>(
        &self,
        pose: &Pose<R>,
        kind: StiffnessKind,
    ) -> (Wrench<R>, Mat6<R>) {
        let frame = MidFrame::new(pose, self.length_m);
        let q = frame.coordinates();
        let monomials = self.monomials::<S>(&self.symmetry.variables(&q));
        let first: Vec6<R> = core::array::from_fn(|i| self.row::<A, S>(1 + i, &monomials));
        let mut second = [[R::ZERO; 6]; 6];
        let mut row = 7;
        for i in 0..6 {
            for j in i..6 {
                let value = self.row::<A, S>(row, &monomials);
                second[i][j] = value;
                second[j][i] = value;
                row += 1;
            }
        }
        wrench_and_stiffness(&frame, self.symmetry, (&first, &second), pose, kind)
    }

    #[inline(always)]
    fn monomials<const S: usize>(&self, variables: &Vec6<R>) -> [R; S] {
        // Masks instead of bounds checks: S is a power of two, see `check`.
        let [a, b, c, d, e, f] = *variables;
        let v = [a, b, c, d, e, f, R::ZERO, R::ZERO];
        let mut values = [R::ONE; S];
        for (t, &(parent, variable)) in self.products.iter().enumerate() {
            values[(t + 1) & (S - 1)] =
                values[usize::from(parent) & (S - 1)] * v[usize::from(variable) & 7];
        }
        values
    }

    #[inline(always)]
    fn row<A: Arithmetic<R>, const S: usize>(&self, row: usize, monomials: &[R; S]) -> R {
        let start = match row {
            0 => 0,
            _ => usize::from(self.ends[(row - 1) % ROWS]),
        };
        let range = start..usize::from(self.ends[row % ROWS]);
        let (Some(columns), Some(weights)) =
            (self.columns.get(range.clone()), self.weights.get(range))
        else {
            return R::ZERO;
        };
        // Four independent sums, so that additions do not wait for each other.
        let mut sums = [R::ZERO; 4];
        let (whole, rest) = columns.as_chunks::<4>();
        let (heavy, light) = weights.as_chunks::<4>();
        for (c, w) in whole.iter().zip(heavy) {
            for l in 0..4 {
                sums[l] = A::mul_add(w[l], monomials[usize::from(c[l]) & (S - 1)], sums[l]);
            }
        }
        for (&c, &w) in rest.iter().zip(light) {
            sums[0] = A::mul_add(w, monomials[usize::from(c) & (S - 1)], sums[0]);
        }
        (sums[0] + sums[1]) + (sums[2] + sums[3])
    }
}

/// h and its stiffness from ∂U/∂v and ∂²U/∂v² at a pose.
#[inline(always)]
pub(crate) fn wrench_and_stiffness<R: Real>(
    frame: &MidFrame<R>,
    symmetry: Symmetry,
    (first, second): (&Vec6<R>, &Mat6<R>),
    pose: &Pose<R>,
    kind: StiffnessKind,
) -> (Wrench<R>, Mat6<R>) {
    let q = frame.coordinates();
    let force = symmetry.gradient(&q, first);
    let wrench = frame.wrench(&force);
    let hessian = frame.hessian(&force, &symmetry.hessian(&q, first, second));
    let stiffness = match kind {
        StiffnessKind::Generalised => hessian,
        StiffnessKind::Partial => frame.partial_from_generalised(&hessian, &wrench),
        StiffnessKind::Screw => convert(&hessian, pose, &wrench, StiffnessKind::Generalised, kind),
    };
    (wrench, stiffness)
}
