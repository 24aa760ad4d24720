//! A model as C: `NAME.h`, `NAME.c`, golden vectors in `NAME_golden.h`, and `NAME_check.c`.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use ecm_se3::Mat6;
use serde_json::{Map, Value};

use crate::energy::expansion::Expansion;
use crate::energy::invariants::Symmetry;
use crate::error::ModelError;
use crate::export::golden::Golden;
use crate::export::history::History;
use crate::export::model::{Model, Places, columns, identifier, steps_of_columns};
use crate::export::reach::{Reach, inside_words, within};
use crate::export::terms::{Terms, half_turn_squared, inverse_factorial, most_step, turns};
use crate::export::{Precision, SourceFile, filled, list};
use crate::normalise::unit_slope;
use crate::polynomial_model::PolynomialModel;
use crate::stepper::{Branch, Effects};

const WITHIN: [&str; 3] = [
    include_str!("templates/inside_reach.c"),
    include_str!("templates/inside_range.c"),
    include_str!("templates/inside_box.c"),
];

/// The files of an opened model; `name` begins every public name.
pub fn export(
    document: &Map<String, Value>,
    name: &str,
    precision: Precision,
) -> Result<Vec<SourceFile>, ModelError> {
    export_with_effects(document, name, precision, None)
}

/// The same with effects of time: `NAME_init`, `NAME_step`, `NAME_settled`, and a history of steps
/// among the golden vectors.
///
/// # Errors
/// As [`export`], and effects beside actuators, or beside a polynomial unless they have `columns`.
pub fn export_with_effects(
    document: &Map<String, Value>,
    name: &str,
    precision: Precision,
    effects: Option<&Effects<f64>>,
) -> Result<Vec<SourceFile>, ModelError> {
    let name = identifier(name)?;
    let model = Model::from_document(document)?;
    steps_of_columns(&model, effects, false)?;
    let (n, m) = model.shape();
    let reach = Reach::of_model(document, &model)?;
    let text = |key: &str| {
        document
            .get(key)
            .and_then(Value::as_str)
            .unwrap_or("")
            .to_string()
    };
    let real = precision.in_c();
    let (header, (source, numbers)) = match &model {
        Model::Polynomial(model) => (include_str!("templates/polynomial.h"), polynomial(model)?),
        Model::Energy(model) => {
            let tables = model.tables()?;
            let (symmetry, length) = (tables.symmetry(), tables.length_m());
            (
                include_str!("templates/energy.h"),
                energy(symmetry, length, &Expansion::from(tables), precision),
            )
        }
        Model::Actuated(model) => (
            include_str!("templates/energy.h"),
            energy(
                Symmetry::General,
                model.length_m(),
                &model.expansion()?,
                precision,
            ),
        ),
    };
    let (inputs, outputs) = (columns(document, "inputs")?, columns(document, "outputs")?);
    let step = most_step(&model, &inputs, &outputs);
    let own = step.as_ref().map_or(0, |_| n * m + n + 60); // of free_pose, which calls the others
    let stack = ((numbers + own) * precision.size() + 400)
        .next_multiple_of(16)
        .to_string();
    let guard = format!("ECM_EXPORT_{}_H", name.to_uppercase());
    let title = format!("{name}: {} model of an elastic mechanism", text("kind"));
    let sizes = [n.to_string(), m.to_string(), (n * m).to_string()];
    let half_turn = half_turn_squared(precision);
    let sum = text("sha256");
    let turns = turns(&inputs);
    let common = [
        ("NAME", name.as_str()),
        ("GUARD", &guard),
        ("TITLE", &title),
        ("REAL", real),
        ("STACK", &stack),
        ("SUM", &sum),
        ("INPUTS", &inputs),
        ("OUTPUTS", &outputs),
        ("N", &sizes[0]),
        ("M", &sizes[1]),
        ("NM", &sizes[2]),
        ("TURNS", &turns),
        ("HALFTURN", &half_turn),
        ("ACTUATORS", &n.saturating_sub(6).to_string()),
    ];
    let free = step.map(|step| {
        let code = include_str!("templates/free_pose.c");
        let step = list(step.iter().map(|&x| self::real(x)));
        [
            filled(
                code,
                &[("MOSTSTEP", &step), ("SETTLED", precision.settled())],
            ),
            include_str!("templates/free_pose.h").to_string(),
            include_str!("templates/free_pose_check.c").to_string(),
        ]
    });
    let called = match &free {
        Some(_) => "        wrong += free_pose_wrong(@NAME@_golden_p[i], @NAME@_golden_h[i]);\n",
        None => "",
    };
    let [free_code, free_header, free_check] = free.unwrap_or_default();
    let golden = Golden::within(&model, reach.as_ref(), precision)?;
    let mut golden = golden_header(&golden, &name, (n, m), &turns);
    let steps = match effects {
        Some(effects) => {
            let places = Places::new(&inputs, &outputs)?;
            let history = History::new((&model, &places), reach.as_ref(), effects, precision)?;
            let place = golden.rfind("#endif").unwrap_or(golden.len());
            golden.insert_str(place, &history_tables(&history, &name, (n, m)));
            Steps::new(effects, precision, numbers, &places)
        }
        None => Steps::default(),
    };
    let more = match &model {
        Model::Actuated(_) => include_str!("templates/actuated_words.txt"),
        _ => ",\n * K = dh/dp (6 x 6, row by row).",
    };
    let inside = [
        ("BEHINDPOSE", more.trim_end()),
        (
            "WITHIN",
            &*within(&model, reach.as_ref(), WITHIN, self::real),
        ),
        ("INSIDEWORDS", inside_words(&model, reach.as_ref())),
        ("FREEPOSE", &free_code),
        ("FREEPOSEAPI", &free_header),
        ("FREEPOSECHECK", &free_check),
        ("FREEPOSECALL", called),
    ];
    let with_steps = |template: &str| {
        let template = filled(template, &steps.keys());
        let template = filled(&template, &inside);
        filled(&template, &common)
    };
    let file = |suffix: &str, text: String| SourceFile {
        path: format!("{name}{suffix}"),
        text,
    };
    Ok(std::vec![
        file(".h", with_steps(header)),
        file(".c", with_steps(&source)),
        file("_golden.h", golden),
        file("_check.c", with_steps(include_str!("templates/check.c"))),
    ])
}

