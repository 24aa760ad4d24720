//! Polynomial regressor of normalised coordinates.

use crate::DesignError;

/// Exponents of all monomials of `inputs` variables up to `degree`: by degree, then with the
/// first variable's power falling (the order of the paper's equation (4)).
pub fn exponents(inputs: usize, degree: usize) -> Vec<Vec<u8>> {
    let mut all = Vec::new();
    for total in 0..=degree {
        let mut term = vec![0u8; inputs];
        fill(&mut all, &mut term, 0, total);
    }
    all
}

fn fill(all: &mut Vec<Vec<u8>>, term: &mut [u8], at: usize, left: usize) {
    if at + 1 >= term.len() {
        if at < term.len() {
            term[at] = left as u8;
        }
        if at < term.len() || left == 0 {
            all.push(term.to_vec());
        }
        return;
    }
    for power in (0..=left).rev() {
        term[at] = power as u8;
        fill(all, term, at + 1, left - power);
    }
    term[at] = 0;
}

/// Coordinates mapped column by column from [min, max] to [-1, 1]; constant columns become 0.
///
/// # Errors
/// Numbers that are not finite and an array that does not fit its columns.
pub fn normalise(points: &[f64], columns: usize) -> Result<Vec<f64>, DesignError> {
    if columns == 0 || points.is_empty() {
        return Err(DesignError::Empty);
    }
    if points.len() % columns != 0 {
        let expected = points.len().div_ceil(columns) * columns;
        return Err(DesignError::Shape { what: "the points", found: points.len(), expected });
    }
    crate::problem::check_finite("the points", points, columns)?;
    let (mut low, mut high) = (vec![f64::INFINITY; columns], vec![f64::NEG_INFINITY; columns]);
    for row in points.chunks_exact(columns) {
        for (c, v) in row.iter().enumerate() {
            low[c] = low[c].min(*v);
            high[c] = high[c].max(*v);
        }
    }
    let map = |c: usize, v: f64| {
        if high[c] > low[c] { 2.0 * ((v - low[c]) / (high[c] - low[c])) - 1.0 } else { 0.0 }
    };
    Ok(points.iter().enumerate().map(|(i, v)| map(i % columns, *v)).collect())
}

/// (N x k) regressor of N points in [-1, 1]^columns.
pub fn polynomial(points: &[f64], columns: usize, degree: usize) -> Vec<f64> {
    let terms = exponents(columns, degree);
    let mut rows = Vec::with_capacity(points.len() / columns.max(1) * terms.len());
    for point in points.chunks_exact(columns) {
        for term in &terms {
            rows.push(point.iter().zip(term).map(|(v, e)| v.powi(i32::from(*e))).product());
        }
    }
    rows
}
