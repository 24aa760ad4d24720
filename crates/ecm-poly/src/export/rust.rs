//! A model as a `no_std` Rust crate of constants: `Cargo.toml`, `src/lib.rs`, `tests/golden.rs`.
//!
//! The constants are tables for the evaluation of this crate, whose source the export contains as
//! private modules: no std, no allocation, no libm, no other crate, and any number of models in one
//! program.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use ecm_se3::{Real, Vec6};
use serde_json::{Map, Value};

use crate::cubic::Cubic;
use crate::energy::actuated::ActuatedModel;
use crate::energy::invariants::Symmetry;
use crate::energy::model::EnergyModel;
use crate::error::ModelError;
use crate::export::golden::Golden;
use crate::export::history::History;
use crate::export::model::{Model, Places, columns, identifier, steps_of_columns};
use crate::export::reach::{Reach, inside_words, within};
use crate::export::source;
use crate::export::terms::{Terms, half_turn_squared, most_step, turns};
use crate::export::{Precision, SourceFile, filled};
use crate::normalise::unit_slope;
use crate::polynomial_model::PolynomialModel;
use crate::stepper::{Effects, STATE_NUMBERS};

const WITHIN: [&str; 3] = [
    include_str!("templates/inside_reach.rs.txt"),
    include_str!("templates/inside_range.rs.txt"),
    include_str!("templates/inside_box.rs.txt"),
];

/// The files of an opened model; `name` is the crate's name.
pub fn export(
    document: &Map<String, Value>,
    name: &str,
    precision: Precision,
) -> Result<Vec<SourceFile>, ModelError> {
    export_with_effects(document, name, precision, None)
}

/// The same with effects of time: `init`, `step`, `settled`, and a golden history of steps.
///
/// # Errors
/// As [`export`], and effects beside actuators, or beside another polynomial than a cubic of six by six
/// unless they have `columns`.
pub fn export_with_effects(
    document: &Map<String, Value>,
    name: &str,
    precision: Precision,
    effects: Option<&Effects<f64>>,
) -> Result<Vec<SourceFile>, ModelError> {
    let name = crate_name(name)?;
    let model = Model::from_document(document)?;
    let real = precision.in_rust();
    let plain = matches!(&model, Model::Polynomial(p) if !is_cubic(p));
    steps_of_columns(&model, effects, !plain)?;
    let (n, m) = model.shape();
    let reach = Reach::of_model(document, &model)?;
    let (inputs, outputs) = (columns(document, "inputs")?, columns(document, "outputs")?);
    let sum = document.get("sha256").and_then(Value::as_str).unwrap_or("");
    let (body, numbers) = match (&model, precision) {
        (Model::Polynomial(model), Precision::Double) if plain => polynomial::<f64>(model)?,
        (Model::Polynomial(model), Precision::Single) if plain => polynomial::<f32>(model)?,
        // Where double is software, the unrolled sums lie on the stack.
        (Model::Polynomial(model), Precision::Double) => (cubic::<f64>(model)?, 620),
        (Model::Polynomial(model), Precision::Single) => (cubic::<f32>(model)?, 150),
        (Model::Energy(model), Precision::Double) => energy::<f64>(model)?,
        (Model::Energy(model), Precision::Single) => energy::<f32>(model)?,
        (Model::Actuated(model), Precision::Double) => actuated::<f64>(model)?,
        (Model::Actuated(model), Precision::Single) => actuated::<f32>(model)?,
    };
    let step = most_step(&model, &inputs, &outputs);
    let own = step.as_ref().map_or(0, |_| n * m + n + 60); // of free_pose, which calls the others
    let stack = ((numbers + own) * precision.size() + 600)
        .next_multiple_of(16)
        .to_string();
    let common = [
        ("NAME", name.as_str()),
        ("REAL", real),
        ("SUM", sum),
        ("STACK", &stack),
        ("RUST", env!("CARGO_PKG_RUST_VERSION")),
        ("INPUTS", &inputs),
        ("OUTPUTS", &outputs),
        ("N", &n.to_string()),
        ("M", &m.to_string()),
        ("NM", &(n * m).to_string()),
        ("TURNS", &turns(&inputs)),
        ("HALFTURN", &half_turn_squared(precision)),
        ("ACTUATORS", &n.saturating_sub(6).to_string()),
    ];
    let golden = Golden::within(&model, reach.as_ref(), precision)?;
    let (steps, history) = match effects {
        Some(effects) => {
            let places = Places::new(&inputs, &outputs)?;
            let history = History::new((&model, &places), reach.as_ref(), effects, precision)?;
            let numbers = (numbers, &places);
            (
                match precision {
                    Precision::Single => {
                        steps(&effects.narrowed::<f32>(), effects, precision, numbers)
                    }
                    Precision::Double => steps(effects, effects, precision, numbers),
                },
                history_test(&history),
            )
        }
        None => (String::new(), String::new()),
    };
    let within = within(&model, reach.as_ref(), WITHIN, |x| {
        number(precision.rounded(x))
    });
    let words = inside_words(&model, reach.as_ref());
    let free = step.map(|step| {
        let step = list(step.iter().map(|&x| number(precision.rounded(x))));
        let keys = [("MOSTSTEP", &*step), ("SETTLED", precision.settled())];
        filled(include_str!("templates/free_pose.rs.txt"), &keys)
    });
    let (called, used) = match &free {
        Some(_) => (
            include_str!("templates/free_pose_test.rs.txt"),
            "free_pose, ",
        ),
        None => ("", ""),
    };
    let body = filled(
        &body,
        &[
            ("FREEPOSE", free.as_deref().unwrap_or("")),
            (
                "MODULES",
                if effects.is_some() {
                    "\nmod evaluation;\n"
                } else {
                    ""
                },
            ),
            ("STEPPER", &steps),
            ("WITHIN", &within),
            ("INSIDEWORDS", words),
        ],
    );
    let golden = filled(
        &golden_test(&golden, called),
        &[("HISTORY", &*history), ("FREEPOSEUSE", used)],
    );
    let file = |path: &str, text: String| SourceFile {
        path: path.to_string(),
        text,
    };
    let mut files = std::vec![
        file(
            "Cargo.toml",
            filled(include_str!("templates/crate.toml"), &common)
        ),
        file("src/lib.rs", filled(&body, &common)),
        file("tests/golden.rs", filled(&golden, &common)),
    ];
    if !plain || effects.is_some() {
        files.extend(source::evaluation(effects.is_some(), false));
    }
    Ok(files)
}

