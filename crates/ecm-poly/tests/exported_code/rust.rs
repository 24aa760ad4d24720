//! Rust: tested, and linked together into one program without std.

use std::fmt::Write;
use std::path::Path;
use std::process::Command;

use ecm_poly::Symmetry;
use ecm_poly::export::model::Model;
use ecm_poly::export::{Precision, SourceFile, rust};

use crate::models::{effects, effects_of_columns, energy, polynomial};
use crate::programs::{folder, installed, run, write};

const POSE: [f64; 6] = [0.1, 0.01, 0.0, 0.1, 0.2, 0.3];

const MANIFEST: &str = "[workspace]\nresolver = \"3\"\nmembers = [\"*\"]\n\n\
    [profile.release]\npanic = \"abort\"\nlto = true\ncodegen-units = 1\n";

/// A program without std; `agree` checks one model.
const PROGRAM: &str = "#![no_std]\n#![no_main]\n\
    #[panic_handler]\nfn panic(_: &core::panic::PanicInfo<'_>) -> ! { loop {} }\n\
    #[link(name = \"c\")]\nunsafe extern \"C\" {}\n\
    macro_rules! agree { ($model:ident, $real:ty, $k:expr, $tolerance:expr) => {{\n\
        let pose: [f64; 6] = core::hint::black_box(POSE);\n\
        let (_, k) = $model::value_and_stiffness(&pose.map(|x| x as $real));\n\
        let expected: [f64; 36] = $k;\n\
        k.as_flattened().iter().zip(&expected).all(|(a, b)| {\n\
            let difference = f64::from(*a) - b;\n\
            difference < $tolerance && difference > -$tolerance\n\
        })\n\
    }}}\n\
    #[unsafe(no_mangle)]\npub extern \"C\" fn main() -> i32 {\n    i32::from(!(true";

#[test]
fn exported_rust_models_share_a_program_without_std_and_give_the_golden_vectors() {
    let models = [
        ("alike6", energy(Symmetry::Alike, 6), Precision::Double),
        ("alike4_f32", energy(Symmetry::Alike, 4), Precision::Single),
        ("cubic", polynomial(6, 6, 3), Precision::Double),
    ];
    let root = folder("rust");
    let mut dependencies = String::new();
    let mut main = PROGRAM.to_string();
    for (name, document, precision) in &models {
        let some = name.starts_with("alike").then(effects);
        let files = rust::export_with_effects(document, name, *precision, some.as_ref()).unwrap();
        write(&root.join(name), &files);
        writeln!(dependencies, "{name} = {{ path = \"../{name}\" }}").unwrap();
        let (_, k) = Model::from_document(document)
            .unwrap()
            .value_and_jacobian(&POSE)
            .unwrap();
        let largest = k.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        let (real, share) = match precision {
            Precision::Single => ("f32", 3e-4),
            Precision::Double => ("f64", 1e-11),
        };
        let tolerance = share * largest;
        write!(
            main,
            "\n        && agree!({name}, {real}, {k:?}, {tolerance:e})"
        )
        .unwrap();
    }
    for (name, document, some) in [
        ("line", polynomial(1, 1, 3), None),
        ("joint", polynomial(3, 2, 3), Some(effects_of_columns())),
    ] {
        let files = rust::export_with_effects(&document, name, Precision::Double, some.as_ref());
        write(&root.join(name), &files.unwrap());
    }
    writeln!(main, "))\n}}\nconst POSE: [f64; 6] = {POSE:?};").unwrap();
    let file = |path: &str, text: String| SourceFile {
        path: path.into(),
        text,
    };
    let package = "[package]\nname = \"firmware\"\nversion = \"0.1.0\"\nedition = \"2024\"\n";
    write(
        &root,
        &[
            file("Cargo.toml", MANIFEST.into()),
            file(
                "firmware/Cargo.toml",
                format!("{package}\n[dependencies]\n{dependencies}"),
            ),
            file("firmware/src/main.rs", main),
        ],
    );
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("rust-target");
    let cargo = |arguments: &[&str]| {
        run(Command::new(env!("CARGO"))
            .args(arguments)
            .arg("--offline")
            .current_dir(&root)
            .env("CARGO_TARGET_DIR", &target)
            .env("RUSTFLAGS", "-D warnings"))
    };
    let (code, said) = cargo(&["test", "--workspace", "--exclude", "firmware"]);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(
        said.matches("golden_vectors ... ok").count(),
        models.len() + 2,
        "{said}"
    );
    assert_eq!(said.matches("golden_history ... ok").count(), 3, "{said}");
    let (code, said) = cargo(&[
        "clippy",
        "--workspace",
        "--exclude",
        "firmware",
        "--all-targets",
    ]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = cargo(&["build", "--release", "--package", "firmware"]);
    assert_eq!(code, Some(0), "{said}");
    let program = target.join("release").join("firmware");
    assert_eq!(run(&mut Command::new(&program)).0, Some(0));
    if installed("nm", "symbols of the exported Rust") {
        let (_, symbols) = run(Command::new("nm").arg("-C").arg(&program));
        assert!(symbols.contains(" main"), "{symbols}");
        for forbidden in [
            "__rust_alloc",
            "alloc::",
            "std::",
            "panicking",
            "malloc",
            " sin",
            " cos",
            " sqrt",
        ] {
            assert!(!symbols.contains(forbidden), "links {forbidden}: {symbols}");
        }
    }
}
