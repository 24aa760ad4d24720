//! Warm start: an initial guess of a state, fitted to the load cases solved so far.
//!
//! Every component of the state in its bent frame (see [`super::bent_frame`]) is a polynomial of
//! the load's mid-frame coordinates (see [`Fem::point`]; scaled to [−1, 1]), fitted by least
//! squares to all solved cases; the degree grows with their number.

use super::{Fem, MOST_ACTUATORS, State};
use nalgebra::DMatrix;

/// Highest degree; a degree needs twice as many solved cases as it has terms, of six variables 14,
/// 56, 168, 420 and 924.
const MOST_DEGREE: usize = 5;

/// Number of monomials of `variables` up to `degree`.
fn number_of_terms(variables: usize, degree: usize) -> usize {
    (1..=degree).fold(1, |terms, k| terms * (variables + k) / k)
}

/// Ridge parameter of the normalised normal equations: terms that are collinear over the cases
/// share their coefficient instead of cancelling each other.
const RIDGE: f64 = 1e-10;

/// An initial guess of the state as a function of the load: a polynomial for each component.
#[derive(Debug, Clone, PartialEq)]
pub struct WarmStart {
    degree: usize,
    /// Largest size of each coordinate.
    scale: Vec<f64>,
    /// Component after component, one coefficient per term.
    coefficients: Vec<f32>,
    terms: usize,
}

/// One solved state: mid-frame coordinates of its load, and its state vector.
pub(super) type Sample<'a> = (&'a [f64], &'a [f32]);

/// All monomials up to `degree`, lowest first.
fn monomials(x: &[f64], degree: usize, out: &mut Vec<f64>) {
    out.clear();
    out.push(1.0);
    // Each monomial of one degree times the variables from its last one on.
    let mut last: Vec<(usize, usize)> = vec![(0, 0)];
    for _ in 0..degree {
        let mut next = Vec::new();
        for &(index, first) in &last {
            for (k, value) in x.iter().enumerate().skip(first) {
                out.push(out[index] * value);
                next.push((out.len() - 1, k));
            }
        }
        last = next;
    }
}

fn scaled(point: &[f64], scale: &[f64]) -> Vec<f64> {
    point.iter().zip(scale).map(|(x, s)| x / s).collect()
}

impl WarmStart {
    /// Fits the solved states; `None` when there are too few.
    pub(super) fn fit(samples: &[Sample]) -> Option<Self> {
        let variables = samples.first()?.0.len();
        let enough = |degree: &usize| samples.len() >= 2 * number_of_terms(variables, *degree);
        let degree = (1..=MOST_DEGREE).rev().find(enough)?;
        Self::of_degree(samples, degree)
    }

    /// Fits polynomials of one degree to any number of states; `None` when the fit is singular.
    pub(super) fn of_degree(samples: &[Sample], degree: usize) -> Option<Self> {
        let mut scale = vec![f64::MIN_POSITIVE; samples.first()?.0.len()];
        for (point, _) in samples {
            for (s, x) in scale.iter_mut().zip(*point) {
                *s = s.max(x.abs());
            }
        }
        let mut row = Vec::new();
        let mut features = Vec::new();
        for (point, _) in samples {
            monomials(&scaled(point, &scale), degree, &mut row);
            features.extend_from_slice(&row);
        }
        let (terms, cases) = (row.len(), samples.len());
        let phi = DMatrix::from_vec(terms, cases, features);
        let mut normal = &phi * phi.transpose();
        let ridge = RIDGE * cases as f64;
        for k in 0..terms {
            normal[(k, k)] += ridge;
        }
        let weights = normal.cholesky()?.solve(&phi);
        let components = samples[0].1.len();
        let values = DMatrix::from_fn(cases, components, |i, c| f64::from(samples[i].1[c]));
        let coefficients = (weights * values).iter().map(|&c| c as f32).collect();
        Some(Self {
            degree,
            scale,
            coefficients,
            terms,
        })
    }

    /// Bytes to send to another process that has the same body.
    pub fn to_bytes(&self) -> Vec<u8> {
        let head = [self.degree, self.terms, self.scale.len()].map(|n| n as u32);
        let mut bytes: Vec<u8> = head.iter().flat_map(|n| n.to_le_bytes()).collect();
        bytes.extend(self.scale.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(self.coefficients.iter().flat_map(|v| v.to_le_bytes()));
        bytes
    }

    /// Inverse of [`WarmStart::to_bytes`]; `None` for other bytes.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (head, rest) = bytes.split_at_checked(12)?;
        let number = |b: &[u8]| Some(u32::from_le_bytes(b.try_into().ok()?) as usize);
        let (degree, terms) = (number(&head[..4])?, number(&head[4..8])?);
        let variables = number(&head[8..])?;
        // More of either than is ever fitted would ask for all memory.
        if degree > MOST_DEGREE || !(6..=6 + MOST_ACTUATORS).contains(&variables) {
            return None;
        }
        let (scale, rest) = rest.split_at_checked(8 * variables)?;
        let doubles = (scale.chunks_exact(8)).map(|b| b.try_into().map(f64::from_le_bytes));
        let floats = (rest.chunks_exact(4)).map(|b| b.try_into().map(f32::from_le_bytes));
        let scale: Vec<f64> = doubles.collect::<Result<_, _>>().ok()?;
        let coefficients: Vec<f32> = floats.collect::<Result<_, _>>().ok()?;
        let fits = number_of_terms(variables, degree) == terms && rest.len() % (4 * terms) == 0;
        fits.then_some(Self {
            degree,
            scale,
            coefficients,
            terms,
        })
    }

    /// Number of values in a state vector.
    pub fn field_length(&self) -> usize {
        self.coefficients.len() / self.terms
    }

    /// Initial guess of the state for a load at `point`.
    pub(super) fn state(&self, point: &[f64], fem: &Fem) -> State {
        let terms = self.terms_at(point);
        fem.unflatten(self.values(&terms))
    }

    /// Initial guess of the pose alone.
    pub(super) fn pose(&self, point: &[f64]) -> [f64; 6] {
        let terms = self.terms_at(point);
        let mut values = self.values(&terms);
        std::array::from_fn(|_| values.next().unwrap_or_default())
    }

    fn terms_at(&self, point: &[f64]) -> Vec<f64> {
        let mut terms = Vec::new();
        monomials(&scaled(point, &self.scale), self.degree, &mut terms);
        terms
    }

    fn values<'a>(&'a self, terms: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let dot = move |c: &[f32]| c.iter().zip(terms).map(|(a, b)| f64::from(*a) * b).sum();
        self.coefficients.chunks_exact(self.terms).map(dot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn monomials_are_complete_and_distinct() {
        let x = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0];
        for (degree, count) in [(1, 7), (2, 28), (3, 84), (4, 210), (5, 462)] {
            let mut terms = Vec::new();
            monomials(&x, degree, &mut terms);
            assert_eq!(terms.len(), count);
            assert_eq!(number_of_terms(6, degree), count);
            // Primes: equal products are equal monomials.
            terms.sort_by(f64::total_cmp);
            terms.dedup();
            assert_eq!(terms.len(), count);
        }
    }
}
