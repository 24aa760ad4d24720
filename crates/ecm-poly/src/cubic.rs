//! Fast evaluation of the paper's map: six cubics of six inputs in one pass over 84 coefficient
//! vectors, value and Jacobian, without std, allocation or branches.
//!
//! For i ≤ j: q = B_ij + Σ_{k≥j} p_k C_ijk and G_k += p_i p_j C_ijk; then h += p_i p_j q,
//! G_i += p_j q, G_j += p_i q. h starts at the constant and linear part, G at the linear one.

use ecm_se3::{Mat6, Pose, Real, Vec6, Wrench};

use crate::arithmetic::{Arithmetic, Plain};
use crate::basis::advance;
use crate::normalise::unit_slope;
use crate::shape::ShapeError;

/// Six outputs in the eight lanes of a SIMD register; lanes 6 and 7 are 0.
pub type SimdVector<R> = [R; 8];

const TERMS: usize = 84;

/// Coefficients of six cubics, in the order of evaluation.
///
/// The slopes of the normalisation are folded in: the variables are p − centre.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub struct Cubic<R> {
    coefficients: [SimdVector<R>; TERMS],
    centre: Vec6<R>,
}

/// Position of the coefficients of the pair (i, j): B_ij, then C_ijk for k = j … 5.
const fn start(i: usize, j: usize) -> usize {
    let mut place = 7;
    let mut a = 0;
    while a < 6 {
        let mut b = a;
        while b < 6 {
            if a == i && b == j {
                return place;
            }
            place += 1 + 6 - b;
            b += 1;
        }
        a += 1;
    }
    place
}

impl<R: Real> Cubic<R> {
    /// From coefficients (84, 6), row-major, in the order of the paper's eq. (4), of inputs
    /// mapped from [lower, upper] to [−1, 1].
    pub fn new(lower: &[R], upper: &[R], coefficients: &[R]) -> Result<Self, ShapeError> {
        ShapeError::check("lower", lower.len(), 6)?;
        ShapeError::check("upper", upper.len(), 6)?;
        ShapeError::check("coefficients", coefficients.len(), TERMS * 6)?;
        let mut table = [[R::ZERO; 8]; TERMS];
        let mut exponents = [0_u8; 6];
        for row in coefficients.chunks_exact(6) {
            let mut factors = [0_usize; 3];
            let mut count = 0;
            let mut weight = R::ONE;
            for i in 0..6 {
                for _ in 0..exponents[i] {
                    weight = weight * unit_slope(lower[i], upper[i]);
                    factors[count % 3] = i;
                    count += 1;
                }
            }
            let place = match count {
                0 => 0,
                1 => 1 + factors[0],
                2 => start(factors[0], factors[1]),
                _ => start(factors[0], factors[1]) + 1 + factors[2] - factors[1],
            };
            if let Some(lanes) = table.get_mut(place) {
                for (lane, &c) in lanes.iter_mut().zip(row) {
                    *lane = weight * c;
                }
            }
            advance(&mut exponents);
        }
        let centre = core::array::from_fn(|i| R::HALF * (lower[i] + upper[i]));
        Ok(Self {
            coefficients: table,
            centre,
        })
    }

    /// From the tables of [`Cubic::tables`], as an export writes them.
    pub const fn from_tables(coefficients: [SimdVector<R>; TERMS], centre: Vec6<R>) -> Self {
        Self {
            coefficients,
            centre,
        }
    }

    /// Coefficient vectors in the order of evaluation, and the centre of the inputs.
    pub fn tables(&self) -> (&[SimdVector<R>; TERMS], &Vec6<R>) {
        (&self.coefficients, &self.centre)
    }

    /// h(p); lanes 6 and 7 are 0.
    #[inline(always)]
    pub fn value<A: Arithmetic<R>>(&self, point: &Vec6<R>) -> SimdVector<R> {
        let p: Vec6<R> = core::array::from_fn(|i| point[i] - self.centre[i]);
        let c = &self.coefficients;
        let mut h = c[0];
        // The indices are constants, so that the compiler unrolls everything.
        macro_rules! rows {
            ($($i:literal: $($j:literal)*;)*) => {$({
                let mut slope = c[1 + $i];
                $(accumulate::<R, A>(&mut slope, p[$j], &inner::<R, A, $i, $j>(c, &p));)*
                accumulate::<R, A>(&mut h, p[$i], &slope);
            })*};
        }
        rows!(0: 0 1 2 3 4 5; 1: 1 2 3 4 5; 2: 2 3 4 5; 3: 3 4 5; 4: 4 5; 5: 5;);
        h
    }

