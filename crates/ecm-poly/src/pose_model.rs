//! Models for a controller: from a model file, then h and K of one pose without allocation.
//!
//! [`EnergyModel`], [`PosePolynomial`], [`crate::cubic::Cubic`] and [`PoseModel`], which is whichever
//! of them a file holds, have the same method `wrench_and_stiffness`. Targets without an allocator take
//! the crate of constants that `ecm export --to rust` writes.

use alloc::format;
use alloc::string::{String, ToString};

use ecm_se3::{Mat6, Pose, Wrench};
use serde_json::{Map, Value};

use crate::cubic_bulk;
use crate::energy::EnergyModel;
use crate::error::ModelError;
use crate::model_file::map::{POSE, WRENCH};
use crate::model_file::open_model;
use crate::model_file::opened::Model;
use crate::polynomial_model::PolynomialModel;

/// Inputs times (degree + 1), at the highest degree 20.
const SCRATCH: usize = 6 * 21;

/// A polynomial from the six pose columns to the six wrench columns.
#[derive(Clone, Debug)]
pub struct PosePolynomial(PolynomialModel);

impl PosePolynomial {
    /// A polynomial whose inputs are (x, y, z, θx, θy, θz) and whose outputs are the wrench.
    ///
    /// # Errors
    /// Another number of inputs or outputs than six.
    pub fn new(model: PolynomialModel) -> Result<Self, ModelError> {
        let shape = (model.inputs(), model.outputs());
        if shape == (6, 6) && model.map()?.scratch_len() <= SCRATCH {
            return Ok(Self(model));
        }
        Err(ModelError::Setting {
            name: "model",
            found: format!("a polynomial from {} to {} columns", shape.0, shape.1),
            expected: "one from the six pose columns to the six wrench columns",
        })
    }

    /// Opens a model file; see [`EnergyModel::from_json`].
    ///
    /// # Errors
    /// As [`PoseModel::from_json`], and an energy.
    pub fn from_json(text: &str) -> Result<Self, ModelError> {
        match PoseModel::from_json(text)? {
            PoseModel::Polynomial(model) => Ok(model),
            PoseModel::Energy(_) => {
                Err(kind("an energy", "polynomial; take EnergyModel::from_json"))
            }
        }
    }

    /// h (N, N m) and K = ∂h/∂p of one pose, without allocation.
    pub fn wrench_and_stiffness(&self, pose: &Pose<f64>) -> (Wrench<f64>, Mat6<f64>) {
        let point = pose.to_array();
        let (h, k) = match self.0.cubic() {
            Some(cubic) => cubic_bulk::one(cubic, &point),
            None => self.term_by_term(&point),
        };
        (Wrench::from_array(&h), k)
    }

    fn term_by_term(&self, point: &[f64; 6]) -> ([f64; 6], Mat6<f64>) {
        let (mut h, mut k, mut scratch) = ([0.0; 6], [[0.0; 6]; 6], [0.0; SCRATCH]);
        let filled = self.0.map().is_ok_and(|map| {
            let scratch = &mut scratch[..map.scratch_len()];
            map.value_and_jacobian(point, &mut h, k.as_flattened_mut(), scratch)
                .is_ok()
        });
        // `new` has checked every length.
        debug_assert!(filled);
        (h, k)
    }

    /// The polynomial, for bulk evaluation.
    pub fn model(&self) -> &PolynomialModel {
        &self.0
    }
}

/// A pose-to-wrench model of either family.
///
/// ```
/// use ecm_poly::{Pose, PoseModel};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let neck = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus/energy4.json");
/// let model = PoseModel::from_json(&std::fs::read_to_string(neck)?)?;
/// let rest = Pose::from_array(&[0.1034, 0.0, 0.0, 0.0, 0.0, 0.0])?;
/// let (h, k) = model.wrench_and_stiffness(&rest);
/// assert!(h.force[1].abs() < 1e-9 && k[0][0] > 1e4);
/// # Ok(()) }
/// ```
// Both are used in place: a box would put a pointer into the 1 kHz loop.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum PoseModel {
    /// A symmetric energy, also of kind `physics`.
    Energy(EnergyModel),
    /// A polynomial of all six columns.
    Polynomial(PosePolynomial),
}

