//! A stepper whose parameters follow measured wrenches.

use ecm_poly::Pose;
use ecm_poly::adapt::{
    Adapter as Settings, CELLS, Outcome, PARTS, Parameter, Reading, State, branch_wrenches,
};
use ecm_poly::export::model::Model;
use ecm_poly::stepper::{Effects, Inputs, State as StepperState, Stepper, state_numbers};
use ecm_se3::{Mat6, Vec6};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use super::stepper::effects_of;
use super::{error, poses_of, shaped, vector};
use crate::errors::ModelError;

/// All parameters; those that are not wanted have a standard deviation of 0.
const N: usize = Parameter::ALL.len();
/// Numbers of the adapter's own state.
const NUMBERS: usize = 3 * N + 2 * N * N + 1 + N * PARTS * 6 + 2 * 32 + 1 + 24 + CELLS * 7 + 2 + 5;

type Followed<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<u8>>,
);

/// A model file's map with effects of time (JSON), and settings of an adapter (JSON).
#[pyclass(module = "ecm._native")]
pub struct Adapter {
    model: Model,
    effects: Effects<f64>,
    settings: Settings<f64, N>,
    state: State<f64, N>,
    mechanism: Option<StepperState<f64>>,
}

/// What one row did, and what was expected of it.
struct Seen {
    outcome: Outcome,
    /// Reading of the sensor that was expected, and what the robot feels.
    expected: Vec6<f64>,
    felt: Vec6<f64>,
    stiffness: Mat6<f64>,
}

impl Adapter {
    fn see(&mut self, pose: &Vec6<f64>, wrench: &Vec6<f64>, dt: f64, inputs: &Inputs<f64>) -> Seen {
        let nothing = Seen {
            outcome: Outcome::Refused,
            expected: [f64::NAN; 6],
            felt: [f64::NAN; 6],
            stiffness: [[f64::NAN; 6]; 6],
        };
        let Some(pose) = Pose::checked(pose) else {
            return nothing;
        };
        let stepper = Stepper {
            model: &self.model,
            effects: self.effects,
        };
        let Some(mut mechanism) = self.mechanism.or_else(|| stepper.init(&pose)) else {
            return nothing;
        };
        let Some((h, k)) = stepper.step(&mut mechanism, &pose, dt, inputs) else {
            return nothing;
        };
        self.mechanism = Some(mechanism);
        let branches = branch_wrenches(&mechanism, &pose, self.effects.length_m);
        let reading = Reading {
            pose,
            wrench: *wrench,
            predicted: h.to_array(),
            stiffness: k,
            branches,
        };
        let outcome = self.settings.step(&mut self.state, &reading, dt);
        let expected = |of_sensor| {
            let (state, h) = (&self.state, &reading.predicted);
            self.settings
                .expected(state, &pose, h, &branches, of_sensor)
        };
        // Parameter 0 is the modulus.
        let stiffness = k.map(|row| row.map(|x| self.state.values[0] * x));
        Seen {
            outcome,
            expected: expected(true),
            felt: expected(false),
            stiffness,
        }
    }

    fn spreads(&self) -> [f64; N] {
        core::array::from_fn(|i| self.state.covariance[i][i].max(0.0).sqrt())
    }
}

#[pymethods]
impl Adapter {
    #[new]
    fn new(text: &str, effects: &str, settings: &str) -> PyResult<Self> {
        let document = ecm_poly::open_model(text).map_err(error)?;
        let settings = settings_of(settings)?;
        Ok(Self {
            model: Model::from_document(&document).map_err(error)?,
            effects: effects_of(effects)?,
            settings,
            state: settings.init(),
            mechanism: None,
        })
    }

    /// The state of the start; the mechanism counts as rested at the pose of the next reading.
    fn reset(&mut self) {
        self.state = self.settings.init();
        self.mechanism = None;
    }

    /// Goes on after a diagnosis.
    fn resume(&mut self) {
        self.state.resume(&self.settings);
    }