/// The inputs of the steps as lines of a comment.
fn input_table(effects: &Effects<f64>) -> String {
    let [temperature, age] = effects.input_words();
    format!(" *   temperature_degC  {temperature}\n *   age_s             {age}")
}

/// Texts of the effects of time; empty where there are none.
#[derive(Default)]
struct Steps {
    header: String,
    source: String,
    check: &'static str,
    call: &'static str,
}

impl Steps {
    /// In the mid frame of a pose, or of the columns at these places, which have no frame.
    fn new(effects: &Effects<f64>, precision: Precision, numbers: usize, places: &Places) -> Self {
        let (n, m) = (places.inputs.len(), places.outputs.len());
        let row = |values: &[f64]| list(values.iter().map(|&x| real(x)));
        let factorials: Vec<f64> = (0..10).map(inverse_factorial).collect();
        let branch = |of: fn(&Branch<f64>) -> f64| row(&effects.branches.map(|b| of(&b)));
        let number = |x: f64| format!("{x:e}");
        let softening = &effects.softening;
        let (frame, own, farthest, words) = match &effects.columns {
            Some(ends) => (
                include_str!("templates/frame_columns.c"),
                8 * n + 6 * m + 5 * n * m + 6,
                row(&ends.map(|end| places.of_inputs(&end)).concat()),
                ["", ""],
            ),
            None => (
                include_str!("templates/frame_pose.c"),
                400,
                row(&effects.limits.unwrap_or([1e15, 1e15])),
                [", in the mid frame", ": what @NAME@_adapt takes"],
            ),
        };
        let stack = ((numbers + own) * precision.size() + 800).next_multiple_of(16);
        let kept = (2 + effects.springs) * n + 5 * m + 1;
        let flags = |of: &[usize]| list(of.iter().map(|&place| u8::from(place > 2).to_string()));
        let matrix = |of: &Mat6<f64>| row(&places.of_matrix(of).concat());
        let ahead = stack + (kept + 16) * precision.size();
        let ranges = effects.input_ranges();
        let parts = [
            ("FRAME", frame),
            ("CONDITIONS", include_str!("templates/conditions.c")),
            ("DECAY", include_str!("templates/decay.c")),
            ("AHEAD", include_str!("templates/predict_ahead.c")),
        ];
        let header = filled(
            include_str!("templates/stepper.h"),
            &[
                ("EFFECTS", &effects.names()),
                ("STATE", &(kept * precision.size()).to_string()),
                ("STEPSTACK", &stack.to_string()),
                ("AHEADSTACK", &ahead.to_string()),
                ("INPUTTABLE", &input_table(effects)),
                ("INFRAME", words[0]),
                ("FORADAPT", words[1]),
                ("SPRINGS", &effects.springs.to_string()),
            ],
        );
        let source = filled(
            &filled(include_str!("templates/stepper.c"), &parts),
            &[
                ("STIFFNESS", &matrix(&effects.stiffness)),
                ("SHARES", &branch(|b| b.share)),
                ("TAUS", &branch(|b| b.tau_s)),
                ("LINEAR", &branch(|b| f64::from(u8::from(b.linear)))),
                ("FRICTION", &matrix(&effects.friction)),
                ("SLIP", &row(&places.of_inputs(&effects.slip))),
                ("PLAY", &row(&places.of_inputs(&effects.play))),
                ("TOGETHER", &u8::from(effects.together).to_string()),
                ("SPRINGS", &effects.springs.to_string()),
                ("OFPOSE", &u8::from(effects.of_pose).to_string()),
                ("ANGLES", &flags(&places.inputs)),
                ("MOMENTS", &flags(&places.outputs)),
                ("PAIRS", &n.min(m).to_string()),
                ("COUPLED", &u8::from(effects.columns.is_some()).to_string()),
                ("DAMPED", &u8::from(effects.damps()).to_string()),
                ("WARMER", &number(effects.softer_per_kelvin)),
                ("REFERENCE", &number(effects.reference_degc)),
                ("GROWTH", &number(effects.growth_per_kelvin)),
                ("AGEING", &number(effects.ageing_per_s)),
                ("SETTLING", &number(effects.settling_per_s)),
                ("FARTHEST", &farthest),
                ("SOFTENING", &number(softening.share)),
                ("SOFTWIDTH", &number(softening.width)),
                ("HYPERBOLIC", &u8::from(softening.hyperbolic).to_string()),
                ("LOADOFPOSE", &row(&places.of_inputs(&softening.of_pose))),
                (
                    "LOADOFWRENCH",
                    &row(&places.of_outputs(&softening.of_wrench)),
                ),
                ("BYWORK", &u8::from(softening.is_of_work()).to_string()),
                ("SETSHARE", &number(effects.set_share)),
                ("LEASTINPUTS", &row(&ranges.map(|r| r[0]))),
                ("LARGESTINPUTS", &row(&ranges.map(|r| r[1]))),
                ("DAMPING", &matrix(&effects.damping)),
                ("FACTORIALS", &row(&factorials)),
                ("EPSILON", &number(precision.epsilon())),
            ],
        );
        Self {
            header,
            source,
            check: include_str!("templates/history.c"),
            call: "    wrong += history();\n",
        }
    }