/// The source, and how many floating-point numbers a call keeps.
fn energy<R: Real>(model: &EnergyModel) -> Result<(String, usize), ModelError> {
    let tables = model.tables::<R>()?;
    let symmetry = match tables.symmetry() {
        Symmetry::Alike => "Alike",
        Symmetry::Revolution => "Revolution",
        Symmetry::General => "General",
    };
    let memory = tables.monomials().next_power_of_two();
    let products = tables.products().iter();
    let text = filled(
        include_str!("templates/energy.rs.txt"),
        &[
            ("MEMORY", &memory.to_string()),
            ("SYMMETRY", symmetry),
            ("LENGTH", &number(tables.length_m())),
            (
                "PRODUCTS",
                &list(products.map(|p| format!("({}, {})", p.0, p.1))),
            ),
            ("ENDS", &list(tables.ends().iter().map(u16::to_string))),
            (
                "COLUMNS",
                &list(tables.columns().iter().map(u16::to_string)),
            ),
            (
                "WEIGHTS",
                &list(tables.weights().iter().map(|&w| number(w))),
            ),
        ],
    );
    Ok((text, memory + 560))
}

/// As [`energy`].
fn actuated<R: Real>(model: &ActuatedModel) -> Result<(String, usize), ModelError> {
    let sums = model.expansion::<R>()?;
    let pairs = sums.products.iter();
    let text = filled(
        include_str!("templates/actuated.rs.txt"),
        &[
            ("LENGTH", &number(R::from_f64(model.length_m()))),
            ("MONOMIALS", &sums.products.len().to_string()),
            (
                "PRODUCTS",
                &list(pairs.map(|p| format!("({}, {})", p.0, p.1))),
            ),
            ("ROWS", &sums.ends.len().to_string()),
            ("ENDS", &list(sums.ends.iter().map(u16::to_string))),
            ("ENTRIES", &sums.columns.len().to_string()),
            ("COLUMNS", &list(sums.columns.iter().map(u16::to_string))),
            ("WEIGHTS", &list(sums.weights.iter().map(|&w| number(w)))),
        ],
    );
    Ok((text, sums.products.len() + 700))
}

/// Words that Rust or its test harness keeps: no crate can have these names.
const KEPT: &str = "abstract as async await become box break const continue crate do dyn else enum \
    extern false final fn for gen if impl in let loop macro match mod move mut override priv pub \
    ref return self static std struct super test trait true try type typeof unsafe unsized use \
    virtual where while yield";

