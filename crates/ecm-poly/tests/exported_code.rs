//! Exported C and Rust compile without warnings and give the model's golden vectors.
#![allow(clippy::unwrap_used, clippy::print_stderr, missing_docs)]

use std::path::{Path, PathBuf};
use std::process::Command;

use ecm_poly::basis::exponents;
use ecm_poly::energy::groups::{Group, GroupTerm, group_terms};
use ecm_poly::energy::terms::terms;
use ecm_poly::export::{Precision, SourceFile, c, rust};
use ecm_poly::model_file::map::{POSE, WRENCH};
use ecm_poly::{Symmetry, open_model, seal_model};
use serde_json::{Map, Value, json};

fn wave(n: usize) -> Vec<f64> {
    (0..n).map(|i| ((i as f64 + 1.0) * 12.9898).sin()).collect()
}

fn sealed(document: &Value) -> Map<String, Value> {
    open_model(&seal_model(&document.to_string()).unwrap()).unwrap()
}

fn energy(symmetry: Symmetry, degree: usize) -> Map<String, Value> {
    let rows = terms(symmetry, degree).unwrap();
    sealed(&json!({
        "kind": "energy", "inputs": POSE, "outputs": WRENCH, "length_m": 0.1034, "degree": degree,
        "symmetry": symmetry.name(), "normalisation": {"scale": [0.03, 0.9]},
        "coefficients": wave(rows.len()), "terms": rows,
    }))
}

/// An energy with broken symmetries.
fn broken(names: &[&str]) -> Map<String, Value> {
    let groups = Group::from_names(names, Symmetry::Alike).unwrap();
    let mut rows: Vec<Vec<u8>> = terms(Symmetry::Alike, 4)
        .unwrap()
        .iter()
        .map(|row| row.to_vec())
        .collect();
    rows.extend(group_terms(&groups, 4).iter().map(GroupTerm::row));
    sealed(&json!({
        "kind": "energy", "inputs": POSE, "outputs": WRENCH, "length_m": 0.1034, "degree": 4,
        "symmetry": "alike", "groups": names, "normalisation": {"scale": [0.03, 0.9]},
        "coefficients": wave(rows.len()), "terms": rows,
    }))
}

fn polynomial(inputs: usize, outputs: usize, degree: usize) -> Map<String, Value> {
    let table = exponents(inputs, degree).unwrap();
    let rows: Vec<&[u8]> = table.chunks(inputs).collect();
    let weights = wave(rows.len() * outputs);
    let coefficients: Vec<&[f64]> = weights.chunks(outputs).collect();
    let upper: Vec<f64> = (0..inputs).map(|i| 0.5 + 0.1 * i as f64).collect();
    sealed(&json!({
        "kind": "polynomial", "inputs": POSE[..inputs], "outputs": WRENCH[..outputs],
        "length_m": null, "degree": degree, "terms": rows, "coefficients": coefficients,
        "normalisation": {"lower": vec![-0.4; inputs], "upper": upper},
    }))
}

/// An empty folder of this test run.
fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if path.exists() {
        std::fs::remove_dir_all(&path).unwrap();
    }
    std::fs::create_dir_all(&path).unwrap();
    path
}

fn write(folder: &Path, files: &[SourceFile]) {
    for file in files {
        let path = folder.join(&file.path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, &file.text).unwrap();
    }
}

/// Runs a command and returns its exit code and everything it said.
fn run(command: &mut Command) -> (Option<i32>, String) {
    let output = command.output().unwrap();
    let said = [output.stdout, output.stderr].concat();
    (
        output.status.code(),
        String::from_utf8_lossy(&said).into_owned(),
    )
}

fn c_compiler() -> bool {
    Command::new("gcc").arg("--version").output().is_ok()
}

#[test]
fn exported_c_gives_the_golden_vectors() {
    if !c_compiler() {
        eprintln!("SKIPPED exported_c_gives_the_golden_vectors: no gcc on this machine");
        return;
    }
    let models = [
        ("alike4", energy(Symmetry::Alike, 4)),
        ("alike6", energy(Symmetry::Alike, 6)),
        ("revolution5", energy(Symmetry::Revolution, 5)),
        ("general4", energy(Symmetry::General, 4)),
        ("broken4", broken(&["anisotropy", "precurvature"])),
        ("cubic", polynomial(6, 6, 3)),
        ("joint", polynomial(3, 2, 4)),
        ("constant", polynomial(2, 1, 0)),
    ];
    for (name, document) in &models {
        for precision in [Precision::Double, Precision::Single] {
            let folder = folder(&format!("c-{name}-{precision:?}"));
            write(&folder, &c::export(document, name, precision).unwrap());
            let program = folder.join("check");
            let (code, said) = run(Command::new("gcc")
                .args([
                    "-std=c99",
                    "-O2",
                    "-Wall",
                    "-Wextra",
                    "-Wconversion",
                    "-Wpedantic",
                    "-Werror",
                ])
                .arg(folder.join(format!("{name}.c")))
                .arg(folder.join(format!("{name}_check.c")))
                .arg("-o")
                .arg(&program));
            assert_eq!(code, Some(0), "{name} {precision:?}: {said}");
            assert_eq!(
                run(&mut Command::new(&program)).0,
                Some(0),
                "{name} {precision:?}"
            );
            // A check that cannot fail would prove nothing: one changed number must be seen.
            let header = folder.join(format!("{name}_golden.h"));
            let text = std::fs::read_to_string(&header).unwrap();
            let place = text
                .find("_golden_h[")
                .and_then(|p| text[p..].find(")(").map(|q| p + q + 2))
                .unwrap();
            let mut changed = text;
            changed.insert_str(place, "1e9+");
            std::fs::write(&header, changed).unwrap();
            let (code, said) = run(Command::new("gcc")
                .args(["-std=c99", "-O2"])
                .arg(folder.join(format!("{name}.c")))
                .arg(folder.join(format!("{name}_check.c")))
                .arg("-o")
                .arg(&program));
            assert_eq!(code, Some(0), "{said}");
            assert_eq!(
                run(&mut Command::new(&program)).0,
                Some(1),
                "{name} {precision:?}"
            );
        }
    }
}

