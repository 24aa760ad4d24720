//! Source of the evaluation that is copied into an exported crate, so that it has no dependencies.

use std::format;
use std::string::ToString;
use std::vec::Vec;

use crate::export::{SourceFile, filled};

/// Name and content of the files below `src` that need no std.
const FILES: &[(&str, &str)] = &[
    ("lib.rs", include_str!("../lib.rs")),
    ("arithmetic.rs", include_str!("../arithmetic.rs")),
    ("basis.rs", include_str!("../basis.rs")),
    ("cubic.rs", include_str!("../cubic.rs")),
    ("normalise.rs", include_str!("../normalise.rs")),
    ("polynomial.rs", include_str!("../polynomial.rs")),
    ("shape.rs", include_str!("../shape.rs")),
    ("energy/mod.rs", include_str!("../energy/mod.rs")),
    (
        "energy/invariants.rs",
        include_str!("../energy/invariants.rs"),
    ),
    ("energy/plan.rs", include_str!("../energy/plan.rs")),
];

/// Files of both crates, in the folder `evaluation` of the export.
pub fn crates() -> Vec<SourceFile> {
    let version = env!("CARGO_PKG_VERSION");
    let dependency = "\n[dependencies]\necm-se3 = { path = \"../ecm-se3\" }\n";
    let mut files = Vec::new();
    for (name, sources, dependencies) in [
        ("ecm-se3", ecm_se3::source::FILES, ""),
        ("ecm-poly", FILES, dependency),
    ] {
        let values = [
            ("NAME", name),
            ("VERSION", version),
            ("DEPENDENCIES", dependencies),
        ];
        files.push(SourceFile {
            path: format!("evaluation/{name}/Cargo.toml"),
            text: filled(include_str!("templates/evaluation.toml"), &values),
        });
        files.extend(sources.iter().map(|(path, text)| SourceFile {
            path: format!("evaluation/{name}/src/{path}"),
            text: text.to_string(),
        }));
    }
    files
}