/// Checks the name of a crate.
fn crate_name(name: &str) -> Result<String, ModelError> {
    if KEPT.split_whitespace().any(|word| word == name) {
        return Err(ModelError::Setting {
            name: "name",
            found: format!("{name:?}"),
            expected: "a name that Rust does not keep for itself: take another one",
        });
    }
    identifier(name)
}

fn is_cubic(model: &PolynomialModel) -> bool {
    (model.inputs(), model.outputs(), model.degree()) == (6, 6, 3)
}

/// A polynomial of any shape, as [`energy`].
fn polynomial<R: Real>(model: &PolynomialModel) -> Result<(String, usize), ModelError> {
    let n = model.inputs();
    let Terms { parents, slopes } = Terms::new(model)?;
    let (lower, upper) = (model.lower(), model.upper());
    let narrow = |x: f64| number(R::from_f64(x));
    let each = |of: &dyn Fn(usize) -> f64| list((0..n).map(|i| narrow(of(i))));
    let rows = model.coefficients().chunks_exact(model.outputs());
    let text = filled(
        include_str!("templates/polynomial.rs.txt"),
        &[
            ("TERMS", &parents.len().to_string()),
            ("CENTRE", &each(&|i| 0.5 * (lower[i] + upper[i]))),
            ("SCALE", &each(&|i| unit_slope(lower[i], upper[i]))),
            (
                "PARENTS",
                &list(parents.iter().map(|p| format!("({}, {})", p.0, p.1))),
            ),
            (
                "COEFFICIENTS",
                &list(rows.map(|row| format!("[{}]", list(row.iter().map(|&c| narrow(c)))))),
            ),
            ("SLOPECOUNT", &slopes.len().to_string()),
            (
                "SLOPES",
                &list(slopes.iter().map(|&(term, input, low, factor)| {
                    format!("({term}, {input}, {low}, {})", narrow(factor))
                })),
            ),
        ],
    );
    Ok((text, parents.len() + n * (model.outputs() + 2) + 40))
}

fn cubic<R: Real>(model: &PolynomialModel) -> Result<String, ModelError> {
    let narrow = |values: &[f64]| -> Vec<R> { values.iter().map(|&x| R::from_f64(x)).collect() };
    let (lower, upper) = (narrow(model.lower()), narrow(model.upper()));
    let cubic = Cubic::new(&lower, &upper, &narrow(model.coefficients()))?;
    let (coefficients, centre) = cubic.tables();
    let rows = coefficients
        .iter()
        .map(|row| format!("[{}]", list(row.iter().map(|&c| number(c)))));
    Ok(filled(
        include_str!("templates/cubic.rs.txt"),
        &[
            ("COEFFICIENTS", &list(rows)),
            ("CENTRE", &list(centre.iter().map(|&c| number(c)))),
        ],
    ))
}

