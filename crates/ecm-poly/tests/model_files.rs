//! Model files open as they were sealed, and not at all when anything was changed.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use ecm_poly::basis::exponents;
use ecm_poly::energy::terms::terms;
use ecm_poly::model_file::canonical::canonical;
use ecm_poly::{Symmetry, open_model, seal_model};
use proptest::prelude::*;
use serde_json::{Value, json};

fn polynomial() -> Value {
    let rows: Vec<Vec<u8>> = exponents(3, 2)
        .unwrap()
        .chunks(3)
        .map(<[u8]>::to_vec)
        .collect();
    let coefficients: Vec<[f64; 2]> = (0..10)
        .map(|i| [0.1 * f64::from(i), -1.0 / (1.0 + f64::from(i))])
        .collect();
    json!({
        "kind": "polynomial", "inputs": ["theta_x_rad", "theta_y_rad", "theta_z_rad"],
        "outputs": ["tau_x_Nm", "tau_y_Nm"], "length_m": null, "degree": 2,
        "normalisation": {"lower": [-1.0, -0.5, 0], "upper": [1.0, 0.5, 0]},
        "terms": rows, "coefficients": coefficients,
        "training": {"rows": 492, "seed": 7, "note": "a \"quoted\" word\n"},
    })
}

fn energy() -> Value {
    let rows = terms(Symmetry::Alike, 4).unwrap();
    let coefficients: Vec<f64> = (0..22).map(|i| 1.0e-3 * f64::from(i) - 0.3).collect();
    let covariance: Vec<Vec<f64>> = (0..22)
        .map(|i| (0..22).map(|j| if i == j { 1e-9 } else { 0.0 }).collect())
        .collect();
    json!({
        "kind": "energy", "name": "energy4",
        "inputs": ["x_m", "y_m", "z_m", "theta_x_rad", "theta_y_rad", "theta_z_rad"],
        "outputs": ["fx_N", "fy_N", "fz_N", "tau_x_Nm", "tau_y_Nm", "tau_z_Nm"],
        "length_m": 0.1034, "degree": 4, "symmetry": "alike", "normalisation": {"scale": [0.03, 0.8]},
        "terms": rows, "coefficients": coefficients, "covariance": covariance, "effects": [{"id": "payload"}],
    })
}

#[test]
fn a_sealed_model_opens_as_it_was() {
    for document in [polynomial(), energy()] {
        let text = seal_model(&document.to_string()).unwrap();
        let opened = open_model(&text).unwrap();
        for (key, value) in document.as_object().unwrap() {
            assert_eq!(&opened[key], value, "{key}");
        }
        assert_eq!(
            (&opened["format"], &opened["version"]),
            (&json!("ecm-model"), &json!(1))
        );
        assert!(opened["noise"].is_null());
        assert_eq!(
            seal_model(&text).unwrap(),
            text,
            "sealing again changes nothing"
        );
        assert!(text.lines().count() > 20 && text.lines().all(|line| line.len() < 400));
    }
}

#[test]
fn the_sum_sees_the_content_and_not_its_spelling() {
    let text = seal_model(&polynomial().to_string()).unwrap();
    let respelled = text
        .replace("-1.0,", "-1,")
        .replace("  ", "\t")
        .replace("0.5,", "5e-1,");
    assert_ne!(respelled, text);
    assert!(open_model(&respelled).is_ok());
    let changed = text.replace("0.5,", "0.5000000000000001,");
    assert_ne!(changed, text);
    assert!(
        open_model(&changed)
            .unwrap_err()
            .to_string()
            .contains("sha256")
    );
    let map = json!({"b": [1.0, -0.0, 1e300, 1.5e-7, 18446744073709551615u64], "a": "\u{e9}\"\n"});
    assert_eq!(
        canonical(map.as_object().unwrap()),
        "{\"a\":\"\u{e9}\\\"\\u000a\",\"b\":[1,0,1e300,1.5e-7,18446744073709551615]}"
    );
}

