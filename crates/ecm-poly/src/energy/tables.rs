//! The tables of an [`EnergyPlan`], made from exponents and coefficients.

use alloc::collections::BTreeSet;
use alloc::vec::Vec;

use ecm_se3::Real;

use crate::energy::invariants::Symmetry;
use crate::energy::plan::{EnergyPlan, ROWS};
use crate::energy::simd::SimdPlan;

/// Owned tables of an [`EnergyPlan`].
#[derive(Clone, Debug)]
pub struct EnergyTables<R> {
    symmetry: Symmetry,
    length_m: R,
    products: Vec<(u16, u8)>,
    ends: [u16; ROWS],
    columns: Vec<u16>,
    weights: Vec<R>,
}

/// Owned tables of a [`SimdPlan`] of `B` lanes.
#[derive(Clone, Debug)]
pub struct SimdTables<R, const B: usize> {
    length_m: R,
    degree: usize,
    powers: [[u8; 3]; B],
    coefficients: Vec<[R; B]>,
}

impl<R: Real, const B: usize> SimdTables<R, B> {
    /// As [`EnergyTables::new`]; `None` for a general energy, degrees other
    /// than 4, 5, 6, or one that needs more lanes.
    pub fn new(
        symmetry: Symmetry,
        exponents: &[Monomial],
        coefficients: &[f64],
        scale: [f64; 2],
        length_m: f64,
    ) -> Option<Self> {
        if symmetry == Symmetry::General {
            return None;
        }
        let mut lanes: Vec<[u8; 3]> = Vec::new();
        let mut degree = 0;
        for &[x, p, t, theta_x, a, b] in exponents {
            let key = [theta_x, a, b];
            if !lanes.contains(&key) {
                lanes.push(key);
            }
            degree = degree.max(usize::from(x) + 2 * usize::from(p) + 2 * usize::from(t));
        }
        if lanes.len() > B || !(4..=6).contains(&degree) {
            return None;
        }
        let mut powers = [[0; 3]; B];
        powers[..lanes.len()].copy_from_slice(&lanes);
        let half = degree / 2;
        let mut table = Vec::new();
        for j in (0..=half).rev() {
            for k in (0..=half - j).rev() {
                for n in (0..=degree - 2 * (j + k)).rev() {
                    let mut row = [R::ZERO; B];
                    for (e, &c) in exponents.iter().zip(coefficients) {
                        let [x, p, t, theta_x, a, b] = *e;
                        let here = [usize::from(x), usize::from(p), usize::from(t)];
                        let lane = lanes.iter().position(|l| *l == [theta_x, a, b]);
                        if let (true, Some(l)) = (here == [n, j, k], lane) {
                            row[l] = R::from_f64(c * unscaled(symmetry, e, scale));
                        }
                    }
                    table.push(row);
                }
            }
        }
        Some(Self {
            length_m: R::from_f64(length_m),
            degree,
            powers,
            coefficients: table,
        })
    }

    /// The tables, borrowed.
    pub fn plan(&self) -> SimdPlan<'_, R, B> {
        SimdPlan {
            length_m: self.length_m,
            degree: self.degree,
            powers: self.powers,
            coefficients: &self.coefficients,
        }
    }
}

type Monomial = [u8; 6];

