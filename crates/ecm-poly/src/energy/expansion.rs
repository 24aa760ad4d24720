//! How the tables of an energy are made from exponents and coefficients.

use alloc::collections::BTreeSet;
use alloc::vec::Vec;

use ecm_se3::Real;

use crate::energy::invariants::Symmetry;
use crate::energy::plan::ROWS;
use crate::energy::tables::EnergyTables;
use crate::shape::ShapeError;

/// Exponents of the six variables.
pub(crate) type Monomial = [u8; 6];

/// Derivatives of a polynomial of N variables as sums of few monomials.
pub(crate) struct Expansion<R> {
    /// Monomial t + 1 is monomial `.0` times variable `.1`.
    pub products: Vec<(u16, u8)>,
    /// End of the entries of each derivative.
    pub ends: Vec<u16>,
    /// Monomial of each entry.
    pub columns: Vec<u16>,
    /// Weight of each entry.
    pub weights: Vec<R>,
}

impl<R: Real> Expansion<R> {
    /// From terms and the orders of differentiation of each row.
    pub(crate) fn new<const N: usize>(terms: &[([u8; N], f64)], orders: &[[u8; N]]) -> Self {
        let rows: Vec<Vec<([u8; N], f64)>> = orders
            .iter()
            .map(|orders| {
                let mut row: Vec<_> = terms
                    .iter()
                    .filter_map(|(e, w)| differentiated(e, orders).map(|(m, f)| (m, w * f)))
                    .collect();
                row.sort_by_key(|entry| order(&entry.0));
                row
            })
            .collect();
        let products = Products::new(rows.iter().flatten().map(|entry| entry.0));
        let (mut ends, mut columns, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        for row in &rows {
            for (monomial, weight) in row {
                columns.push(products.place(monomial));
                weights.push(R::from_f64(*weight));
            }
            ends.push(columns.len() as u16);
        }
        Self {
            products: products.table(),
            ends,
            columns,
            weights,
        }
    }
}

impl<R: Real> EnergyTables<R> {
    /// From exponents of the variables and coefficients (J) of coordinates divided by `scale`.
    ///
    /// # Errors
    /// More monomials than [`crate::energy::tables::LARGEST_MEMORY`].
    pub(crate) fn new(
        symmetry: Symmetry,
        exponents: &[Monomial],
        coefficients: &[f64],
        scale: [f64; 2],
        length_m: f64,
    ) -> Result<Self, ShapeError> {
        let terms = exponents.iter().zip(coefficients);
        let terms: Vec<(Monomial, f64)> = terms
            .map(|(row, c)| (*row, c * unscaled(symmetry, row, scale)))
            .collect();
        let found = Expansion::new(&terms, &row_orders());
        let mut ends = [0; ROWS];
        ends.copy_from_slice(&found.ends);
        Self::of_parts(
            (symmetry, R::from_f64(length_m)),
            found.products,
            ends,
            found.columns,
            found.weights,
        )
    }
}

#[cfg(feature = "std")]
impl<R: Real> From<EnergyTables<R>> for Expansion<R> {
    /// The sums alone.
    fn from(tables: EnergyTables<R>) -> Self {
        Self {
            products: tables.products().to_vec(),
            ends: tables.ends().to_vec(),
            columns: tables.columns().to_vec(),
            weights: tables.weights().to_vec(),
        }
    }
}

/// Monomials in an order in which each is an earlier one times a variable.
pub(crate) struct Products<const N: usize>(Vec<(u8, [u8; N])>);

impl<const N: usize> Products<N> {
    /// The monomials and all that they are products of.
    pub(crate) fn new(monomials: impl Iterator<Item = [u8; N]>) -> Self {
        let mut needed: BTreeSet<(u8, [u8; N])> = BTreeSet::from([order(&[0; N])]);
        for mut monomial in monomials {
            while needed.insert(order(&monomial)) {
                match parent(&monomial) {
                    Some((lower, _)) => monomial = lower,
                    None => break,
                }
            }
        }
        Self(needed.into_iter().collect())
    }

    /// The number of a monomial.
    pub(crate) fn place(&self, monomial: &[u8; N]) -> u16 {
        self.0.binary_search(&order(monomial)).unwrap_or(0) as u16
    }

    /// Factor and variable of each monomial after 1.
    pub(crate) fn table(&self) -> Vec<(u16, u8)> {
        self.0
            .iter()
            .filter_map(|(_, reversed)| parent(&reversed.map(|e| u8::MAX - e)))
            .map(|(lower, variable)| (self.place(&lower), variable))
            .collect()
    }
}

/// Sorts by degree, then as the paper's eq. (4): the first exponent falling.
fn order<const N: usize>(monomial: &[u8; N]) -> (u8, [u8; N]) {
    (monomial.iter().sum(), monomial.map(|e| u8::MAX - e))
}

/// The monomial with one factor less, its last variable; `None` for 1.
fn parent<const N: usize>(monomial: &[u8; N]) -> Option<([u8; N], u8)> {
    let last = monomial.iter().rposition(|&e| e > 0)?;
    let mut lower = *monomial;
    lower[last] -= 1;
    Some((lower, last as u8))
}

/// Orders of differentiation of the 28 rows.
pub(crate) fn row_orders<const N: usize>() -> Vec<[u8; N]> {
    let mut rows = alloc::vec![[0; N]];
    rows.extend((0..6).map(first_order));
    for i in 0..6 {
        for j in i..6 {
            let mut row = [0; N];
            row[i] += 1;
            row[j] += 1;
            rows.push(row);
        }
    }
    rows
}

/// Once by variable i.
pub(crate) fn first_order<const N: usize>(i: usize) -> [u8; N] {
    core::array::from_fn(|j| u8::from(i == j))
}

/// A derivative of a monomial, and its factor; `None` where it is 0.
pub(crate) fn differentiated<const N: usize>(
    monomial: &[u8; N],
    orders: &[u8; N],
) -> Option<([u8; N], f64)> {
    let mut result = *monomial;
    let mut factor = 1.0;
    for i in 0..N {
        for _ in 0..orders[i] {
            factor *= f64::from(result[i]);
            result[i] = result[i].checked_sub(1)?;
        }
    }
    Some((result, factor))
}

/// 1/(lᵃ αᵇ) of a term of a lengths and b angles.
pub(crate) fn unscaled(symmetry: Symmetry, row: &Monomial, scale: [f64; 2]) -> f64 {
    let degrees = symmetry.lengths_and_angles();
    let mut factor = 1.0;
    for (&e, (lengths, angles)) in row.iter().zip(degrees) {
        let unit = power(scale[0], lengths) * power(scale[1], angles);
        factor /= power(unit, e);
    }
    factor
}

/// xⁿ by squaring, in the order of the compiler's own `powi`, which needs std.
pub(crate) fn power(mut x: f64, mut n: u8) -> f64 {
    let mut result = 1.0;
    loop {
        if n % 2 == 1 {
            result *= x;
        }
        n /= 2;
        if n == 0 {
            return result;
        }
        x *= x;
    }
}
