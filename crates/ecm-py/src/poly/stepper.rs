//! Effects of time in steps.

use ecm_poly::Pose;
use ecm_poly::export::model::Model;
use ecm_poly::stepper::{Effects, Inputs, STATE_NUMBERS, State, Stepper as Steps};
use ecm_se3::{Mat6, Wrench};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::prelude::*;

use super::{error, vector};
use crate::errors::ModelError;

type Pair<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// A model file's map with effects of time (JSON), and the state of one mechanism.
#[pyclass(module = "ecm._native")]
pub struct Stepper {
    model: Model,
    effects: Effects<f64>,
    state: Option<State<f64>>,
}

impl Stepper {
    fn steps(&self) -> Steps<'_, f64, Model> {
        Steps {
            model: &self.model,
            effects: self.effects,
        }
    }
}

#[pymethods]
impl Stepper {
    #[new]
    fn new(text: &str, effects: &str) -> PyResult<Self> {
        let document = ecm_poly::open_model(text).map_err(error)?;
        Ok(Self {
            model: Model::from_document(&document).map_err(error)?,
            effects: effects_of(effects)?,
            state: None,
        })
    }

    /// Whether the pose has a finite wrench; else the state stays.
    fn init(&mut self, pose: PyReadonlyArray1<'_, f64>) -> PyResult<bool> {
        let found = pose_of(&pose)?.and_then(|pose| self.steps().init(&pose));
        self.state = found.or(self.state);
        Ok(found.is_some())
    }

    /// Wrench (6,) and tangent (6, 6); None, and the state stays, where the step is refused.
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        pose: PyReadonlyArray1<'py, f64>,
        dt: f64,
        temperature_degc: f64,
        age_s: f64,
    ) -> PyResult<Option<Pair<'py>>> {
        let Some(mut state) = self.state else {
            return Err(ModelError::new_err(
                "step before init: call init(pose) first",
            ));
        };
        let inputs = Inputs {
            temperature_degc,
            age_s,
        };
        let pose = pose_of(&pose)?;
        let found = pose.and_then(|pose| self.steps().step(&mut state, &pose, dt, &inputs));
        self.state = Some(state);
        Ok(found.map(|pair| arrays(py, &pair)))
    }

    /// Wrench (6,) and stiffness (6, 6) after a long rest; None where the pose is refused.
    fn settled<'py>(
        &self,
        py: Python<'py>,
        pose: PyReadonlyArray1<'py, f64>,
        temperature_degc: f64,
        age_s: f64,
    ) -> PyResult<Option<Pair<'py>>> {
        let inputs = Inputs {
            temperature_degc,
            age_s,
        };
        let pose = pose_of(&pose)?;
        let found = pose.and_then(|pose| self.steps().settled(&pose, &inputs));
        Ok(found.map(|pair| arrays(py, &pair)))
    }

    /// (49,) numbers of the state; None before `init`.
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.state.map(|s| PyArray1::from_vec(py, numbers_of(&s)))
    }

    #[setter]
    fn set_state(&mut self, state: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        self.state = Some(state_of(&vector(&state))?);
        Ok(())
    }
}

/// A state as plain numbers.
pub(super) fn numbers_of(s: &State<f64>) -> Vec<f64> {
    let parts = [&s.pose, &s.coordinates, &s.force, &s.stretch].into_iter();
    let parts = parts.chain(&s.memory).chain(&s.carry);
    let mut numbers: Vec<f64> = parts.flatten().copied().collect();
    numbers.push(s.largest);
    numbers
}

/// The state of such numbers.
pub(super) fn state_of(numbers: &[f64]) -> PyResult<State<f64>> {
    let (rows, rest) = numbers.as_chunks::<6>();
    let (
        [
            pose,
            coordinates,
            force,
            stretch,
            first,
            second,
            carry,
            other,
        ],
        [largest],
    ) = (rows, rest)
    else {
        return Err(ModelError::new_err(format!(
            "state has {} numbers, expected {STATE_NUMBERS}",
            numbers.len()
        )));
    };
    Ok(State {
        pose: *pose,
        coordinates: *coordinates,
        force: *force,
        stretch: *stretch,
        memory: [*first, *second],
        carry: [*carry, *other],
        largest: *largest,
    })
}

pub(super) fn effects_of(text: &str) -> PyResult<Effects<f64>> {
    let document = serde_json::from_str(text)
        .map_err(|reason| ModelError::new_err(format!("effects of time: {reason}")))?;
    Effects::from_document(&document).map_err(error)
}

/// None where the numbers are no pose.
fn pose_of(array: &PyReadonlyArray1<'_, f64>) -> PyResult<Option<Pose<f64>>> {
    let view = array.as_array();
    if view.len() != 6 {
        return Err(ModelError::new_err(format!(
            "pose has {} numbers, expected 6",
            array.len()
        )));
    }
    Ok(Pose::checked(&core::array::from_fn(|j| view[j])))
}

fn arrays<'py>(py: Python<'py>, (h, k): &(Wrench<f64>, Mat6<f64>)) -> Pair<'py> {
    let tangent = PyArray2::zeros(py, [6, 6], false);
    // Just made, contiguous and seen by nobody else.
    if let Ok(mut view) = tangent.try_readwrite() {
        for (place, value) in view.as_array_mut().iter_mut().zip(k.as_flattened()) {
            *place = *value;
        }
    }
    (PyArray1::from_slice(py, &h.to_array()), tangent)
}
