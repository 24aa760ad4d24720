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

/// Tables of one energy with memory for `S` monomials, checked once where it is made.
///
/// Monomial 0 is 1; scales are folded into the weights.
#[derive(Clone, Copy, Debug)]
pub struct EnergyPlan<'a, R, const S: usize> {
    symmetry: Symmetry,
    length_m: R,
    products: &'a [(u16, u8)],
    ends: [u16; ROWS],
    columns: &'a [u16],
    weights: &'a [R],
}

impl<'a, R: Real, const S: usize> EnergyPlan<'a, R, S> {
    /// From the tables that `EnergyTables` makes, also in a constant.
    ///
    /// - `length_m`: undeformed length (m).
    /// - `products`: monomial t + 1 is monomial `.0` times variable `.1`.
    /// - `ends`: end of the entries of each row.
    /// - `columns`, `weights`: monomial and weight (J and powers of 1/m) of each entry.
    ///
    /// # Errors
    /// An `S` that is no power of two or too small; tables that do not fit together.
    pub const fn new(
        symmetry: Symmetry,
        length_m: R,
        products: &'a [(u16, u8)],
        ends: [u16; ROWS],
        columns: &'a [u16],
        weights: &'a [R],
    ) -> Result<Self, ShapeError> {
        if !S.is_power_of_two() || products.len() >= S {
            return wrong("monomials", products.len() + 1, S);
        }
        if weights.len() != columns.len() {
            return wrong("weights", weights.len(), columns.len());
        }
        let mut t = 0;
        while t < products.len() {
            let (parent, variable) = products[t];
            if parent as usize > t {
                return wrong("factor of a monomial", parent as usize, t);
            }
            if variable > 5 {
                return wrong("variable of a monomial", variable as usize, 5);
            }
            t += 1;
        }
        let mut entry = 0;
        while entry < columns.len() {
            if columns[entry] as usize > products.len() {
                return wrong("column", columns[entry] as usize, products.len());
            }
            entry += 1;
        }
        let mut row = 1;
        while row < ROWS {
            if ends[row] < ends[row - 1] {
                return wrong("end of a row", ends[row] as usize, ends[row - 1] as usize);
            }
            row += 1;
        }
        if ends[ROWS - 1] as usize != columns.len() {
            return wrong("columns", columns.len(), ends[ROWS - 1] as usize);
        }
        Ok(Self {
            symmetry,
            length_m,
            products,
            ends,
            columns,
            weights,
        })
    }

    /// As [`EnergyPlan::new`] of tables that it has accepted before.
    #[cfg(feature = "alloc")]
    #[inline(always)]
    pub(crate) fn of_checked(
        symmetry: Symmetry,
        length_m: R,
        products: &'a [(u16, u8)],
        ends: [u16; ROWS],
        columns: &'a [u16],
        weights: &'a [R],
    ) -> Self {
        Self {
            symmetry,
            length_m,
            products,
            ends,
            columns,
            weights,
        }
    }

    /// Undeformed length of the mechanism (m).
    #[inline(always)]
    pub fn length_m(&self) -> R {
        self.length_m
    }

    /// U (J) at a pose.
    #[inline(always)]
    pub fn energy<A: Arithmetic<R>>(&self, pose: &Pose<R>) -> R {
        let q = MidFrame::new(pose, self.length_m).coordinates();
        let monomials = self.monomials(&self.symmetry.variables(&q));
        self.row::<A>(0, &monomials)
    }

    /// The wrench h that holds the pose.
    #[inline(always)]
    pub fn wrench<A: Arithmetic<R>>(&self, pose: &Pose<R>) -> Wrench<R> {
        let frame = MidFrame::new(pose, self.length_m);
        let q = frame.coordinates();
        let monomials = self.monomials(&self.symmetry.variables(&q));
        let first = core::array::from_fn(|i| self.row::<A>(1 + i, &monomials));
        frame.wrench(&self.symmetry.gradient(&q, &first))
    }

    /// h, and the stiffness of one kind.
    #[inline(always)]
    pub fn wrench_and_stiffness<A: Arithmetic<R>>(
        &self,
        pose: &Pose<R>,
        kind: StiffnessKind,
    ) -> (Wrench<R>, Mat6<R>) {
        let frame = MidFrame::new(pose, self.length_m);
        let q = frame.coordinates();
        let monomials = self.monomials(&self.symmetry.variables(&q));
        let first: Vec6<R> = core::array::from_fn(|i| self.row::<A>(1 + i, &monomials));
        let mut second = [[R::ZERO; 6]; 6];
        let mut row = 7;
        for i in 0..6 {
            for j in i..6 {
                let value = self.row::<A>(row, &monomials);
                second[i][j] = value;
                second[j][i] = value;
                row += 1;
            }
        }
        wrench_and_stiffness(&frame, self.symmetry, (&first, &second), pose, kind)
    }

    #[inline(always)]
    fn monomials(&self, variables: &Vec6<R>) -> [R; S] {
        let mut values = [R::ONE; S];
        fill_monomials(self.products, variables, &mut values);
        values
    }

    #[inline(always)]
    fn row<A: Arithmetic<R>>(&self, row: usize, monomials: &[R; S]) -> R {
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

const fn wrong<T>(name: &'static str, found: usize, expected: usize) -> Result<T, ShapeError> {
    Err(ShapeError {
        name,
        found,
        expected,
    })
}

/// All monomials of the six variables, one product each; `S` is a power of two.
#[inline(always)]
pub(crate) fn fill_monomials<R: Real, const S: usize>(
    products: &[(u16, u8)],
    variables: &Vec6<R>,
    values: &mut [R; S],
) {
    // Masks instead of bounds checks.
    let [a, b, c, d, e, f] = *variables;
    let v = [a, b, c, d, e, f, R::ZERO, R::ZERO];
    values[0] = R::ONE;
    for (t, &(parent, variable)) in products.iter().enumerate() {
        values[(t + 1) & (S - 1)] =
            values[usize::from(parent) & (S - 1)] * v[usize::from(variable) & 7];
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
