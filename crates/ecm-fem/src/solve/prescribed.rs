//! Bodies under dead forces and prescribed displacements, without a rigid platform.

use super::newton::{MOST_UNSTABLE_ITERATES, Workspace};
use super::own_weight::OwnWeight;
use super::{Case, Fem, Load, Settings, Watch};
use crate::FemError;
use crate::body::Field;
use crate::material::Material;
use crate::mesh::Mesh;
use crate::pattern::{Constraint, NONE};
use crate::result::Status;
use std::sync::OnceLock;

/// Result of a body under dead forces and prescribed displacements.
#[derive(Debug, Clone, PartialEq)]
pub struct PrescribedResult {
    /// How it ended; only [`Status::Solved`] is an equilibrium at the full load.
    pub status: Status,
    /// Share of the load that was reached.
    pub share: f64,
    /// The last equilibrium.
    pub field: Field,
    /// Internal minus dead force there by displacement component, N: reactions where prescribed.
    pub reaction_N: Vec<f64>,
    /// Negative pivots beyond the number of pressures: 0 where the equilibrium is stable.
    pub inner_instabilities: usize,
    /// Newton iterations of all load steps.
    pub iterations: usize,
}

impl Fem {
    /// A body with any displacement components prescribed: one [`Constraint`] per component
    /// `3 node + i`.
    ///
    /// # Errors
    /// As [`Fem::new`]; a list of constraints of the wrong length.
    pub fn with_prescribed(
        mesh: Mesh,
        material: Box<dyn Material>,
        settings: Settings,
        constraints: &[Constraint],
    ) -> Result<Self, FemError> {
        let expected = 3 * mesh.nodes_m().len();
        if constraints.len() != expected {
            return Err(FemError::Size {
                what: "constraints",
                found: constraints.len(),
                expected,
                why: "one per displacement component",
            });
        }
        Self::with_constraints(mesh, material, None, settings, constraints)
    }

    /// With dead forces by displacement component, N (see [`crate::body::Body::volume_load`]
    /// and [`crate::body::Body::surface_load`]).
    ///
    /// # Errors
    /// A list of the wrong length, or an entry that is not finite.
    pub fn with_dead_force(mut self, force_N: Vec<f64>) -> Result<Self, FemError> {
        self.check_components("dead force", &force_N)?;
        self.body.dead_force_N = force_N;
        self.at_rest = OnceLock::new();
        self.own_weight = OwnWeight::default();
        Ok(self)
    }

    /// With a gauge pressure in each chamber, Pa, then a tension of each tendon, N.
    ///
    /// # Errors
    /// Another number of inputs than of actuators, or one that is not finite.
    pub fn with_actuation(mut self, inputs: &[f64]) -> Result<Self, FemError> {
        let case = Case::new(Load::Wrench([0.0; 6]), inputs)?;
        self.check_case(0, &case)?;
        self.inputs = case.actuation;
        Ok(self)
    }

    /// Equilibrium with the given displacements (m; used where prescribed). Dead forces,
    /// pressures and displacements grow together from zero in adaptive steps.
    ///
    /// # Errors
    /// A list of the wrong length, or an entry that is not finite.
    pub fn solve_prescribed(
        &self,
        displacement_m: &[f64],
        watch: Watch,
    ) -> Result<PrescribedResult, FemError> {
        self.check_components("prescribed displacement", displacement_m)?;
        let mut work = Workspace::new(self);
        let load = Load::Pose(self.rest().platform.pose());
        let mut state = self.rest();
        let mut last_equilibrium = state.clone();
        let (mut reached, mut step, mut iterations) = (0.0, 1.0f64, 0);
        let mut end = (vec![0.0; displacement_m.len()], 0);
        let status = loop {
            let next = f64::min(1.0, reached + step);
            work.sums.dead_share = next;
            state.inputs = self.inputs.map(|full| next * full);
            work.ready = false;
            for (component, &unknown) in self.pattern.of_displacement.iter().enumerate() {
                if unknown == NONE {
                    state.field.displacement[component] = next * displacement_m[component];
                }
            }
            let most = (self.settings.iterations, MOST_UNSTABLE_ITERATES);
            let outcome = self.newton(&mut work, &mut state, &load, most, watch);
            let failure = match outcome {
                Ok(n) if self.is_collapsed(&state) => {
                    iterations += n;
                    Status::Collapsed
                }
                Ok(n) => {
                    iterations += n;
                    reached = next;
                    step = f64::min(2.0 * step, 1.0 - reached);
                    last_equilibrium.clone_from(&state);
                    end = (work.sums.force.clone(), work.balance.inner_instabilities);
                    if reached >= 1.0 {
                        break Status::Solved;
                    }
                    continue;
                }
                Err((failure, n)) => {
                    iterations += n;
                    failure.status()
                }
            };
            step *= 0.5;
            if failure == Status::Cancelled || step < self.settings.smallest_load_step {
                break failure;
            }
            state.clone_from(&last_equilibrium);
        };
        Ok(PrescribedResult {
            status,
            share: reached,
            field: last_equilibrium.field,
            reaction_N: end.0,
            inner_instabilities: end.1,
            iterations,
        })
    }

    fn check_components(&self, what: &'static str, values: &[f64]) -> Result<(), FemError> {
        let expected = self.pattern.of_displacement.len();
        if values.len() != expected {
            return Err(FemError::Size {
                what,
                found: values.len(),
                expected,
                why: "one per displacement component",
            });
        }
        match values.iter().position(|v| !v.is_finite()) {
            None => Ok(()),
            Some(index) => Err(FemError::NotFinite {
                what,
                index,
                value: values[index],
            }),
        }
    }
}
