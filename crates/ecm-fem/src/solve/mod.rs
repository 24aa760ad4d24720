//! Load cases: Newton, load stepping, batches.

mod actuation;
mod batch;
mod bent_frame;
mod branch;
mod condense;
mod critical_mode;
mod initial_guess;
mod linear_start;
mod load_path;
mod newton;
mod own_weight;
mod path;
mod prescribed;
mod report;
mod settings;
mod stability;
#[cfg(test)]
mod tests;
mod warm_start;

pub use batch::{Finished, Outcome};
pub use newton::Timing;
pub use prescribed::PrescribedResult;
pub use settings::Settings;
pub use warm_start::WarmStart;

use crate::body::{Body, Field, Formulation};
use crate::material::Material;
use crate::mesh::Mesh;
use crate::pattern::{Constraint, Pattern};
use crate::platform::Platform;
use crate::result::{CaseResult, Status};
use crate::tendon::Tendons;
use crate::{FemError, tensor};
use load_path::Beside;
use newton::Workspace;
use own_weight::OwnWeight;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// The load on the platform: a wrench or a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Load {
    /// Dead wrench (fx, fy, fz, τx, τy, τz) about the platform's origin, base axes, N and N m.
    Wrench([f64; 6]),
    /// Pose (x, y, z, θx, θy, θz), m and rad.
    Pose([f64; 6]),
}

impl Load {
    fn kind(&self) -> &'static str {
        match self {
            Self::Wrench(_) => "wrench",
            Self::Pose(_) => "pose",
        }
    }

    fn values(&self) -> &[f64; 6] {
        match self {
            Self::Wrench(v) | Self::Pose(v) => v,
        }
    }
}

/// Most actuators of a body.
pub const MOST_ACTUATORS: usize = 16;

/// What is given of each actuator, zeros behind the last: gauge pressure of a chamber, Pa, tension
/// of a tendon, N, or their amounts.
pub(crate) type Actuation = [f64; MOST_ACTUATORS];

/// A load on the platform with the actuation beside it; a [`Load`] alone has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// The load on the platform.
    pub load: Load,
    actuation: Actuation,
    actuators: usize,
    /// Bit k: of actuator k the amount is given.
    amounts: u32,
}

impl From<Load> for Case {
    fn from(load: Load) -> Self {
        Self {
            load,
            actuation: [0.0; MOST_ACTUATORS],
            actuators: 0,
            amounts: 0,
        }
    }
}

impl From<&Load> for Case {
    fn from(load: &Load) -> Self {
        Self::from(*load)
    }
}

impl Case {
    /// A load with a gauge pressure in each chamber of the body, Pa, then a tension of each tendon, N.
    ///
    /// # Errors
    /// More inputs than [`MOST_ACTUATORS`].
    pub fn new(load: Load, actuation: &[f64]) -> Result<Self, FemError> {
        let mut case = Self::from(load);
        case.actuators = actuation.len();
        match case.actuation.get_mut(..actuation.len()) {
            Some(own) => own.copy_from_slice(actuation),
            None => return Err(wrong_actuation(actuation.len(), MOST_ACTUATORS)),
        }
        Ok(case)
    }

    /// With the amount given in place of the input where `given` says so: change of a chamber's
    /// volume, m³, or shortening of a tendon, m, from the undeformed body. A tendon that would have
    /// to push is slack.
    #[must_use]
    pub fn with_amounts(mut self, given: &[bool]) -> Self {
        self.amounts = (given.iter().take(self.actuators).enumerate())
            .map(|(k, given)| u32::from(*given) << k)
            .sum();
        self
    }
}

impl Case {
    /// The same actuators at a part of the way.
    fn at(&self, (load, beside): (Load, Beside)) -> Self {
        Self {
            load,
            actuation: beside.actuation,
            actuators: self.actuators,
            amounts: beside.amounts,
        }
    }
}

fn wrong_actuation(found: usize, expected: usize) -> FemError {
    FemError::Size {
        what: "actuation",
        found,
        expected,
        why: "one gauge pressure per chamber, then one tension per tendon",
    }
}

/// Cancel flag and progress counter of long work.
#[derive(Debug, Clone, Copy, Default)]
pub struct Watch<'a> {
    /// Set by the caller to end the work after the current factorisation.
    pub cancel: Option<&'a AtomicBool>,
    /// Counts load cases that are done.
    pub done: Option<&'a AtomicUsize>,
}

impl Watch<'_> {
    /// Whether the caller has cancelled.
    pub(super) fn cancelled(&self) -> bool {
        self.cancel.is_some_and(|c| c.load(Ordering::Relaxed))
    }
}

/// State of a body and its platform.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct State {
    pub field: Field,
    pub platform: Platform,
    /// Inputs of the actuators.
    pub inputs: Actuation,
}

