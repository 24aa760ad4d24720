//! Effects of time in steps.

use ecm_poly::Pose;
use ecm_poly::export::model::Model;
use ecm_poly::stepper::{Effects, Inputs, State, Stepper as Steps, state_numbers};
use ecm_se3::{Mat6, Wrench};
use numpy::{
    PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use super::error;
use crate::errors::ModelError;

type Pair<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

type Ahead<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>);

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

    /// Wrenches (n, 6) and tangents (n, 6, 6) of the first n of poses (N, 6), dt apart; the state stays.
    ///
    /// n is less than N where a step would be refused.
    fn predict_ahead<'py>(
        &self,
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
        dt: f64,
        temperature_degc: f64,
        age_s: f64,
    ) -> PyResult<Ahead<'py>> {
        let Some(state) = &self.state else {
            return Err(ModelError::new_err(
                "predict_ahead before init: call init(pose) first",
            ));
        };
        let view = poses.as_array();
        if view.ncols() != 6 {
            return Err(ModelError::new_err(format!(
                "poses have {} columns, expected 6",
                view.ncols()
            )));
        }
        let inputs = Inputs {
            temperature_degc,
            age_s,
        };
        let path = view.rows().into_iter();
        let path = path.map_while(|row| Pose::checked(&core::array::from_fn(|j| row[j])));
        let (mut wrenches, mut tangents) = (Vec::new(), Vec::new());
        for (h, k) in self.steps().predict_ahead(state, path, dt, &inputs) {
            wrenches.extend(h.to_array());
            tangents.extend_from_slice(k.as_flattened());
        }
        let count = wrenches.len() / 6;
        let wrenches = PyArray1::from_vec(py, wrenches).reshape([count, 6])?;
        let tangents = PyArray1::from_vec(py, tangents).reshape([count, 6, 6])?;
        Ok((wrenches, tangents))
    }

    /// Whether temperature and age are in the ranges for which the model was measured.
    fn inputs_inside(&self, temperature_degc: f64, age_s: f64) -> bool {
        self.effects.inputs_inside(&Inputs {
            temperature_degc,
            age_s,
        })
    }

    /// (49,) numbers of the state, and six for each further spring; None before `init`.
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let count = state_numbers(self.effects.springs);
        let numbers = self.state?.to_numbers().into_iter().take(count);
        Some(PyArray1::from_iter(py, numbers))
    }

    #[setter]
    fn set_state(&mut self, state: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        let numbers: Vec<f64> = state.as_array().iter().copied().collect();
        if let Some(wrong) = numbers.iter().position(|x| !x.is_finite()) {
            return Err(ModelError::new_err(format!(
                "state[{wrong}] is {}, expected finite numbers: take a state that was stored before, or \
                 call init(pose)",
                numbers[wrong]
            )));
        }
        let expected = state_numbers(self.effects.springs);
        let known = numbers.len() == expected;
        let state = known.then(|| State::from_numbers(&numbers)).flatten();
        self.state = Some(state.ok_or_else(|| {
            let count = numbers.len();
            ModelError::new_err(format!("state has {count} numbers, expected {expected}"))
        })?);
        Ok(())
    }
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
