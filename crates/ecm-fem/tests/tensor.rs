//! Eigenvalues of symmetric 3 × 3 matrices: closed forms, any scale, and those of nalgebra.

use ecm_fem::tensor::{Mat3, symmetric_eigenvalues};
use proptest::prelude::*;

fn assert_close(a: &Mat3, expected: [f64; 3]) {
    let size = expected
        .iter()
        .fold(0.0, |size: f64, value| size.max(value.abs()));
    let found = symmetric_eigenvalues(a);
    for (value, expected) in found.iter().zip(expected) {
        assert!((value - expected).abs() <= 4e-15 * size, "{found:?}, {a:?}");
    }
}

#[test]
fn eigenvalues_are_those_of_closed_forms() {
    // A chain of two springs: 2 - sqrt(2), 2, 2 + sqrt(2).
    let root = 2f64.sqrt();
    let chain = [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]];
    assert_close(&chain, [2.0 - root, 2.0, 2.0 + root]);
    // Simple shear by g: stretches squared 1 and 1 + g²/2 ± g sqrt(1 + g²/4).
    let g = 0.7f64;
    let shear = [[1.0, g, 0.0], [g, 1.0 + g * g, 0.0], [0.0, 0.0, 1.0]];
    let (middle, half) = (1.0 + g * g / 2.0, g * (1.0 + g * g / 4.0).sqrt());
    assert_close(&shear, [middle - half, 1.0, middle + half]);
}

#[test]
fn equal_eigenvalues_are_as_accurate() {
    assert_close(
        &[[3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]],
        [3.0; 3],
    );
    assert_close(&[[0.0; 3]; 3], [0.0; 3]);
    // 1 + u u^T with |u|² = 14, and u u^T alone, which is singular.
    let u = [1.0, 2.0, 3.0];
    let rank_one = u.map(|x| u.map(|y| x * y));
    assert_close(&rank_one, [0.0, 0.0, 14.0]);
    let mut raised = rank_one;
    (0..3).for_each(|i| raised[i][i] += 1.0);
    assert_close(&raised, [1.0, 1.0, 15.0]);
    assert_close(
        &[[1.0, 1e-9, 0.0], [1e-9, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [1.0 - 1e-9, 1.0, 1.0 + 1e-9],
    );
}

#[test]
fn entries_of_any_size_are_rotated() {
    for scale in [1e-300, 1e-170, 1e-20, 1e20, 1e170, 1e300] {
        let a = [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]];
        let root = 2f64.sqrt();
        let expected = [2.0 - root, 2.0, 2.0 + root].map(|value| value * scale);
        assert_close(&a.map(|row| row.map(|value| value * scale)), expected);
    }
}

#[test]
fn an_entry_that_is_not_finite_gives_no_number() {
    for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for (i, j) in [(0, 0), (0, 1), (1, 2), (2, 2)] {
            let mut a = [[2.0, 0.5, 0.1], [0.5, 1.0, 0.2], [0.1, 0.2, 3.0]];
            (a[i][j], a[j][i]) = (wrong, wrong);
            let found = symmetric_eigenvalues(&a);
            assert!(found.iter().all(|value| value.is_nan()), "{found:?}, {a:?}");
        }
    }
}

proptest! {
    #[test]
    fn eigenvalues_are_those_of_nalgebra(
        entries in prop::array::uniform6(-1.0f64..1.0),
        // From entries of one size to such that are nearly diagonal, at any scale.
        (close, scale) in (-18i32..=0, -100i32..100),
    ) {
        let [a, b, c, d, e, f] = entries;
        let off = 10f64.powi(close);
        let matrix = [[a, d * off, e * off], [d * off, b, f * off], [e * off, f * off, c]]
            .map(|row| row.map(|value| value * 10f64.powi(scale)));
        let theirs = nalgebra::Matrix3::from_fn(|i, j| matrix[i][j]).symmetric_eigenvalues();
        let mut expected = [theirs[0], theirs[1], theirs[2]];
        expected.sort_by(f64::total_cmp);
        let size = expected.iter().fold(0.0, |size: f64, value| size.max(value.abs()));
        for (value, expected) in symmetric_eigenvalues(&matrix).iter().zip(expected) {
            prop_assert!((value - expected).abs() <= 2e-14 * size, "{matrix:?}");
        }
    }
}