/// The exported crate, and a program without std that uses it.
fn bare_workspace(name: &str, files: &[SourceFile]) -> PathBuf {
    let root = folder(&format!("rust-{name}"));
    write(&root.join(name), files);
    let manifest = root.join(name).join("Cargo.toml");
    let text = std::fs::read_to_string(&manifest)
        .unwrap()
        .replace("\n[workspace]\n", "");
    std::fs::write(&manifest, text).unwrap();
    std::fs::write(
        root.join("Cargo.toml"),
        format!(
            "[workspace]\nresolver = \"3\"\nmembers = [\"{name}\", \"bare\"]\n\n\
             [profile.release]\npanic = \"abort\"\nlto = true\ncodegen-units = 1\n"
        ),
    )
    .unwrap();
    let main = "#![no_std]\n#![no_main]\n\
        #[panic_handler]\nfn panic(_: &core::panic::PanicInfo<'_>) -> ! { loop {} }\n\
        #[link(name = \"c\")]\nunsafe extern \"C\" {}\n\
        #[unsafe(no_mangle)]\npub extern \"C\" fn main(count: i32, _arguments: *const *const u8) -> i32 {\n\
            let p = [0.1, 0.01, 0.0, 0.1, 0.2, if count > 1 { 0.3 } else { 0.1 }];\n\
            let (h, k) = NAME::value_and_stiffness(&p);\n\
            let finite = h.iter().chain(k.as_flattened()).all(|x| *x > -1e30 && *x < 1e30);\n\
            i32::from(!finite)\n}\n";
    write(
        &root,
        &[
            SourceFile {
                path: "bare/Cargo.toml".into(),
                text: format!(
                    "[package]\nname = \"bare\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n\
                     [dependencies]\n{name} = {{ path = \"../{name}\" }}\n"
                ),
            },
            SourceFile {
                path: "bare/src/main.rs".into(),
                text: main.replace("NAME", name),
            },
        ],
    );
    root
}

#[test]
fn exported_rust_gives_the_golden_vectors_and_links_without_std() {
    let models = [
        ("alike6", energy(Symmetry::Alike, 6), Precision::Double),
        ("alike4_f32", energy(Symmetry::Alike, 4), Precision::Single),
        ("cubic", polynomial(6, 6, 3), Precision::Double),
    ];
    for (name, document, precision) in &models {
        let root = bare_workspace(name, &rust::export(document, name, *precision).unwrap());
        let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("rust-target");
        let cargo = |arguments: &[&str]| {
            run(Command::new(env!("CARGO"))
                .args(arguments)
                .arg("--offline")
                .current_dir(&root)
                .env("CARGO_TARGET_DIR", &target)
                .env("RUSTFLAGS", "-D warnings"))
        };
        let (code, said) = cargo(&["test", "--package", name]);
        assert_eq!(code, Some(0), "{name}: {said}");
        assert!(said.contains("golden_vectors ... ok"), "{said}");
        let (code, said) = cargo(&["build", "--release", "--package", "bare"]);
        assert_eq!(code, Some(0), "{name}: {said}");
        let program = target.join("release").join("bare");
        assert_eq!(run(&mut Command::new(&program)).0, Some(0), "{name}");
        if Command::new("nm").arg("--version").output().is_err() {
            eprintln!("SKIPPED symbols of {name}: no nm on this machine");
            continue;
        }
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
            assert!(
                !symbols.contains(forbidden),
                "{name} links {forbidden}: {symbols}"
            );
        }
    }
}

#[test]
fn names_and_shapes_that_cannot_be_exported_are_refused() {
    let document = polynomial(3, 2, 2);
    assert!(
        c::export(&document, "My Neck", Precision::Double)
            .unwrap_err()
            .to_string()
            .contains("lower-case")
    );
    assert!(
        rust::export(&document, "neck", Precision::Double)
            .unwrap_err()
            .to_string()
            .contains("six to six")
    );
}
