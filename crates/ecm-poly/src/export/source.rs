//! Source of the evaluation as private modules of an exported crate, so that it depends on nothing
//! and any number of exported crates fit into one program.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use crate::export::SourceFile;

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

/// The line of `lib.rs` that declares [`STEPPER`].
const DECLARED: &str = "pub mod stepper;\n";

/// The same of effects of time, for models that have some.
const STEPPER: &[(&str, &str)] = &[
    ("stepper/mod.rs", include_str!("../stepper/mod.rs")),
    ("stepper/decay.rs", include_str!("../stepper/decay.rs")),
    ("stepper/effects.rs", include_str!("../stepper/effects.rs")),
    ("stepper/frame.rs", include_str!("../stepper/frame.rs")),
    ("stepper/state.rs", include_str!("../stepper/state.rs")),
];

/// The line of `lib.rs` that declares [`ADAPT`].
const ADAPT_DECLARED: &str = "pub mod adapt;\n";

/// Parameters that follow readings; they need [`STEPPER`].
const ADAPT: &[(&str, &str)] = &[
    ("adapt/mod.rs", include_str!("../adapt/mod.rs")),
    ("adapt/block.rs", include_str!("../adapt/block.rs")),
    ("adapt/filter.rs", include_str!("../adapt/filter.rs")),
    (
        "adapt/model_error.rs",
        include_str!("../adapt/model_error.rs"),
    ),
    (
        "adapt/parameters.rs",
        include_str!("../adapt/parameters.rs"),
    ),
    ("adapt/update.rs", include_str!("../adapt/update.rs")),
];

/// The module `evaluation` of an exported crate, with `se3` and `poly` below it.
pub fn evaluation(with_stepper: bool, with_adapt: bool) -> Vec<SourceFile> {
    let mut files = std::vec![SourceFile {
        path: "src/evaluation/mod.rs".to_string(),
        text: include_str!("templates/evaluation.rs.txt").to_string(),
    }];
    let of =
        |kept: bool, all: &'static [(&'static str, &'static str)]| if kept { all } else { &[] };
    for (module, sources) in [
        ("se3", ecm_se3::source::FILES),
        ("poly", FILES),
        ("poly", of(with_stepper, STEPPER)),
        ("poly", of(with_adapt, ADAPT)),
    ] {
        for (path, text) in sources {
            let (mut path, mut text) = (*path, as_module(text, module));
            if path == "lib.rs" {
                path = "mod.rs";
                for (kept, line) in [(with_stepper, DECLARED), (with_adapt, ADAPT_DECLARED)] {
                    if !kept {
                        text = text.replace(line, "");
                    }
                }
            }
            let path = format!("src/evaluation/{module}/{path}");
            files.push(SourceFile { path, text });
        }
    }
    files
}

/// A file of a crate as a file of the module `crate::evaluation::MODULE`.
fn as_module(text: &str, module: &str) -> String {
    without_std(text)
        .replace("#![no_std]\n", "")
        .replace("crate::", &format!("crate::evaluation::{module}::"))
        .replace("ecm_se3::", "crate::evaluation::se3::")
}

/// The text without items that need std or alloc, without tests, and without code in comments.
///
/// Relies on the layout of rustfmt: an item ends on the first line of its own indentation that
/// ends with `}` or `;`.
fn without_std(text: &str) -> String {
    let mut kept = String::new();
    // Comments and attributes, until it is known whether their item is kept.
    let mut pending = String::new();
    let mut dropped = false;
    let mut example = false;
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let bare = line.trim_start();
        if bare.starts_with("///") || bare.starts_with("//!") {
            let fence = bare[3..].trim_start().starts_with("```");
            if !example && !fence {
                pending.push_str(line);
                pending.push('\n');
            }
            example ^= fence;
            continue;
        }
        if bare.starts_with("#[") {
            dropped |= is_left_out(bare);
            if !dropped {
                pending.push_str(line);
                pending.push('\n');
            }
            continue;
        }
        if dropped {
            skip_item(line, &mut lines);
            pending.clear();
            dropped = false;
            continue;
        }
        kept.push_str(&pending);
        pending.clear();
        kept.push_str(line);
        kept.push('\n');
    }
    kept
}

/// Whether an attribute restricts its item to tests or to a feature.
fn is_left_out(attribute: &str) -> bool {
    attribute.starts_with("#[cfg(")
        && ["feature = ", "(test", "(doctest"]
            .iter()
            .any(|word| attribute.contains(word))
}

/// Takes the rest of the item that begins with `first`.
fn skip_item<'a>(first: &'a str, lines: &mut impl Iterator<Item = &'a str>) {
    let depth = |line: &str| line.len() - line.trim_start().len();
    let mut line = first;
    while !(depth(line) == depth(first) && (line.ends_with('}') || line.ends_with(';'))) {
        let Some(next) = lines.next() else {
            return;
        };
        line = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_that_need_std_are_left_out_with_their_comments() {
        let text = "//! What.\n#![no_std]\n\n/// One.\n#[cfg(feature = \"std\")]\n#[inline]\n\
                    pub fn one() {\n    two();\n}\n\n/// Three.\n///\n/// ```\n/// three();\n/// ```\n\
                    #[inline]\nfn three() {}\n\n#[cfg(all(test, feature = \"std\"))]\nmod tests {\n    \
                    use super::*;\n}\n";
        assert_eq!(
            as_module(text, "poly"),
            "//! What.\n\n\n/// Three.\n///\n#[inline]\nfn three() {}\n\n"
        );
    }

    #[test]
    fn nothing_in_the_modules_names_a_feature_or_another_crate() {
        for file in evaluation(true, true) {
            for forbidden in ["feature =", "ecm_se3::", "ecm_poly::", "std::", "#[test]"] {
                assert!(!file.text.contains(forbidden), "{}: {forbidden}", file.path);
            }
        }
    }
}
