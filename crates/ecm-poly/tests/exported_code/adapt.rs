//! Parameters that follow readings: C and Rust agree with the crate on golden readings.

use std::path::Path;
use std::process::Command;

use ecm_poly::Symmetry;
use ecm_poly::adapt::{Adapter, Noise, Parameter, Prior};
use ecm_poly::export::adapt::{self, Settings};
use ecm_poly::export::{Precision, c, rust};

use crate::models::{effects, energy, polynomial};
use crate::programs::{checked, compiles_as_cpp, folder, installed, run, write};

/// All parameters, or without those of the payload.
fn settings(payload: bool) -> Settings {
    let parameters = Parameter::ALL;
    Adapter {
        parameters,
        priors: parameters.map(|parameter| {
            let number = parameter as u8;
            let start = f64::from(u8::from(number == 0)) + if number > 10 { 0.3 } else { 0.0 };
            let sd = if (1..5).contains(&number) && !payload {
                0.0
            } else {
                0.1
            };
            let jumps = f64::from(u8::from((1..11).contains(&number)));
            let (low, high) = (start - 0.4, start + 0.4);
            Prior {
                start,
                sd,
                low,
                high,
                walk: 0.05,
                jumps,
            }
        }),
        noise: Noise {
            wrench: [0.02, 2e-3],
            pose: [1e-5, 1e-4],
            time_s: 0.05,
            model: [2e-3, 2e-4],
            reach: [0.01, 0.2],
            rim: 3.5,
            middle: [0.1, 1e-3, 0.0, 0.0, 0.02, 0.0],
            per_half_range: [0.0, 50.0, 50.0, 4.0, 2.0, 0.0],
        },
        gravity: [-9.81, 0.3, 0.0],
        interval_s: 0.1,
    }
}

#[test]
fn exported_c_follows_golden_readings() {
    if !installed("gcc", "exported_c_follows_golden_readings") {
        return;
    }
    let cases = [
        (
            "alike6",
            energy(Symmetry::Alike, 6),
            Precision::Double,
            true,
        ),
        (
            "general4",
            energy(Symmetry::General, 4),
            Precision::Single,
            true,
        ),
        ("cubic", polynomial(6, 6, 3), Precision::Double, false),
    ];
    for (name, document, precision, payload) in cases {
        let folder = folder(&format!("c-adapt-{name}"));
        write(&folder, &c::export(&document, name, precision).unwrap());
        let settings = settings(payload);
        write(
            &folder,
            &adapt::c(&document, name, precision, &settings).unwrap(),
        );
        let sources = ["", "_adapt", "_adapt_check"].map(|part| format!("{name}{part}.c"));
        let right = checked(&folder, "-O2", &sources);
        assert_eq!(right, Some(0), "{name} {precision:?}");
        if name != "alike6" {
            continue;
        }
        compiles_as_cpp(&folder, &sources[1]);
        // Each setting counts, and each golden number.
        let path = folder.join(&sources[1]);
        let right = std::fs::read_to_string(&path).unwrap();
        for (from, to) in [
            ("R(2e-2)", "R(4e-2)"),
            ("R(1e-5)", "R(9e-5)"),
            ("R(5e-2),\n", "R(5e-1),\n"),
            ("R(2e-4)}", "R(9e-4)}"),
            ("R(3.5e0),\n", "R(1e0),\n"),
            ("R(1e-1), R(1e-3)", "R(1e-1), R(9e-3)"),
            ("R(4e0), R(2e0)", "R(4e0), R(3e0)"),
            ("R(3e-1), R(0e0)}", "R(2e0), R(0e0)}"),
            (
                "x->excitation[h][0] > R(TOLD)",
                "x->excitation[h][0] > R(1e30)",
            ),
            ("R(100) / n", "R(1e30) / n"),
        ] {
            assert!(right.contains(from), "{from}");
            std::fs::write(&path, right.replacen(from, to, 1)).unwrap();
            assert_eq!(checked(&folder, "-O0", &sources), Some(1), "{from}");
        }
        std::fs::write(&path, &right).unwrap();
    }
}

#[test]
fn exported_rust_follows_golden_readings() {
    let (name, document) = ("alike4", energy(Symmetry::Alike, 4));
    for (precision, some) in [
        (Precision::Double, None),
        (Precision::Single, Some(effects())),
    ] {
        let folder = folder(&format!("rust-adapt-{precision:?}"));
        let files = rust::export_with_effects(&document, name, precision, some.as_ref()).unwrap();
        let files = adapt::rust(files, &document, name, precision, &settings(true)).unwrap();
        write(&folder, &files);
        std::fs::write(
            folder.join("Cargo.toml"),
            std::fs::read_to_string(folder.join("Cargo.toml")).unwrap() + "\n[workspace]\n",
        )
        .unwrap();
        let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("rust-adapt-target");
        let (code, said) = run(Command::new(env!("CARGO"))
            .args(["test", "--offline"])
            .current_dir(&folder)
            .env("CARGO_TARGET_DIR", &target)
            .env("RUSTFLAGS", "-D warnings"));
        assert_eq!(code, Some(0), "{said}");
        assert!(said.contains("golden_readings ... ok"), "{said}");
    }
}
