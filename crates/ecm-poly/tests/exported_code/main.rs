//! Exported C and Rust compile without warnings and give the model's golden vectors.
#![allow(clippy::unwrap_used, clippy::print_stderr, missing_docs)]

mod adapt;
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

#[test]
fn names_of_columns_add_no_code_and_words_of_rust_name_no_crate() {
    for hostile in [
        "y */ int evil; /*_m",
        "y_m\n}",
        "y_m, theta_z_rad",
        "@STEPPER@",
    ] {
        for key in ["inputs", "outputs"] {
            let mut document = polynomial(3, 2, 2);
            document[key][0] = hostile.into();
            for refusal in [
                c_code::export(&document, "neck", Precision::Double),
                rust_code::export(&document, "neck", Precision::Double),
            ] {
                let message = refusal.unwrap_err().to_string();
                assert!(message.contains(key) && message.contains("rename"));
            }
        }
    }
    let document = polynomial(3, 2, 2);
    for word in ["fn", "self", "crate", "std", "test"] {
        assert!(rust_code::export(&document, word, Precision::Double).is_err());
        assert!(c_code::export(&document, word, Precision::Double).is_ok());
    }
}