    /// h(p) and the columns ∂h/∂p_i; lanes 6 and 7 are 0.
    #[inline(always)]
    pub fn value_and_columns<A: Arithmetic<R>>(
        &self,
        point: &Vec6<R>,
    ) -> (SimdVector<R>, [SimdVector<R>; 6]) {
        let p: Vec6<R> = core::array::from_fn(|i| point[i] - self.centre[i]);
        let c = &self.coefficients;
        let mut h = c[0];
        let mut g = [c[1], c[2], c[3], c[4], c[5], c[6]];
        for i in 0..6 {
            accumulate::<R, A>(&mut h, p[i], &c[1 + i]);
        }
        // The indices are constants, so that the compiler unrolls everything.
        macro_rules! pairs {
            ($($i:literal $j:literal),*) => {
                $(pair::<R, A, $i, $j>(c, &p, &mut h, &mut g);)*
            };
        }
        pairs!(
            0 0, 0 1, 0 2, 0 3, 0 4, 0 5, 1 1, 1 2, 1 3, 1 4, 1 5, 2 2, 2 3, 2 4, 2 5, 3 3, 3 4,
            3 5, 4 4, 4 5, 5 5
        );
        (h, g)
    }

    /// h (N, N m) and K = ∂h/∂p of one pose, as every pose-to-wrench model has it.
    #[inline]
    pub fn wrench_and_stiffness(&self, pose: &Pose<R>) -> (Wrench<R>, Mat6<R>) {
        let (h, k) = self.value_and_jacobian::<Plain>(&pose.to_array());
        (Wrench::from_array(&h), k)
    }

    /// h(p) and K = ∂h/∂p.
    #[inline(always)]
    pub fn value_and_jacobian<A: Arithmetic<R>>(&self, point: &Vec6<R>) -> (Vec6<R>, Mat6<R>) {
        let (h, g) = self.value_and_columns::<A>(point);
        let k = core::array::from_fn(|j| core::array::from_fn(|i| g[i][j]));
        (core::array::from_fn(|j| h[j]), k)
    }
}

/// B_ij + Σ_{k≥j} p_k C_ijk.
#[inline(always)]
fn inner<R: Real, A: Arithmetic<R>, const I: usize, const J: usize>(
    c: &[SimdVector<R>; TERMS],
    p: &Vec6<R>,
) -> SimdVector<R> {
    let place = const { start(I, J) };
    let mut q = c[place];
    for k in J..6 {
        accumulate::<R, A>(&mut q, p[k], &c[place + 1 + k - J]);
    }
    q
}

#[inline(always)]
fn pair<R: Real, A: Arithmetic<R>, const I: usize, const J: usize>(
    c: &[SimdVector<R>; TERMS],
    p: &Vec6<R>,
    h: &mut SimdVector<R>,
    g: &mut [SimdVector<R>; 6],
) {
    let place = const { start(I, J) };
    let product = p[I] * p[J];
    let mut q = c[place];
    for k in J..6 {
        let lanes = &c[place + 1 + k - J];
        accumulate::<R, A>(&mut q, p[k], lanes);
        accumulate::<R, A>(&mut g[k], product, lanes);
    }
    accumulate::<R, A>(&mut g[I], p[J], &q);
    accumulate::<R, A>(&mut g[J], p[I], &q);
    accumulate::<R, A>(h, product, &q);
    A::separate();
}

/// sum += factor lanes.
#[inline(always)]
fn accumulate<R: Real, A: Arithmetic<R>>(
    sum: &mut SimdVector<R>,
    factor: R,
    lanes: &SimdVector<R>,
) {
    for l in 0..8 {
        sum[l] = A::mul_add(factor, lanes[l], sum[l]);
    }
}
