//! The paper's normalisation: each input from its range to [−1, 1].

use ecm_se3::Real;

/// u = (p − centre) / half of one input; a range without width maps to 0.
#[inline(always)]
pub fn to_unit<R: Real>(value: R, lower: R, upper: R) -> R {
    (value - R::HALF * (lower + upper)) * unit_slope(lower, upper)
}

/// du/dp = 2 / (upper − lower); 0 for a range without width, whose input has no effect.
#[inline(always)]
pub fn unit_slope<R: Real>(lower: R, upper: R) -> R {
    let width = upper - lower;
    if width > R::ZERO {
        R::TWO / width
    } else {
        R::ZERO
    }
}

/// Smallest and largest value of each of `inputs` columns of row-major `rows`.
#[cfg(feature = "alloc")]
pub fn ranges(rows: &[f64], inputs: usize) -> (alloc::vec::Vec<f64>, alloc::vec::Vec<f64>) {
    let mut lower = alloc::vec![f64::INFINITY; inputs];
    let mut upper = alloc::vec![f64::NEG_INFINITY; inputs];
    for row in rows.chunks_exact(inputs.max(1)) {
        for (x, (low, high)) in row.iter().zip(lower.iter_mut().zip(&mut upper)) {
            *low = low.min(*x);
            *high = high.max(*x);
        }
    }
    (lower, upper)
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn ends_go_to_minus_one_and_one(lower in -1e3..1e3_f64, width in 1e-6..1e3_f64, t in 0.0..1.0_f64) {
            let upper = lower + width;
            prop_assert!((to_unit(lower, lower, upper) + 1.0).abs() < 1e-6);
            prop_assert!((to_unit(upper, lower, upper) - 1.0).abs() < 1e-6);
            let u = to_unit(lower + t * width, lower, upper);
            prop_assert!((u - (2.0 * t - 1.0)).abs() < 1e-6);
        }
    }

    #[test]
    fn a_constant_input_maps_to_zero() {
        assert_eq!(to_unit(3.0, 3.0, 3.0), 0.0);
        assert_eq!(unit_slope(3.0, 3.0), 0.0);
    }
}