    fn keys(&self) -> [(&str, &str); 4] {
        [
            ("STEPPER", &self.source),
            ("STEPPERAPI", &self.header),
            ("HISTORY", self.check),
            ("HISTORYCALL", self.call),
        ]
    }
}

fn history_tables(history: &History, name: &str, (n, m): (usize, usize)) -> String {
    let row = |values: &[f64]| format!("{{{}}}", list(values.iter().map(|&x| cast(x, name))));
    let rows = |all: &mut dyn Iterator<Item = String>| all.collect::<Vec<_>>().join(",\n    ");
    let steps = &history.steps;
    let [h, k] = history.tolerance.map(|t| cast(t, name));
    format!(
        "/* Poses, seconds since the step before, temperature and age; what the model says of them. */\n\
         enum {{ {name}_history_count = {count} }};\n\n\
         static const {name}_real {name}_history_h_tolerance = {h};\n\
         static const {name}_real {name}_history_k_tolerance = {k};\n\
         static const {name}_real {name}_history_p[{count}][{n}] = {{{poses}}};\n\
         static const {name}_real {name}_history_dt[{count}] = {dts};\n\
         static const {name}_conditions {name}_history_inputs[{count}] = {{{inputs}}};\n\
         static const {name}_real {name}_history_h[{count}][{m}] = {{{values}}};\n\
         static const {name}_real {name}_history_k[{count}][{nm}] = {{{tangents}}};\n\n",
        count = steps.len(),
        n = n,
        m = m,
        nm = n * m,
        poses = rows(&mut steps.iter().map(|s| row(&s.pose))),
        dts = row(&steps.iter().map(|s| s.dt).collect::<Vec<_>>()),
        inputs = rows(&mut steps.iter().map(|s| row(&s.inputs))),
        values = rows(&mut steps.iter().map(|s| row(&s.wrench))),
        tangents = rows(&mut steps.iter().map(|s| row(&s.tangent))),
    )
}

