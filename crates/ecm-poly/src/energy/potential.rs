//! Value and derivatives of a polynomial of six variables, term by term.

use ecm_se3::{Real, Vec6};

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

    /// v_i^e, or its derivative by v_i.
    #[inline(always)]
    fn factor(&self, i: usize, e: u8, derivative: bool) -> R {
        // Exponents are checked against MAX_POWER where a map is made.
        let power = |e: u8| self.0[i][usize::from(e) % (MAX_POWER + 1)];
        match (derivative, e) {
            (false, _) => power(e),
            (true, 0) => R::ZERO,
            (true, _) => R::from_u16(u16::from(e)) * power(e - 1),
        }
    }

    /// Π v_i^e_i.
    #[inline]
    pub fn value(&self, exponents: &[u8; 6]) -> R {
        self.product(exponents, None)
    }

    /// ∂(Π v_i^e_i)/∂v.
    #[inline]
    pub fn gradient(&self, exponents: &[u8; 6]) -> Vec6<R> {
        core::array::from_fn(|i| {
            if exponents[i] == 0 {
                return R::ZERO;
            }
            self.product(exponents, Some(i))
        })
    }

    /// Π v_i^e_i, or its derivative by one variable.
    #[inline(always)]
    fn product(&self, exponents: &[u8; 6], by: Option<usize>) -> R {
        let mut product = R::ONE;
        for i in 0..6 {
            product = product * self.factor(i, exponents[i], by == Some(i));
        }
        product
    }
}