impl PoseModel {
    /// Opens a model file that `ecm fit` wrote, with all its checks.
    ///
    /// # Errors
    /// A damaged file; one of another kind or of other columns; one with effects, which act beside
    /// the map: `ecm export` folds those of the mechanism in.
    pub fn from_json(text: &str) -> Result<Self, ModelError> {
        let document = open_model(text)?;
        refuse_effects(&document)?;
        for (key, expected) in [("inputs", POSE), ("outputs", WRENCH)] {
            let list = document.get(key).and_then(Value::as_array);
            let names = list.into_iter().flatten().map(Value::as_str);
            if !names.eq(expected.map(Some)) {
                return Err(ModelError::Key {
                    key: key.to_string(),
                    found: list.map_or(String::new(), |list| format!("{} columns", list.len())),
                    expected: expected.join(", "),
                });
            }
        }
        match Model::from_document(&document)? {
            Model::Energy(model) => Ok(Self::Energy(*model)),
            Model::Polynomial(model) => Ok(Self::Polynomial(PosePolynomial::new(*model)?)),
            Model::Actuated(_) => Err(kind("actuated", "a polynomial, energy or physics")),
        }
    }

    /// h (N, N m) and K = ∂h/∂p of one pose, without allocation.
    pub fn wrench_and_stiffness(&self, pose: &Pose<f64>) -> (Wrench<f64>, Mat6<f64>) {
        match self {
            Self::Energy(model) => model.wrench_and_stiffness(pose),
            Self::Polynomial(model) => model.wrench_and_stiffness(pose),
        }
    }
}

impl EnergyModel {
    /// Opens a model file that `ecm fit --model energyD` or `--model physics` wrote.
    ///
    /// # Errors
    /// As [`PoseModel::from_json`], and a polynomial.
    ///
    /// ```
    /// use ecm_poly::{EnergyModel, Pose};
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let neck = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus/energy4.json");
    /// let model = EnergyModel::from_json(&std::fs::read_to_string(neck)?)?;
    /// let pose = Pose::from_array(&[0.1, 0.005, 0.0, 0.0, 0.0, 0.1])?;
    /// let (h, k) = model.wrench_and_stiffness(&pose);
    /// println!("{:.1} N along x, {:.0} N/m", h.force[0], k[0][0]);
    /// # assert!(h.force[0] < 0.0);
    /// # Ok(()) }
    /// ```
    pub fn from_json(text: &str) -> Result<Self, ModelError> {
        match PoseModel::from_json(text)? {
            PoseModel::Energy(model) => Ok(model),
            PoseModel::Polynomial(_) => Err(kind(
                "a polynomial",
                "energy or physics; take PosePolynomial::from_json",
            )),
        }
    }
}

fn kind(found: &str, expected: &str) -> ModelError {
    ModelError::Key {
        key: "kind".to_string(),
        found: found.to_string(),
        expected: expected.to_string(),
    }
}

fn refuse_effects(document: &Map<String, Value>) -> Result<(), ModelError> {
    let none = match document.get("effects") {
        None | Some(Value::Null) => true,
        Some(Value::Array(list)) => list.is_empty(),
        Some(Value::Object(map)) => map.is_empty(),
        Some(_) => false,
    };
    if none {
        return Ok(());
    }
    Err(ModelError::Key {
        key: "effects".to_string(),
        found: "not empty".to_string(),
        expected: "a model without effects, which act beside its map: `ecm export --to rust` folds those of \
                   the mechanism in, `ecm refit --remove` takes them out"
            .to_string(),
    })
}
