//! Value and derivatives of a polynomial of six variables, term by term.

use ecm_se3::{Mat6, Real, Vec6};

/// Highest power of one variable.
pub const MAX_POWER: usize = 8;

/// Powers of the six variables at one point.
#[derive(Clone, Copy, Debug)]
pub struct Powers<R>([[R; MAX_POWER + 1]; 6]);

impl<R: Real> Powers<R> {
    /// v_i^e for e = 0 … 8.
    #[inline]
    pub fn new(variables: &Vec6<R>) -> Self {
        let mut table = [[R::ONE; MAX_POWER + 1]; 6];
        for (row, &v) in table.iter_mut().zip(variables) {
            for e in 1..=MAX_POWER {
                row[e] = row[e - 1] * v;
            }
        }
        Self(table)
    }

    /// d^order(v_i^e)/dv_i^order.
    #[inline(always)]
    fn factor(&self, i: usize, e: u8, order: u8) -> R {
        if e < order {
            return R::ZERO;
        }
        let falling = match order {
            0 => R::ONE,
            1 => R::from_f64(f64::from(e)),
            _ => R::from_f64(f64::from(e) * f64::from(e - 1)),
        };
        // Exponents are checked against MAX_POWER where a map is made.
        falling * self.0[i][usize::from(e - order) % (MAX_POWER + 1)]
    }

    /// Π v_i^e_i.
    #[inline]
    pub fn value(&self, exponents: &[u8; 6]) -> R {
        self.derivative(exponents, &[0; 6])
    }

    /// The mixed derivative of order `orders` of Π v_i^e_i.
    #[inline(always)]
    fn derivative(&self, exponents: &[u8; 6], orders: &[u8; 6]) -> R {
        let mut product = R::ONE;
        for i in 0..6 {
            product = product * self.factor(i, exponents[i], orders[i]);
        }
        product
    }

    /// ∂(Π v_i^e_i)/∂v.
    #[inline]
    pub fn gradient(&self, exponents: &[u8; 6]) -> Vec6<R> {
        core::array::from_fn(|i| {
            if exponents[i] == 0 {
                return R::ZERO;
            }
            let mut orders = [0; 6];
            orders[i] = 1;
            self.derivative(exponents, &orders)
        })
    }

    /// Adds weight · ∂²(Π v_i^e_i)/∂v² to the upper triangle of `hessian`.
    #[inline]
    pub fn add_hessian(&self, exponents: &[u8; 6], weight: R, hessian: &mut Mat6<R>) {
        for i in 0..6 {
            if exponents[i] == 0 {
                continue;
            }
            for j in i..6 {
                if exponents[j] == 0 || (i == j && exponents[i] < 2) {
                    continue;
                }
                let mut orders = [0; 6];
                orders[i] += 1;
                orders[j] += 1;
                hessian[i][j] += weight * self.derivative(exponents, &orders);
            }
        }
    }
}
