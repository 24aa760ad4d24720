//! Quadrature on the unit tetrahedron in barycentric coordinates.

/// Which rule; weights sum to 1/6, the volume of the unit tetrahedron.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Rule {
    /// Four points, exact to degree 2 (Hammer and Stroud 1956): the rule of
    /// CalculiX' C3D10, and enough for P2/P1 on straight elements.
    #[default]
    Degree2,
    /// Fourteen points, exact to degree 5 (Walkington 2000), all weights positive.
    Degree5,
}

const A2: f64 = 0.138_196_601_125_010_5;
const B2: f64 = 1.0 - 3.0 * A2;
const W2: f64 = 1.0 / 24.0;
const DEGREE2: [([f64; 4], f64); 4] = [
    ([B2, A2, A2, A2], W2),
    ([A2, B2, A2, A2], W2),
    ([A2, A2, B2, A2], W2),
    ([A2, A2, A2, B2], W2),
];

const A5: f64 = 0.310_885_919_263_300_6;
const B5: f64 = 0.092_735_250_310_891_23;
const C5: f64 = 0.045_503_704_125_649_65;
const D5: f64 = 0.5 - C5;
const WA5: f64 = 0.112_687_925_718_015_85 / 6.0;
const WB5: f64 = 0.073_493_043_116_361_95 / 6.0;
const WC5: f64 = 0.042_546_020_777_081_466 / 6.0;
const DEGREE5: [([f64; 4], f64); 14] = [
    ([1.0 - 3.0 * A5, A5, A5, A5], WA5),
    ([A5, 1.0 - 3.0 * A5, A5, A5], WA5),
    ([A5, A5, 1.0 - 3.0 * A5, A5], WA5),
    ([A5, A5, A5, 1.0 - 3.0 * A5], WA5),
    ([1.0 - 3.0 * B5, B5, B5, B5], WB5),
    ([B5, 1.0 - 3.0 * B5, B5, B5], WB5),
    ([B5, B5, 1.0 - 3.0 * B5, B5], WB5),
    ([B5, B5, B5, 1.0 - 3.0 * B5], WB5),
    ([C5, C5, D5, D5], WC5),
    ([C5, D5, C5, D5], WC5),
    ([C5, D5, D5, C5], WC5),
    ([D5, C5, C5, D5], WC5),
    ([D5, C5, D5, C5], WC5),
    ([D5, D5, C5, C5], WC5),
];

impl Rule {
    /// Barycentric points and weights.
    pub fn points(self) -> &'static [([f64; 4], f64)] {
        match self {
            Self::Degree2 => &DEGREE2,
            Self::Degree5 => &DEGREE5,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factorial(n: i32) -> f64 {
        (1..=n).map(f64::from).product()
    }

    /// ∫ l0^a l1^b l2^c l3^d = a! b! c! d! / (a + b + c + d + 3)!
    #[test]
    fn rules_integrate_their_degree_exactly() {
        for (rule, degree) in [(Rule::Degree2, 2), (Rule::Degree5, 5)] {
            for a in 0..=degree {
                for b in 0..=degree - a {
                    for c in 0..=degree - a - b {
                        let d = degree - a - b - c;
                        let sum: f64 = rule
                            .points()
                            .iter()
                            .map(|(l, w)| {
                                w * l[0].powi(a) * l[1].powi(b) * l[2].powi(c) * l[3].powi(d)
                            })
                            .sum();
                        let exact = factorial(a) * factorial(b) * factorial(c) * factorial(d)
                            / factorial(degree + 3);
                        assert!((sum - exact).abs() < 1e-15, "{rule:?} {a}{b}{c}{d}");
                    }
                }
            }
        }
    }
}