/// A body clamped at its base with a rigid platform on top, ready to solve load cases.
#[derive(Debug)]
pub struct Fem {
    body: Body,
    pattern: Pattern,
    settings: Settings,
    force_unit_N: f64,
    /// Result without load, computed when first needed.
    at_rest: OnceLock<CaseResult>,
    own_weight: OwnWeight,
    /// Amounts of the undeformed body (see [`Body::amounts`]).
    amounts_at_rest: Vec<f64>,
    /// Inputs of the actuators of a body without platform.
    inputs: Actuation,
}

impl Fem {
    /// `modulus_scale`: factor on the moduli of each tetrahedron.
    ///
    /// # Errors
    /// A scale of the wrong length or not positive; a mesh too large to factorise; a body whose
    /// stiffness is no number that can be computed with.
    pub fn new(
        mesh: Mesh,
        material: Box<dyn Material>,
        modulus_scale: Option<Vec<f64>>,
    ) -> Result<Self, FemError> {
        Self::with_settings(mesh, material, modulus_scale, Settings::default())
    }

    /// As [`Fem::new`] with other solver settings.
    ///
    /// # Errors
    /// As [`Fem::new`]; settings out of their ranges ([`Settings::validate`]).
    pub fn with_settings(
        mesh: Mesh,
        material: Box<dyn Material>,
        modulus_scale: Option<Vec<f64>>,
        settings: Settings,
    ) -> Result<Self, FemError> {
        let mut constraints = vec![Constraint::Free; 3 * mesh.nodes_m().len()];
        for &node in mesh.base_nodes() {
            constraints[3 * node..3 * node + 3].fill(Constraint::Prescribed);
        }
        for &node in mesh.top_nodes() {
            constraints[3 * node..3 * node + 3].fill(Constraint::Platform);
        }
        Self::with_constraints(mesh, material, modulus_scale, settings, &constraints)
    }

    /// Any displacement components prescribed or on the platform.
    pub(crate) fn with_constraints(
        mesh: Mesh,
        material: Box<dyn Material>,
        modulus_scale: Option<Vec<f64>>,
        settings: Settings,
        constraints: &[Constraint],
    ) -> Result<Self, FemError> {
        settings.validate()?;
        let elements = mesh.tetrahedra().len();
        let modulus_scale = modulus_scale.unwrap_or_else(|| vec![1.0; elements]);
        if modulus_scale.len() != elements {
            return Err(FemError::Size {
                what: "element_modulus_scale",
                found: modulus_scale.len(),
                expected: elements,
                why: "one per tetrahedron",
            });
        }
        if let Some(&value) = modulus_scale.iter().find(|s| !(s.is_finite() && **s > 0.0)) {
            return Err(FemError::Parameter {
                name: "an entry of element_modulus_scale",
                value,
                expected: "a positive factor",
            });
        }
        let mixed = settings.formulation == Formulation::TaylorHood;
        let plain = settings.formulation == Formulation::Displacement;
        if plain && !material.bulk_modulus_Pa().is_finite() {
            return Err(FemError::Parameter {
                name: "the bulk modulus",
                value: material.bulk_modulus_Pa(),
                expected: "a finite number for P2, which locks without; use P2/P1 or P2/P0",
            });
        }
        let force_unit_N = material.shear_modulus_Pa() * mesh.volume_m3() / mesh.length_m();
        if !(force_unit_N.is_normal() && force_unit_N > 0.0) {
            return Err(FemError::Parameter {
                name: "shear modulus times volume over length, N,",
                value: force_unit_N,
                expected: "a positive number; check lengths in m and moduli in Pa",
            });
        }
        let tendons = Tendons::new(&mesh)?;
        let pattern = Pattern::new(&mesh, constraints, mixed, &tendons.segments)?;
        let body = Body::new(
            mesh,
            material,
            modulus_scale,
            settings.rule,
            settings.formulation,
            tendons,
        )?;
        let rest = Platform::at_rest(body.mesh.length_m());
        let amounts_at_rest = body.amounts(&body.rest(), &rest);
        if amounts_at_rest.len() > MOST_ACTUATORS {
            return Err(wrong_actuation(amounts_at_rest.len(), MOST_ACTUATORS));
        }
        Ok(Self {
            inputs: [0.0; MOST_ACTUATORS],
            amounts_at_rest,
            body,
            pattern,
            settings,
            force_unit_N,
            at_rest: OnceLock::new(),
            own_weight: OwnWeight::default(),
        })
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.body.mesh
    }

    /// Unknowns of K_ff, entries of its lower triangle, and entries of its factor.
    pub fn sizes(&self) -> (usize, usize, usize) {
        let symbolic = &self.pattern.symbolic;
        (
            self.pattern.unknowns,
            symbolic.entries(),
            symbolic.factor_entries(),
        )
    }

