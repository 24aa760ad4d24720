//! C: compiled with every warning, run, and linked with a second model.

use std::collections::BTreeSet;
use std::process::Command;

use ecm_poly::Symmetry;
use ecm_poly::export::{Precision, c};

use crate::models::{broken, effects, effects_of_columns, energy, polynomial};
use crate::programs::{checked, compiles_as_cpp, folder, installed, run, write};

#[test]
fn exported_c_gives_the_golden_vectors() {
    if !installed("gcc", "exported_c_gives_the_golden_vectors") {
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
            let sources = ["", "_check"].map(|part| format!("{name}{part}.c"));
            let right = checked(&folder, "-O2", &sources);
            assert_eq!(right, Some(0), "{name} {precision:?}");
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
            let wrong = checked(&folder, "-O2", &sources);
            assert_eq!(wrong, Some(1), "{name} {precision:?}");
        }
    }
}

#[test]
fn exported_c_steps_through_a_golden_history() {
    if !installed("gcc", "exported_c_steps_through_a_golden_history") {
        return;
    }
    for (name, document, precision) in [
        ("alike6", energy(Symmetry::Alike, 6), Precision::Single),
        (
            "broken4",
            broken(&["anisotropy", "precurvature"]),
            Precision::Double,
        ),
        ("line3", polynomial(1, 1, 3), Precision::Single),
        ("line", polynomial(1, 1, 4), Precision::Double),
        ("joint", polynomial(3, 2, 4), Precision::Double),
        ("joint5", polynomial(2, 5, 3), Precision::Single),
        ("alike4", energy(Symmetry::Alike, 4), Precision::Double),
    ] {
        let folder = folder(&format!("c-steps-{name}"));
        let mut some = match document["kind"] == "energy" {
            true => effects(),
            false => effects_of_columns(),
        };
        if name == "broken4" {
            some.softening.of_pose = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
            (some.softening.width, some.softening.hyperbolic) = (0.1, true);
        }
        let files = c::export_with_effects(&document, name, precision, Some(&some));
        write(&folder, &files.unwrap());
        let sources = ["", "_check"].map(|part| format!("{name}{part}.c"));
        assert_eq!(checked(&folder, "-O2", &sources), Some(0), "{name}");
        compiles_as_cpp(&folder, &sources[0]);
        let (n, m) = match name {
            "alike4" => (6, 6),
            "line" => (1, 1),
            "joint" => (3, 2),
            _ => continue,
        };
        // Each constant of each effect counts, and each golden number.
        for (file, place, wrong) in [
            (".c", "share_of[2] = {", "R(1)+"),
            (".c", "tau_of[2] = {", "R(1)+"),
            (".c", &format!("friction_of[{}] = {{", n * m), "R(1)+"),
            (".c", &format!("slip_of[{n}] = {{"), "R(1)+"),
            (".c", &format!("damping_of[{}] = {{", n * m), "R(1)+"),
            (".c", "softer_per_kelvin = ", "R(1)+"),
            (".c", "growth_per_kelvin = ", "R(1)+"),
            (".c", "ageing_per_s = ", "R(1)+"),
            (".c", "settling_per_s = ", "R(1)+"),
            (".c", "softening = ", "R(1)+"),
            (".c", "softening_width = ", "R(1)+"),
            (".c", "set_share = ", "R(1)+"),
            ("_golden.h", &format!("_history_h[32][{m}] = {{{{"), "1e3+"),
            (
                "_golden.h",
                &format!("_history_k[32][{}] = {{{{", n * m),
                "1e6+",
            ),
        ] {
            let path = folder.join(format!("{name}{file}"));
            let right = std::fs::read_to_string(&path).unwrap();
            let mut changed = right.clone();
            changed.insert_str(right.find(place).unwrap() + place.len(), wrong);
            std::fs::write(&path, changed).unwrap();
            assert_eq!(checked(&folder, "-O0", &sources), Some(1), "{place}");
            std::fs::write(&path, right).unwrap();
        }
    }
}

