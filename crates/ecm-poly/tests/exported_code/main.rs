//! Exported C and Rust compile without warnings and give the model's golden vectors.
#![allow(clippy::unwrap_used, clippy::print_stderr, missing_docs)]

mod c;
mod models;
mod programs;
mod rust;

use ecm_poly::export::{Precision, c as c_code, rust as rust_code};
use ecm_poly::stepper::Effects;

use crate::models::polynomial;

#[test]
fn names_and_shapes_that_cannot_be_exported_are_refused() {
    let document = polynomial(3, 2, 2);
    assert!(
        c_code::export(&document, "My Neck", Precision::Double)
            .unwrap_err()
            .to_string()
            .contains("lower-case")
    );
    let plain = rust_code::export(&document, "neck", Precision::Double).unwrap();
    assert!(plain.iter().all(|file| !file.path.contains("evaluation")));
    let none = Effects::none(1.0);
    assert!(
        rust_code::export_with_effects(&document, "neck", Precision::Double, Some(&none))
            .unwrap_err()
            .to_string()
            .contains("a polynomial with effects of time")
    );
}
