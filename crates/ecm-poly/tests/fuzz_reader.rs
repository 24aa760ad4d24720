//! The model reader under damaged and hostile files: it answers, it never panics.
//!
//! Every file of `tests/corpus`, then mutations of them for 10 s:
//! `ECM_FUZZ_SECONDS=600 cargo test --release -p ecm-poly --test fuzz_reader` for longer. What makes it
//! panic is left in `corpus-found` of the target folder: copy it to `tests/corpus`.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

use std::path::Path;
use std::time::{Duration, Instant};

use ecm_poly::export::model::Model;
use ecm_poly::export::{Precision, c, rust};
use ecm_poly::{Pose, PoseModel, open_model, seal_model};
use serde_json::{Map, Value, json};

/// xorshift: the same mutations on every machine.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % limit.max(1) as u64) as usize
    }
}

/// What a reader does with a file; returns whether it opened.
fn read(text: &str) -> bool {
    let sealed = seal_model(text);
    for candidate in [Some(text), sealed.as_deref().ok()].into_iter().flatten() {
        if let Ok(model) = PoseModel::from_json(candidate) {
            let _ = model.wrench_and_stiffness(&Pose::at_rest(0.1));
        }
        let Ok(document) = open_model(candidate) else {
            continue;
        };
        let small = document
            .get("terms")
            .and_then(Value::as_array)
            .is_none_or(|t| t.len() < 300);
        if let (true, Ok(model)) = (small, Model::from_document(&document)) {
            let (n, _) = model.shape();
            let _ = model.value_and_jacobian(&vec![0.1; n]);
            let _ = c::export(&document, "fuzz", Precision::Single);
            let _ = rust::export(&document, "fuzz", Precision::Double);
        }
    }
    sealed.is_ok()
}

const SCALARS: [&str; 16] = [
    "0",
    "-1",
    "1e308",
    "-1e-320",
    "1e400",
    "18446744073709551615",
    "null",
    "true",
    "\"\"",
    "\"energy\"",
    "[]",
    "{}",
    "[[]]",
    "\"\\u0000\"",
    "20",
    "0.1034",
];

/// One value somewhere in a document replaced, removed or repeated.
fn mutate_value(value: &mut Value, random: &mut Random) {
    let stop = random.below(3) == 0;
    match value {
        Value::Object(map) if !map.is_empty() && !stop => {
            let keys: Vec<String> = map.keys().cloned().collect();
            let key = &keys[random.below(keys.len())];
            match random.below(8) {
                0 => {
                    map.remove(key);
                }
                1 => {
                    let other = map[&keys[random.below(keys.len())]].clone();
                    map.insert(key.clone(), other);
                }
                _ => mutate_value(&mut map[key], random),
            }
        }
        Value::Array(list) if !list.is_empty() && !stop => {
            let place = random.below(list.len());
            match random.below(8) {
                0 => {
                    list.remove(place);
                }
                1 => list.push(list[place].clone()),
                2 => list.swap(0, place),
                _ => mutate_value(&mut list[place], random),
            }
        }
        other => {
            let text = SCALARS[random.below(SCALARS.len())];
            *other = serde_json::from_str(text).unwrap_or(Value::Null);
        }
    }
}

/// A few bytes of a text changed, cut out, doubled or replaced by a token.
fn mutate_text(text: &str, random: &mut Random) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=random.below(3) {
        let place = random.below(bytes.len());
        match random.below(5) {
            0 => bytes.truncate(place),
            1 => {
                let end = (place + random.below(40)).min(bytes.len());
                bytes.drain(place..end);
            }
            2 => {
                let end = (place + random.below(40)).min(bytes.len());
                let piece = bytes[place..end].to_vec();
                bytes.splice(place..place, piece);
            }
            3 if !bytes.is_empty() => bytes[place] = random.below(256) as u8,
            _ => {
                let token = SCALARS[random.below(SCALARS.len())];
                bytes.splice(place..place, token.bytes());
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn corpus() -> Vec<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    let mut paths: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.sort();
    let texts = paths.iter().map(|p| std::fs::read(p).unwrap());
    texts
        .map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
        .collect()
}

#[test]
fn the_reader_never_panics() {
    let seconds = std::env::var("ECM_FUZZ_SECONDS").ok();
    let seconds = seconds.and_then(|s| s.parse().ok()).unwrap_or(10);
    let until = Instant::now() + Duration::from_secs(seconds);
    let seeds = corpus();
    let opened = seeds.iter().filter(|text| read(text)).count();
    assert!(
        opened >= 5,
        "only {opened} seeds of the corpus can be sealed"
    );
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let (mut tried, mut accepted) = (0_u64, 0_u64);
    while Instant::now() < until {
        let seed = &seeds[random.below(seeds.len())];
        let text = match serde_json::from_str::<Value>(seed) {
            Ok(mut value) if random.below(3) > 0 => {
                for _ in 0..=random.below(3) {
                    mutate_value(&mut value, &mut random);
                }
                value.to_string()
            }
            _ => mutate_text(seed, &mut random),
        };
        tried += 1;
        match std::panic::catch_unwind(|| read(&text)) {
            Ok(ok) => accepted += u64::from(ok),
            Err(_) => {
                let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("corpus-found");
                std::fs::create_dir_all(&folder).unwrap();
                let path = folder.join(format!("{tried}.json"));
                std::fs::write(&path, &text).unwrap();
                panic!("the reader panicked; the file is {}", path.display());
            }
        }
    }
    // Neither all refused (nothing deep was reached) nor all accepted.
    assert!(
        tried > 100 && accepted > 0 && accepted < tried,
        "{accepted} of {tried}"
    );
}

#[test]
fn huge_shapes_are_refused_before_memory_is_asked_for() {
    let names: Vec<String> = (0..60).map(|i| format!("column_{i}")).collect();
    let document = json!({
        "kind": "polynomial", "inputs": names, "outputs": ["fx_N"], "length_m": null, "degree": 20,
        "normalisation": {"lower": [0.0], "upper": [1.0]}, "terms": [], "coefficients": [],
    });
    let start = Instant::now();
    assert!(seal_model(&document.to_string()).is_err());
    assert!(start.elapsed() < Duration::from_secs(2));
}

#[test]
fn a_key_that_is_there_twice_is_refused() {
    let text = r#"{"kind": "rod", "kind": "gp"}"#;
    let error = seal_model(text).unwrap_err().to_string();
    assert!(error.contains("kind") && error.contains("twice"), "{error}");
    let nested = r#"{"training": {"rows": 1, "rows": 2}}"#;
    assert!(
        seal_model(nested)
            .unwrap_err()
            .to_string()
            .contains("twice")
    );
    let once: Map<String, Value> = serde_json::from_str(r#"{"a": 1}"#).unwrap();
    assert_eq!(once.len(), 1);
}
