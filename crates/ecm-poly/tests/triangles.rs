//! The triangle of many blocks of rows has the singular values of all rows at once.

#![allow(clippy::unwrap_used)]

use std::ops::Range;

use ecm_poly::dense::singular_values;
use ecm_poly::regression::triangle::Triangle;

const COLUMNS: usize = 100;
/// More than a dozen blocks.
const ROWS: usize = 20_000;

/// Numbers in [−1, 1] that look random.
fn noise(i: usize, j: usize) -> f64 {
    let mut x = (i * COLUMNS + j + 1) as u64;
    for _ in 0..3 {
        x = (x ^ (x >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    }
    (x >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Largest error of a singular value over the largest one.
fn error_of(row: impl Fn(usize) -> Vec<f64> + Sync) -> f64 {
    let fill = |range: Range<usize>| Ok(range.flat_map(&row).collect());
    let triangle = Triangle::of_rows(ROWS, 1, COLUMNS, fill).unwrap();
    assert_eq!(triangle.rows(), ROWS);
    let found = singular_values(&triangle.to_row_major(), COLUMNS).unwrap();
    let all: Vec<f64> = (0..ROWS).flat_map(&row).collect();
    let expected = singular_values(&all, COLUMNS).unwrap();
    found
        .iter()
        .zip(&expected)
        .map(|(a, b)| (a - b).abs() / expected[0])
        .fold(0.0, f64::max)
}

#[test]
fn columns_of_very_different_size() {
    let row = |i| (0..COLUMNS).map(move |j| noise(i, j) * 0.7_f64.powi(j as i32));
    assert!(error_of(|i| row(i).collect()) < 1e-14);
}

#[test]
fn a_column_that_is_nearly_the_sum_of_the_others() {
    // The Gram matrix would lose the smallest singular value, 1e-11 of the largest.
    let row = |i| {
        let mut line: Vec<f64> = (0..COLUMNS - 1).map(|j| noise(i, j)).collect();
        line.push(line.iter().sum::<f64>() + 1e-9 * noise(i, COLUMNS));
        line
    };
    assert!(error_of(row) < 1e-14);
}

#[test]
fn rows_far_beyond_those_before_them_and_columns_that_begin_late() {
    let row = |i: usize| {
        let size = if i < ROWS / 2 { 1e-6 } else { 1.0 };
        let mut line: Vec<f64> = (0..COLUMNS).map(|j| size * noise(i, j)).collect();
        if i < ROWS / 3 {
            line[7] = 0.0;
        }
        line
    };
    assert!(error_of(row) < 1e-14);
}
