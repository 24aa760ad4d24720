//! Evaluation of a cubic pose-to-wrench map at many points, with the SIMD instructions of this machine
//! and on all its cores.

use alloc::vec::Vec;
use core::hint::black_box;

use ecm_se3::{Mat6, Vec6};

use crate::arithmetic::{Arithmetic, Task, dispatch};
use crate::cubic::Cubic;
use crate::parallel::fill;

/// h (N, 6) of row-major points (N, 6).
pub(crate) fn values(cubic: &Cubic<f64>, points: &[f64]) -> Vec<f64> {
    let points = points.as_chunks::<6>().0;
    let of_piece = |points: &[_], values: &mut [_]| dispatch(Values(cubic, points, values));
    fill(points, [0.0; 6], of_piece).into_flattened()
}

/// ∂h/∂p (N, 6, 6) of row-major points (N, 6).
pub(crate) fn jacobians(cubic: &Cubic<f64>, points: &[f64]) -> Vec<f64> {
    let points = points.as_chunks::<6>().0;
    let of_piece = |points: &[_], jacobians: &mut [_]| {
        dispatch(Jacobians(cubic, points, jacobians));
    };
    let jacobians = fill(points, [[0.0; 6]; 6], of_piece);
    jacobians.into_flattened().into_flattened()
}

/// h and ∂h/∂p of one point.
#[inline]
pub(crate) fn one(cubic: &Cubic<f64>, point: &Vec6<f64>) -> (Vec6<f64>, Mat6<f64>) {
    dispatch(One(cubic, point))
}

struct Values<'a>(&'a Cubic<f64>, &'a [Vec6<f64>], &'a mut [Vec6<f64>]);

impl Task for Values<'_> {
    type Output = ();
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) {
        for (value, point) in self.2.iter_mut().zip(self.1) {
            // The result is forced into memory, so that the compiler keeps vectors before it.
            let h = black_box(self.0.value::<A>(point));
            *value = [h[0], h[1], h[2], h[3], h[4], h[5]];
        }
    }
}

struct Jacobians<'a>(&'a Cubic<f64>, &'a [Vec6<f64>], &'a mut [Mat6<f64>]);

impl Task for Jacobians<'_> {
    type Output = ();
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) {
        for (jacobian, point) in self.2.iter_mut().zip(self.1) {
            let (_, g) = black_box(self.0.value_and_columns::<A>(point));
            *jacobian = core::array::from_fn(|j| core::array::from_fn(|i| g[i][j]));
        }
    }
}

struct One<'a>(&'a Cubic<f64>, &'a Vec6<f64>);

impl Task for One<'_> {
    type Output = (Vec6<f64>, Mat6<f64>);
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) -> Self::Output {
        let (h, g) = black_box(self.0.value_and_columns::<A>(self.1));
        let k = core::array::from_fn(|j| core::array::from_fn(|i| g[i][j]));
        (core::array::from_fn(|j| h[j]), k)
    }
}