const BOTH: &str = "#include \"neck.h\"\n#include \"spring.h\"\n#include \"neck.h\"\n\
    #include \"neck_golden.h\"\n#include \"spring_golden.h\"\n\
    #define WRONG(m, n) do { for (int i = 0; i < m##_golden_count; i++) { m##_real h[n]; \\\n\
        m##_value(m##_golden_p[i], h); for (int j = 0; j < n; j++) { \\\n\
        const m##_real e = h[j] - m##_golden_h[i][j]; \\\n\
        wrong += !(e <= m##_golden_h_tolerance && e >= -m##_golden_h_tolerance); } } } while (0)\n\
    int main(void)\n{\n    int wrong = 0;\n    WRONG(neck, 6);\n    WRONG(spring, 2);\n    \
    return wrong > 0;\n}\n";

/// Two models in one program, called from C and from C++.
#[test]
fn exported_c_models_share_a_program() {
    let test = "exported_c_models_share_a_program";
    if !installed("gcc", test) || !installed("g++", test) {
        return;
    }
    let folder = folder("c-two");
    let neck = energy(Symmetry::Alike, 6);
    write(
        &folder,
        &c::export(&neck, "neck", Precision::Double).unwrap(),
    );
    let spring = polynomial(3, 2, 3);
    write(
        &folder,
        &c::export(&spring, "spring", Precision::Single).unwrap(),
    );
    for (main, compiler, standard) in [
        ("main.c", "gcc", "-std=c99"),
        ("main.cpp", "g++", "-std=c++11"),
    ] {
        std::fs::write(folder.join(main), BOTH).unwrap();
        let objects = ["neck.c", "spring.c", main].map(|source| {
            let object = format!("{source}.o");
            let by_c = source.ends_with(".c");
            let (compiler, standard) = if by_c {
                ("gcc", "-std=c99")
            } else {
                (compiler, standard)
            };
            let (code, said) = run(Command::new(compiler)
                .args([standard, "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"])
                .args(["-c", source, "-o", &object])
                .current_dir(&folder));
            assert_eq!(code, Some(0), "{said}");
            object
        });
        let (code, said) = run(Command::new(compiler)
            .args(objects)
            .args(["-o", "both"])
            .current_dir(&folder));
        assert_eq!(code, Some(0), "{main}: {said}");
        assert_eq!(
            run(&mut Command::new(folder.join("both"))).0,
            Some(0),
            "{main}"
        );
    }
}

/// What firmware rules ask of generated code, and no macro beside the guards.
#[test]
fn exported_c_keeps_to_itself() {
    let models = [energy(Symmetry::Revolution, 4), polynomial(6, 6, 3)];
    for (document, name) in models.iter().zip(["ring", "cube"]) {
        let folder = folder(&format!("c-rules-{name}"));
        let files = c::export(document, name, Precision::Single).unwrap();
        write(&folder, &files);
        for file in &files {
            for (number, line) in file.text.lines().enumerate() {
                let bare = line.trim();
                let control = ["for (", "if (", "while ("];
                let open =
                    control.iter().any(|word| bare.starts_with(word)) || bare.starts_with("} else");
                let place = format!("{}:{}: {line}", file.path, number + 1);
                assert!(!open || bare.ends_with('{'), "no braces, {place}");
                for word in ["short ", "unsigned ", " long ", "(int i"] {
                    assert!(!bare.contains(word), "not of stdint.h, {place}");
                }
            }
        }
        let header = &files[0].text;
        for promise in [
            "extern \"C\"",
            "Reentrant:",
            "Time:",
            "Stack: at most",
            "_inside(",
        ] {
            assert!(header.contains(promise), "{promise}");
        }
        if installed("gcc", "macros of the exported header") {
            let macros = |include: &str| {
                let main = folder.join("macros.c");
                std::fs::write(&main, format!("#include {include}\n")).unwrap();
                let (_, listed) = run(Command::new("gcc").args(["-dM", "-E"]).arg(&main));
                listed.lines().map(str::to_owned).collect::<BTreeSet<_>>()
            };
            let own = &macros(&format!("\"{name}_golden.h\"")) - &macros("<stdint.h>");
            let own: Vec<_> = own.iter().map(|line| line.trim_end()).collect();
            let upper = name.to_uppercase();
            let guards = ["GOLDEN_H", "H"].map(|end| format!("#define ECM_EXPORT_{upper}_{end}"));
            assert_eq!(own, guards);
        }
    }
}