/// The steps of these constants, in the words of the template.
fn steps<R: Real>(
    effects: &Effects<R>,
    exact: &Effects<f64>,
    precision: Precision,
    (numbers, places): (usize, &Places),
) -> String {
    let stack = ((numbers + 530) * precision.size() + 1200).next_multiple_of(16);
    let ahead = (STATE_NUMBERS + 48) * precision.size() + 64;
    let [temperature, age] = exact.input_words();
    let inputs = |end: usize| {
        let [temperature, age] = exact.input_ranges().map(|range| number(range[end]));
        format!("Inputs {{ temperature_degc: {temperature}, age_s: {age} }}")
    };
    let range = |range: &Option<[R; 2]>| match range {
        Some(range) => format!("Some([{}])", list(range.iter().map(|&x| number(x)))),
        None => "None".to_string(),
    };
    let row = |values: &[R]| list(values.iter().map(|&x| number(x)));
    let rows = |all: &[Vec6<R>]| list(all.iter().map(|values| format!("[{}]", row(values))));
    let ends = effects
        .columns
        .as_ref()
        .map(|ends| format!("Some([{}])", rows(ends)));
    let at = |of: &[usize]| list(of.iter().map(usize::to_string));
    let branches = effects.branches.iter().map(|branch| {
        let (share, tau) = (number(branch.share), number(branch.tau_s));
        format!(
            "Branch {{ share: {share}, tau_s: {tau}, linear: {} }}",
            branch.linear
        )
    });
    let softening = format!(
        "Softening {{ share: {}, width: {}, hyperbolic: {}, of_pose: [{}], of_wrench: [{}] }}",
        number(effects.softening.share),
        number(effects.softening.width),
        effects.softening.hyperbolic,
        row(&effects.softening.of_pose),
        row(&effects.softening.of_wrench),
    );
    // Copies of columns would cost a twentieth of a step of all six.
    let of_map = match &effects.columns {
        Some(_) => include_str!("templates/at_places.rs.txt"),
        None => include_str!("templates/at_pose.rs.txt"),
    };
    filled(
        &filled(
            include_str!("templates/stepper.rs.txt"),
            &[("OFMAP", of_map)],
        ),
        &[
            ("EFFECTS", &exact.names()),
            ("STATE", &(STATE_NUMBERS * precision.size()).to_string()),
            ("LENGTH", &number(effects.length_m)),
            ("STIFFNESS", &rows(&effects.stiffness)),
            ("BRANCHES", &list(branches)),
            ("FRICTION", &rows(&effects.friction)),
            ("SLIP", &row(&effects.slip)),
            ("PLAY", &row(&effects.play)),
            ("TOGETHER", &effects.together.to_string()),
            ("SPRINGS", &effects.springs.to_string()),
            ("OFPOSE", &effects.of_pose.to_string()),
            ("WARMER", &number(effects.softer_per_kelvin)),
            ("REFERENCE", &number(effects.reference_degc)),
            ("GROWTH", &number(effects.growth_per_kelvin)),
            ("AGEING", &number(effects.ageing_per_s)),
            ("SETTLING", &number(effects.settling_per_s)),
            ("DAMPING", &rows(&effects.damping)),
            ("SOFTENING", &softening),
            ("SETSHARE", &number(effects.set_share)),
            ("TEMPERATURES", &range(&effects.temperature_range_degc)),
            ("AGES", &range(&effects.age_range_s)),
            ("LIMITS", &range(&effects.limits)),
            ("COLUMNS", ends.as_deref().unwrap_or("None")),
            ("INPUTPLACES", &at(&places.inputs)),
            ("OUTPUTPLACES", &at(&places.outputs)),
            ("LEASTINPUTS", &inputs(0)),
            ("LARGESTINPUTS", &inputs(1)),
            ("TEMPERATUREWORDS", &temperature),
            ("AGEWORDS", &age),
            ("STEPSTACK", &stack.to_string()),
            ("AHEADSTACK", &(stack + ahead).to_string()),
        ],
    )
}

fn history_test(history: &History) -> String {
    let row = |values: &[f64]| list(values.iter().map(|&x| number(x)));
    let all = history.steps.iter();
    let steps = all.clone().map(|s| {
        let [temperature, age] = s.inputs.map(number);
        let (pose, dt) = (row(&s.pose), number(s.dt));
        format!("([{pose}], {dt}, {temperature}, {age})")
    });
    filled(
        include_str!("templates/history.rs.txt"),
        &[
            ("STEPS", &history.steps.len().to_string()),
            ("STEPLIST", &list(steps)),
            (
                "STEPVALUES",
                &list(all.clone().map(|s| format!("[{}]", row(&s.wrench)))),
            ),
            (
                "STEPJACOBIANS",
                &list(all.map(|s| format!("[{}]", row(&s.tangent)))),
            ),
            ("STEPTOLERANCE_H", &number(history.tolerance[0])),
            ("STEPTOLERANCE_K", &number(history.tolerance[1])),
        ],
    )
}

fn golden_test(golden: &Golden, called: &str) -> String {
    let table = |rows: &[Vec<f64>]| {
        list(
            rows.iter()
                .map(|row| format!("[{}]", list(row.iter().map(|&x| number(x))))),
        )
    };
    filled(
        include_str!("templates/golden.rs.txt"),
        &[
            ("FREEPOSECALL", called),
            ("COUNT", &golden.points.len().to_string()),
            ("POINTS", &table(&golden.points)),
            ("VALUES", &table(&golden.values)),
            ("JACOBIANS", &table(&golden.jacobians)),
            ("TOLERANCE_H", &number(golden.tolerance)),
            (
                "TOLERANCE_K",
                &list(golden.jacobian_tolerance.iter().map(|&t| number(t))),
            ),
        ],
    )
}

fn number<R: Real>(x: R) -> String {
    format!("{:e}", x.to_f64())
}

fn list(items: impl Iterator<Item = String>) -> String {
    items.collect::<Vec<_>>().join(", ")
}