    /// K at rest, under the body's own weight.
    ///
    /// # Errors
    /// A body that does not carry its own weight; the cancel flag.
    pub fn rest_stiffness(&self, watch: Watch) -> Result<[[f64; 6]; 6], FemError> {
        let result = self.result_at_rest(watch);
        match result.status {
            Status::Solved => Ok(result.stiffness),
            Status::Cancelled => Err(FemError::Cancelled),
            status => Err(FemError::NoRest {
                status: status.word(),
            }),
        }
    }

    /// Equilibrium under a dead wrench, from rest.
    ///
    /// # Errors
    /// A wrench that is not finite.
    pub fn solve_wrench(&self, wrench: &[f64; 6]) -> Result<CaseResult, FemError> {
        self.solve(Load::Wrench(*wrench)).map(|r| r.0)
    }

    /// Wrench that holds a pose, from rest.
    ///
    /// # Errors
    /// A pose that is not finite.
    pub fn solve_pose(&self, pose: &[f64; 6]) -> Result<CaseResult, FemError> {
        self.solve(Load::Pose(*pose)).map(|r| r.0)
    }

    /// One load case from rest, and the time spent in its parts.
    ///
    /// # Errors
    /// A load that is not finite.
    pub fn solve(&self, load: impl Into<Case>) -> Result<(CaseResult, Timing), FemError> {
        let case = load.into();
        self.check_case(0, &case)?;
        let mut work = Workspace::new(self);
        let result = self.follow_from_rest(&mut work, &case, Watch::default()).0;
        Ok((result, work.timing))
    }

    /// Volume of each chamber of the undeformed body, m³.
    pub fn chamber_volumes_m3(&self) -> &[f64] {
        &self.amounts_at_rest[..self.body.chambers.count()]
    }

    /// Names of the actuators in the order of their inputs: the chambers, then the tendons.
    pub fn actuators(&self) -> Vec<String> {
        let (chambers, tendons) = (&self.body.chambers.names, &self.body.tendons.names);
        chambers.iter().chain(tendons).cloned().collect()
    }

    /// One load case from rest with its displacements and pressures.
    ///
    /// # Errors
    /// A load that is not finite.
    pub fn solve_field(
        &self,
        load: impl Into<Case>,
        watch: Watch,
    ) -> Result<(CaseResult, Field), FemError> {
        let case = load.into();
        self.check_case(0, &case)?;
        let mut work = Workspace::new(self);
        let (result, state) = self.follow_from_rest(&mut work, &case, watch);
        Ok((result, state.field))
    }

    /// With a body force per undeformed volume in base axes, N/m³ (density × gravity). The state
    /// without wrench then sags under its own weight; wrenches act in addition.
    ///
    /// # Errors
    /// A component that is not finite.
    pub fn with_body_force(mut self, force_N_m3: [f64; 3]) -> Result<Self, FemError> {
        if let Some(index) = force_N_m3.iter().position(|v| !v.is_finite()) {
            let (what, value) = ("body force component", force_N_m3[index]);
            return Err(FemError::NotFinite { what, index, value });
        }
        self.body.dead_force_N = self.body.volume_load(|_| force_N_m3);
        self.at_rest = OnceLock::new();
        self.own_weight = OwnWeight::default();
        Ok(self)
    }

    pub(crate) fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    /// The body: mesh, material, quadrature.
    pub fn body(&self) -> &Body {
        &self.body
    }

    pub(crate) fn rest(&self) -> State {
        State {
            field: self.body.rest(),
            platform: Platform::at_rest(self.body.mesh.length_m()),
            inputs: [0.0; MOST_ACTUATORS],
        }
    }

    fn check_case(&self, index: usize, case: &Case) -> Result<(), FemError> {
        let (found, expected) = (case.actuators, self.body.actuators());
        if found != 0 && found != expected {
            return Err(wrong_actuation(found, expected));
        }
        if let Some(&value) = case.actuation.iter().find(|a| !a.is_finite()) {
            let what = "an input of row";
            return Err(FemError::NotFinite { what, index, value });
        }
        let tensions = self.body.chambers.count()..expected;
        let pushes = |k: &usize| case.amounts >> k & 1 == 0 && case.actuation[*k] < 0.0;
        if let Some(k) = tensions.into_iter().find(pushes) {
            return Err(FemError::Parameter {
                name: "the tension of a tendon",
                value: case.actuation[k],
                expected: "0 or more: a tendon only pulls",
            });
        }
        let load = &case.load;
        if let Some(&value) = load.values().iter().find(|v| !v.is_finite()) {
            let what = match load {
                Load::Wrench(_) => "a component of wrench",
                Load::Pose(_) => "a component of pose",
            };
            return Err(FemError::NotFinite { what, index, value });
        }
        if let Load::Pose(p) = load {
            let angle = tensor::norm([p[3], p[4], p[5]]);
            if angle > std::f64::consts::PI {
                return Err(FemError::Parameter {
                    name: "the rotation of a pose",
                    value: angle,
                    expected: "|theta| at most pi",
                });
            }
        }
        Ok(())
    }
}
