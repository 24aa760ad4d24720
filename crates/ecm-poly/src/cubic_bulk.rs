//! Evaluation of a cubic pose-to-wrench map at many points, with the SIMD instructions of this machine.

use std::hint::black_box;
use std::vec::Vec;

use crate::arithmetic::{Arithmetic, Task, dispatch};
use crate::cubic::Cubic;

/// h (N, 6) of row-major points (N, 6).
pub fn values(cubic: &Cubic<f64>, points: &[f64]) -> Vec<f64> {
    dispatch(Values { cubic, points })
}

/// ∂h/∂p (N, 6, 6) of row-major points (N, 6).
pub fn jacobians(cubic: &Cubic<f64>, points: &[f64]) -> Vec<f64> {
    dispatch(Jacobians { cubic, points })
}

struct Values<'a> {
    cubic: &'a Cubic<f64>,
    points: &'a [f64],
}

impl Task for Values<'_> {
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) -> Vec<f64> {
        let mut results = Vec::with_capacity(self.points.len());
        for point in self.points.as_chunks::<6>().0 {
            // The result is forced into memory, so that the compiler keeps vectors before it.
            let h = black_box(self.cubic.value::<A>(point));
            results.extend_from_slice(&[h[0], h[1], h[2], h[3], h[4], h[5]]);
        }
        results
    }
}

struct Jacobians<'a> {
    cubic: &'a Cubic<f64>,
    points: &'a [f64],
}

impl Task for Jacobians<'_> {
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) -> Vec<f64> {
        let mut results = Vec::with_capacity(6 * self.points.len());
        for point in self.points.as_chunks::<6>().0 {
            let (_, g) = black_box(self.cubic.value_and_columns::<A>(point));
            let k: [[f64; 6]; 6] = core::array::from_fn(|j| core::array::from_fn(|i| g[i][j]));
            results.extend_from_slice(k.as_flattened());
        }
        results
    }
}