    /// Outcome, wrench (6,) that the robot feels, and its stiffness (6, 6).
    #[allow(clippy::type_complexity)]
    fn observe<'py>(
        &mut self,
        py: Python<'py>,
        pose: PyReadonlyArray1<'py, f64>,
        wrench: PyReadonlyArray1<'py, f64>,
        dt: f64,
        temperature_degc: f64,
        age_s: f64,
    ) -> PyResult<(u8, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        let (pose, wrench) = (six("pose", &pose)?, six("wrench", &wrench)?);
        let inputs = Inputs {
            temperature_degc,
            age_s,
        };
        let seen = self.see(&pose, &wrench, dt, &inputs);
        let stiffness = shaped(py, seen.stiffness.as_flattened().to_vec(), 6, 6)?;
        Ok((
            seen.outcome as u8,
            PyArray1::from_slice(py, &seen.felt),
            stiffness,
        ))
    }

    /// Many rows at the default inputs: readings that were expected (rows, 6), parameters and standard
    /// deviations after each `every`-th row (M, 13), outcomes (rows,).
    fn follow<'py>(
        &mut self,
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
        wrenches: PyReadonlyArray2<'py, f64>,
        dts: PyReadonlyArray1<'py, f64>,
        every: usize,
    ) -> PyResult<Followed<'py>> {
        let (poses, wrenches, dts) = (poses_of(&poses)?, poses_of(&wrenches)?, vector(&dts));
        if poses.len() != wrenches.len() || poses.len() != dts.len() || every == 0 {
            return Err(ModelError::new_err(format!(
                "{} poses, {} wrenches, {} times, every {every}: expected as many of each, every > 0",
                poses.len(),
                wrenches.len(),
                dts.len()
            )));
        }
        let inputs = self.effects.default_inputs();
        let (expected, values, spreads, outcomes) = py.detach(|| {
            let (mut values, mut spreads) = (Vec::new(), Vec::new());
            let (mut expected, mut outcomes) = (Vec::new(), Vec::new());
            for (i, ((pose, wrench), dt)) in poses.iter().zip(wrenches.iter()).zip(&dts).enumerate()
            {
                let seen = self.see(pose, wrench, *dt, &inputs);
                expected.extend(seen.expected);
                outcomes.push(seen.outcome as u8);
                if (i + 1) % every == 0 {
                    values.extend(self.state.values);
                    spreads.extend(self.spreads());
                }
            }
            (expected, values, spreads, outcomes)
        });
        let (rows, kept) = (outcomes.len(), values.len() / N);
        Ok((
            shaped(py, expected, rows, 6)?,
            shaped(py, values, kept, N)?,
            shaped(py, spreads, kept, N)?,
            PyArray1::from_vec(py, outcomes),
        ))
    }

    /// (13,) parameters, in the order of `Parameter`.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.state.values)
    }

    /// (13, 13).
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        shaped(py, self.state.covariance.as_flattened().to_vec(), N, N)
    }

    /// (13,) whether a parameter is held for want of excitation.
    #[getter]
    fn held<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        let held: [bool; N] = core::array::from_fn(|i| self.settings.is_held(&self.state, i));
        PyArray1::from_slice(py, &held)
    }

    /// Numbers of the estimate and of the mechanism (none before the first reading).
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let s = &self.state;
        let mut numbers: Vec<f64> = s.values.to_vec();
        numbers.extend(s.covariance.as_flattened());
        for b in &s.block {
            let rows = [&b.pose, &b.wrench, &b.predicted].into_iter();
            numbers.extend(rows.chain(&b.branches).flatten());
            numbers.extend([b.read_s, b.readings]);
        }
        numbers.push(s.time_s);
        numbers.extend(s.last);
        numbers.extend(s.at_last.as_flattened());
        numbers.extend(s.model.cross.as_flattened().as_flattened());
        numbers.extend(s.model.centres.as_flattened());
        numbers.extend(s.model.visits.map(f64::from));
        numbers.extend(s.excitation.as_flattened());
        numbers.extend(s.information.as_flattened());
        numbers.push(s.of_noise);
        numbers.extend(s.window);
        numbers.extend(s.counts.map(f64::from));
        numbers.push(f64::from(s.held));
        if let Some(mechanism) = &self.mechanism {
            let count = state_numbers(self.effects.springs);
            numbers.extend(mechanism.to_numbers().into_iter().take(count));
        }
        PyArray1::from_vec(py, numbers)
    }

    #[setter]
    fn set_state(&mut self, state: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        let numbers = vector(&state);
        let own = state_numbers(self.effects.springs);
        let mechanism = match numbers.get(NUMBERS..) {
            Some([]) => Some(None),
            Some(rest) if rest.len() == own => StepperState::from_numbers(rest).map(Some),
            _ => None,
        };
        let (Some(mechanism), true) = (mechanism, numbers.iter().all(|x| x.is_finite())) else {
            return Err(ModelError::new_err(format!(
                "state has {} numbers, expected {NUMBERS} or {} that are finite: take one that was stored",
                numbers.len(),
                NUMBERS + own
            )));
        };
        let mut own = self.settings.init();
        let mut next = numbers.iter().copied();
        let mut take = || next.next().unwrap_or(f64::NAN);
        own.values = core::array::from_fn(|_| take());
        own.covariance = core::array::from_fn(|_| core::array::from_fn(|_| take()));
        for b in &mut own.block {
            let rows = [&mut b.pose, &mut b.wrench, &mut b.predicted].into_iter();
            for row in rows.chain(&mut b.branches) {
                *row = core::array::from_fn(|_| take());
            }
            for place in [&mut b.read_s, &mut b.readings] {
                *place = take();
            }
        }
        own.time_s = take();
        own.last = core::array::from_fn(|_| take());
        own.at_last = core::array::from_fn(|_| core::array::from_fn(|_| take()));
        let model = &mut own.model;
        let cross = model.cross.as_flattened_mut().as_flattened_mut();
        for place in cross.iter_mut().chain(model.centres.as_flattened_mut()) {
            *place = take();
        }
        model.visits = core::array::from_fn(|_| take() as u32);
        for place in own.excitation.as_flattened_mut() {
            *place = take();
        }
        own.information = core::array::from_fn(|_| core::array::from_fn(|_| take()));
        own.of_noise = take();
        own.window = core::array::from_fn(|_| take());
        own.counts = core::array::from_fn(|_| take() as u32);
        own.held = take() as u32;
        self.state = own;
        self.mechanism = mechanism;
        Ok(())
    }
}

pub(super) fn settings_of(text: &str) -> PyResult<Settings<f64, N>> {
    let document = serde_json::from_str(text)
        .map_err(|reason| ModelError::new_err(format!("settings of an adapter: {reason}")))?;
    Settings::from_document(&document).map_err(error)
}

fn six(name: &str, array: &PyReadonlyArray1<'_, f64>) -> PyResult<Vec6<f64>> {
    <Vec6<f64>>::try_from(vector(array))
        .map_err(|_| ModelError::new_err(format!("{name} has {} numbers, expected 6", array.len())))
}
