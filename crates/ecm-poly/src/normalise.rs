//! The paper's normalisation: each input from its range to [−1, 1].

use ecm_se3::Real;

/// Width (m or rad) below which a range has no width: a picometre is no motion, whatever its digits.
const SMALLEST_WIDTH: f64 = 1e-12;

/// u = (p − centre) / half of one input; a range without width maps to 0.
#[inline(always)]
pub fn to_unit<R: Real>(value: R, lower: R, upper: R) -> R {
    (value - R::HALF * (lower + upper)) * unit_slope(lower, upper)
}

/// du/dp = 2 / (upper − lower); 0 for a range without width, whose input has no effect.
///
/// A width of rounding, eight units in the last place of its ends or below 1e-12, counts as none: it
/// would make a polynomial that predicts 1e20 N one nanometre beside its data.
///
/// ```
/// use ecm_poly::normalise::unit_slope;
/// assert_eq!(unit_slope(-0.5, 0.5), 2.0);
/// assert_eq!(unit_slope(0.1, 0.1 + 1.4e-17), 0.0);
/// ```
#[inline(always)]
pub fn unit_slope<R: Real>(lower: R, upper: R) -> R {
    let width = upper - lower;
    let size = |x: R| if x < R::ZERO { -x } else { x };
    let rounding = R::from_u16(8) * R::EPSILON * (size(lower) + size(upper)) * R::HALF;
    if width > rounding && width > R::from_f64(SMALLEST_WIDTH) {
        R::TWO / width
    } else {
        R::ZERO
    }
}

/// Smallest and largest value of each of `inputs` columns of row-major `rows`.
///
/// # Panics
/// Where `inputs` numbers are more than memory holds.
#[cfg(feature = "std")]
pub fn ranges(rows: &[f64], inputs: usize) -> (std::vec::Vec<f64>, std::vec::Vec<f64>) {
    let mut lower = std::vec![f64::INFINITY; inputs];
    let mut upper = std::vec![f64::NEG_INFINITY; inputs];
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

    #[test]
    fn a_width_of_rounding_is_no_width() {
        let next = |x: f64| f64::from_bits(x.to_bits() + 1);
        for (lower, upper) in [
            (0.1034, next(0.1034)),
            (-7e-18, 7e-18),
            (1e6, next(1e6)),
            (0.0, 5e-324),
        ] {
            assert_eq!(unit_slope(lower, upper), 0.0, "{lower} {upper}");
            assert_eq!(to_unit(lower + 1e-9, lower, upper), 0.0);
        }
        assert_eq!(unit_slope(0.1_f32, 0.1 + 0.5 * f32::EPSILON), 0.0);
        assert!(unit_slope(-1e-9, 1e-9) > 0.0 && unit_slope(0.1, 0.1 + 1e-9) > 0.0);
    }
}