#[test]
fn wrong_documents_are_refused_with_the_key() {
    type Change = (&'static str, fn(&mut Value), &'static str);
    let changes: [Change; 17] = [
        ("version", |d| d["version"] = json!(2), "only version"),
        ("format", |d| d["format"] = json!("model"), "ecm-model"),
        // A kind that this crate does not evaluate holds its numbers in `parameters`.
        ("parameters", |d| d["kind"] = json!("spline"), "missing"),
        ("length_m", |d| d["length_m"] = json!(0.0), "above 0"),
        (
            "length_m",
            |d| {
                d.as_object_mut().unwrap().remove("length_m");
            },
            "missing",
        ),
        (
            "symmetry",
            |d| d["symmetry"] = json!("round"),
            "alike, revolution or general",
        ),
        ("degree", |d| d["degree"] = json!(5), ""),
        ("degree", |d| d["degree"] = json!(4.5), "integer"),
        (
            "coefficients",
            |d| {
                d["coefficients"].as_array_mut().unwrap().pop();
            },
            "21 numbers",
        ),
        (
            "coefficients[3]",
            |d| d["coefficients"][3] = json!("0.1"),
            "finite",
        ),
        (
            "coefficients[3]",
            |d| d["coefficients"][3] = json!(null),
            "finite",
        ),
        (
            "terms[1]",
            |d| d["terms"][1][0] = json!(3),
            "[2, 0, 0, 0, 0, 0]",
        ),
        (
            "terms",
            |d| {
                d["terms"].as_array_mut().unwrap().pop();
            },
            "21 rows",
        ),
        (
            "normalisation.scale",
            |d| d["normalisation"]["scale"] = json!([0.03, -1.0]),
            "above 0",
        ),
        (
            "covariance[2]",
            |d| {
                d["covariance"][2].as_array_mut().unwrap().pop();
            },
            "21 numbers",
        ),
        (
            "covariance[5][4]",
            |d| d["covariance"][5][4] = json!(1.0),
            "[4][5]",
        ),
        ("inputs", |d| d["inputs"][0] = json!("y_m"), "different"),
    ];
    for (key, change, words) in changes {
        let mut document = energy();
        change(&mut document);
        let message = seal_model(&document.to_string()).unwrap_err().to_string();
        let named = if key == "degree" && words.is_empty() {
            "terms"
        } else {
            key
        };
        assert!(
            message.contains(&format!("\"{named}\"")) && message.contains(words),
            "{key}: {message}"
        );
    }
    let mut document = polynomial();
    document["normalisation"]["lower"][1] = json!(0.7);
    assert!(
        seal_model(&document.to_string())
            .unwrap_err()
            .to_string()
            .contains("normalisation.lower")
    );
}

#[test]
fn text_that_is_not_json_names_the_last_key() {
    let text = seal_model(&polynomial().to_string()).unwrap();
    for (from, to, key) in [
        ("-0.5,", "NaN,", "lower"),
        ("0.5,", "1e999,", "lower"),
        ("\"degree\": 2", "\"degree\": Infinity", "degree"),
    ] {
        let broken = text.replacen(from, to, 1);
        assert_ne!(broken, text);
        let message = open_model(&broken).unwrap_err().to_string();
        assert!(
            message.contains(&format!("near key \"{key}\"")),
            "{message}"
        );
    }
    assert!(open_model("").unwrap_err().to_string().contains("(top)"));
    assert!(
        open_model("[1, 2]")
            .unwrap_err()
            .to_string()
            .contains("object")
    );
    assert!(open_model(&text[..text.len() / 2]).is_err());
    let unsealed = polynomial().to_string();
    assert!(
        open_model(&unsealed)
            .unwrap_err()
            .to_string()
            .contains("\"format\"")
    );
}

proptest! {
    #![proptest_config(common::config(400))]

    #[test]
    fn a_changed_byte_is_seen(place in 0.0..1.0_f64, byte in 0u8..=255, energetic in any::<bool>()) {
        let text = seal_model(&if energetic { energy() } else { polynomial() }.to_string()).unwrap();
        let mut bytes = text.clone().into_bytes();
        let index = (place * bytes.len() as f64) as usize;
        bytes[index] = byte;
        if let Ok(changed) = String::from_utf8(bytes) {
            match open_model(&changed) {
                Ok(map) => {
                    let original = open_model(&text).unwrap();
                    prop_assert_eq!(canonical(&map), canonical(&original));
                }
                Err(error) => prop_assert!(!error.to_string().is_empty()),
            }
        }
    }

    #[test]
    fn any_text_is_read_without_a_crash(text in "[\\[\\]{}\":,0-9eE.\\-a-z\\\\ \n]{0,200}") {
        prop_assert!(open_model(&text).is_err());
        prop_assert!(seal_model(&text).is_err());
    }
}
