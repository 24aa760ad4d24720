//! Parameters that follow readings: C and Rust agree with the crate on golden readings.

use std::path::{Path, PathBuf};
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

/// The static library of an exported crate.
fn library(folder: &Path, name: &str) -> PathBuf {
    let target = folder.join("target");
    let (code, said) = run(Command::new(env!("CARGO"))
        .args(["build", "--release", "--offline"])
        .current_dir(folder.join(format!("{name}_adapt")))
        .env("CARGO_TARGET_DIR", &target)
        .env("RUSTFLAGS", "-D warnings"));
    assert_eq!(code, Some(0), "{said}");
    target.join(format!("release/lib{name}_adapt.a"))
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
        let files = adapt::c(&document, name, precision, &settings(payload));
        write(&folder, &files.unwrap());
        let library = library(&folder, name).display().to_string();
        let sources = |check: &str| [format!("{name}.c"), check.to_string(), library.clone()];
        let check = format!("{name}_adapt_check.c");
        let right = checked(&folder, "-O2", &sources(&check));
        assert_eq!(right, Some(0), "{name} {precision:?}");
        compiles_as_cpp(&folder, &check);
        if name != "alike6" {
            continue; // readings that see each of the changes
        }
        std::fs::write(
            folder.join("changed.c"),
            CHANGED.replace("NAME", name).replace("CHECK", &check),
        )
        .unwrap();
        assert_eq!(checked(&folder, "-O0", &sources("changed.c")), Some(0));
        if installed("nm", "symbols of the exported library") {
            let (_, symbols) = run(Command::new("nm").arg("-C").arg(folder.join("check")));
            for forbidden in ["__rust_alloc", "std::", "panic", "malloc", "sqrt", " exp"] {
                assert!(!symbols.contains(forbidden), "{forbidden}: {symbols}");
            }
        }
    }
}

/// The settings that the program gives are those that are used: with each of them changed the readings end
/// elsewhere, and with a copy of the defaults where they did. Then the other functions.
const CHANGED: &str = r#"#define main golden
#include "CHECK"
#undef main

static NAME_adapt_settings some;

/* Whether the values after all readings differ from the golden ones. */
static int elsewhere(void)
{
    NAME_adapt_state state;
    int differ = 0;
    NAME_adapt_init(&state, &some);
    for (int32_t i = 0; i < READINGS; i++) {
        NAME_adapt_real h[6], k[36], branches[12];
        NAME_value_and_stiffness(reading[i], h, k);
        for (int32_t a = 0; a < 6; a++) {
            branches[a] = R(0.3) * h[a];
            branches[6 + a] = R(0.1) * h[(a + 1) % 6];
        }
        NAME_adapt(&state, &some, reading[i], reading[i] + 6, reading[i][12], h, k, branches);
    }
    for (int32_t j = 0; j < COUNT; j++) {
        differ |= differs(state.values[j], values[READINGS - 1][j], some.priors[j].sd);
    }
    return differ;
}

static int same_with(NAME_adapt_real *number, NAME_adapt_real value)
{
    int same;
    some = NAME_adapt_defaults;
    *number = value;
    same = !elsewhere();
    some = NAME_adapt_defaults;
    return same;
}

int main(void)
{
    NAME_adapt_state state;
    NAME_adapt_real none[6] = {0}, wrench[6], still[6];
    int wrong = golden();
    some = NAME_adapt_defaults;
    wrong += elsewhere();
    wrong += same_with(&some.priors[0].sd, R(0.01));
    wrong += same_with(&some.priors[0].walk, R(5));
    wrong += same_with(&some.priors[0].low, R(0.999)) && same_with(&some.priors[0].high, R(1.001));
    wrong += same_with(&some.wrench_sd[0], R(0.04));
    wrong += same_with(&some.pose_sd[1], R(9e-4));
    wrong += same_with(&some.noise_time_s, R(0.5));
    wrong += same_with(&some.model_sd[1], R(9e-3));
    wrong += same_with(&some.reach[1], R(2));
    wrong += same_with(&some.model_rim, R(1));
    wrong += same_with(&some.middle[1], R(9e-3));
    wrong += same_with(&some.per_half_range[4], R(3));
    wrong += same_with(&some.interval_s, R(0.3));
    if (COUNT == 13) {
        wrong += same_with(&some.gravity[0], R(-5));
    }
    /* With the parameters of the start the wrench is the model's; half the modulus is half of it. */
    NAME_adapt_init(&state, 0);
    NAME_value(reading[0], still);
    NAME_adapt_expected(&state, 0, reading[0], still, 0, 1, wrench);
    wrong += differs(wrench[0], still[0], still[0] > 0 ? still[0] : -still[0]);
    state.values[0] = R(0.5);
    state.held = 1;
    NAME_adapt_expected(&state, &some, reading[0], still, 0, 0, wrench);
    wrong += differs(wrench[0], R(0.5) * still[0], still[0] > 0 ? still[0] : -still[0]);
    NAME_adapt_resume(&state, 0);
    wrong += state.held != 0 || differs(state.values[0], R(0.5), R(1e-6));
    none[5] = R(4);
    NAME_adapt_expected(&state, 0, none, still, 0, 0, wrench);
    wrong += wrench[0] == wrench[0];
    return wrong > 0;
}
"#;

#[test]
fn exported_rust_follows_golden_readings() {
    let alike = energy(Symmetry::Alike, 4);
    for (name, document, precision, some) in [
        ("alike4", &alike, Precision::Double, None),
        ("alike4", &alike, Precision::Single, Some(effects())),
        // One of those that are exported without the evaluation of this crate.
        ("square", &polynomial(6, 6, 2), Precision::Double, None),
    ] {
        let folder = folder(&format!("rust-adapt-{name}-{precision:?}"));
        let files = rust::export_with_effects(document, name, precision, some.as_ref()).unwrap();
        let files = adapt::rust(files, document, name, precision, &settings(true)).unwrap();
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