/// The source, and how many floating-point numbers a call keeps.
fn energy(
    symmetry: Symmetry,
    length_m: f64,
    sums: &Expansion<f64>,
    precision: Precision,
) -> (String, usize) {
    let count = match precision {
        Precision::Single => 7,
        Precision::Double => 13,
    };
    let series = |k: u32| list((0..count).map(|j| real(inverse_factorial(2 * j + k))));
    let symmetry = match symmetry {
        Symmetry::General => include_str!("templates/symmetry_general.c"),
        _ => include_str!("templates/symmetry_revolution.c"),
    };
    let products = &sums.products;
    let of_slopes = sums.columns[usize::from(sums.ends[0])..].iter().max();
    let text = filled(
        include_str!("templates/energy.c"),
        &[
            ("MONOMIALS", &products.len().to_string()),
            ("OFSLOPES", &of_slopes.unwrap_or(&0).to_string()),
            ("SERIES", &count.to_string()),
            ("ROWS", &sums.ends.len().to_string()),
            ("ENTRIES", &sums.columns.len().to_string()),
            ("LENGTH", &format!("{length_m:e}")),
            ("PARENTS", &list(products.iter().map(|p| p.0.to_string()))),
            ("VARIABLES", &list(products.iter().map(|p| p.1.to_string()))),
            ("ENDS", &list(sums.ends.iter().map(u16::to_string))),
            ("COLUMNS", &list(sums.columns.iter().map(u16::to_string))),
            ("WEIGHTS", &list(sums.weights.iter().map(|&w| real(w)))),
            ("SERIES6", &series(6)),
            ("SERIES7", &series(7)),
            ("SYMMETRY", symmetry),
        ],
    );
    (text, products.len() + 340)
}

/// As [`energy`].
fn polynomial(model: &PolynomialModel) -> Result<(String, usize), ModelError> {
    let n = model.inputs();
    let Terms { parents, slopes } = Terms::new(model)?;
    let slope = |i: usize| unit_slope(model.lower()[i], model.upper()[i]);
    let centre = (0..n).map(|i| real(0.5 * (model.lower()[i] + model.upper()[i])));
    let coefficients = model
        .coefficients()
        .chunks_exact(model.outputs())
        .map(|row| format!("{{{}}}", list(row.iter().map(|&c| real(c)))));
    let text = filled(
        include_str!("templates/polynomial.c"),
        &[
            ("TERMS", &parents.len().to_string()),
            ("SLOPES", &slopes.len().to_string()),
            ("CENTRE", &list(centre)),
            ("SCALE", &list((0..n).map(|i| real(slope(i))))),
            ("PARENTS", &list(parents.iter().map(|p| p.0.to_string()))),
            ("VARIABLES", &list(parents.iter().map(|p| p.1.to_string()))),
            ("COEFFICIENTS", &list(coefficients)),
            ("SLOPETERMS", &list(slopes.iter().map(|s| s.0.to_string()))),
            ("SLOPEINPUTS", &list(slopes.iter().map(|s| s.1.to_string()))),
            ("SLOPELOWERS", &list(slopes.iter().map(|s| s.2.to_string()))),
            ("SLOPEFACTORS", &list(slopes.iter().map(|s| real(s.3)))),
        ],
    );
    Ok((text, parents.len() + n))
}

fn golden_header(golden: &Golden, name: &str, (n, m): (usize, usize), turns: &str) -> String {
    let table = |rows: &[Vec<f64>]| {
        let lines = rows
            .iter()
            .map(|row| format!("{{{}}}", list(row.iter().map(|&x| cast(x, name)))));
        list(lines)
    };
    let guard = format!("ECM_EXPORT_{}_GOLDEN_H", name.to_uppercase());
    let h = cast(golden.tolerance, name);
    let columns = list(golden.jacobian_tolerance.iter().map(|&t| cast(t, name)));
    format!(
        "/* What the model says at {count} poses. */\n#ifndef {guard}\n#define {guard}\n\n\
         #include \"{name}.h\"\n\nenum {{ {name}_golden_count = {count} }};\n\n\
         static const {name}_real {name}_golden_h_tolerance = {h};\n\
         static const {name}_real {name}_golden_k_tolerance[{n}] = {{{columns}}};\n\
         static const uint8_t {name}_golden_turns[{n}] = {{{turns}}};\n\
         static const {name}_real {name}_golden_p[{count}][{n}] = {{{points}}};\n\
         static const {name}_real {name}_golden_h[{count}][{m}] = {{{values}}};\n\
         static const {name}_real {name}_golden_k[{count}][{size}] = {{{jacobians}}};\n\n#endif\n",
        count = golden.points.len(),
        size = n * m,
        points = table(&golden.points),
        values = table(&golden.values),
        jacobians = table(&golden.jacobians),
    )
}

/// A constant of the floating-point type of the code.
fn real(x: f64) -> String {
    format!("R({x:e})")
}

fn cast(x: f64, name: &str) -> String {
    format!("({name}_real)({x:e})")
}