impl<R: Real> EnergyTables<R> {
    /// From exponents of the variables and coefficients (J) of coordinates divided by `scale`.
    pub fn new(
        symmetry: Symmetry,
        exponents: &[Monomial],
        coefficients: &[f64],
        scale: [f64; 2],
        length_m: f64,
    ) -> Self {
        let weights: Vec<f64> = exponents
            .iter()
            .zip(coefficients)
            .map(|(row, c)| c * unscaled(symmetry, row, scale))
            .collect();
        let rows: Vec<Vec<(Monomial, f64)>> = row_orders()
            .iter()
            .map(|orders| {
                let terms = exponents.iter().zip(&weights);
                let mut row: Vec<_> = terms
                    .filter_map(|(e, &w)| differentiated(e, orders).map(|(m, f)| (m, w * f)))
                    .collect();
                row.sort_by_key(|entry| order(&entry.0));
                row
            })
            .collect();
        let mut needed: BTreeSet<(u8, Monomial)> = BTreeSet::from([order(&[0; 6])]);
        for (mut monomial, _) in rows.iter().flatten().copied() {
            while needed.insert(order(&monomial)) {
                match parent(&monomial) {
                    Some((lower, _)) => monomial = lower,
                    None => break,
                }
            }
        }
        let list: Vec<_> = needed.into_iter().collect();
        let place = |m: &Monomial| list.binary_search(&order(m)).unwrap_or(0) as u16;
        let products = list
            .iter()
            .filter_map(|(_, reversed)| parent(&reversed.map(|e| u8::MAX - e)))
            .map(|(lower, variable)| (place(&lower), variable))
            .collect();
        let mut ends = [0; ROWS];
        let (mut columns, mut values) = (Vec::new(), Vec::new());
        for (end, row) in ends.iter_mut().zip(&rows) {
            for (monomial, weight) in row {
                columns.push(place(monomial));
                values.push(R::from_f64(*weight));
            }
            *end = columns.len() as u16;
        }
        Self {
            symmetry,
            length_m: R::from_f64(length_m),
            products,
            ends,
            columns,
            weights: values,
        }
    }

    /// The tables, borrowed.
    pub fn plan(&self) -> EnergyPlan<'_, R> {
        EnergyPlan {
            symmetry: self.symmetry,
            length_m: self.length_m,
            products: &self.products,
            ends: self.ends,
            columns: &self.columns,
            weights: &self.weights,
        }
    }
}

/// Sorts by degree, then as the paper's eq. (4): the first exponent falling.
fn order(monomial: &Monomial) -> (u8, Monomial) {
    (monomial.iter().sum(), monomial.map(|e| u8::MAX - e))
}

/// The monomial with one factor less, its last variable; `None` for 1.
fn parent(monomial: &Monomial) -> Option<(Monomial, u8)> {
    let last = monomial.iter().rposition(|&e| e > 0)?;
    let mut lower = *monomial;
    lower[last] -= 1;
    Some((lower, last as u8))
}

/// Orders of differentiation of the 28 rows.
fn row_orders() -> Vec<Monomial> {
    let mut rows = alloc::vec![[0; 6]];
    for i in 0..6 {
        let mut row = [0; 6];
        row[i] = 1;
        rows.push(row);
    }
    for i in 0..6 {
        for j in i..6 {
            let mut row = [0; 6];
            row[i] += 1;
            row[j] += 1;
            rows.push(row);
        }
    }
    rows
}

/// A derivative of a monomial, and its factor; `None` where it is 0.
fn differentiated(monomial: &Monomial, orders: &Monomial) -> Option<(Monomial, f64)> {
    let mut result = *monomial;
    let mut factor = 1.0;
    for i in 0..6 {
        for _ in 0..orders[i] {
            factor *= f64::from(result[i]);
            result[i] = result[i].checked_sub(1)?;
        }
    }
    Some((result, factor))
}

/// 1/(lᵃ αᵇ) of a term of a lengths and b angles.
fn unscaled(symmetry: Symmetry, row: &Monomial, scale: [f64; 2]) -> f64 {
    let degrees = symmetry.lengths_and_angles();
    let mut factor = 1.0;
    for (&e, (lengths, angles)) in row.iter().zip(degrees) {
        let unit = power(scale[0], lengths) * power(scale[1], angles);
        factor /= power(unit, e);
    }
    factor
}

/// xⁿ by squaring; core has no function for it.
fn power(x: f64, n: u8) -> f64 {
    let (mut product, mut square, mut left) = (1.0, x, n);
    while left > 0 {
        if left % 2 == 1 {
            product *= square;
        }
        square *= square;
        left /= 2;
    }
    product
}
