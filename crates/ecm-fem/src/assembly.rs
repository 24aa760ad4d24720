//! Assembly of internal forces and tangent from the elements.
//!
//! With the gradients g_a of the shape functions in the undeformed body, the
//! pressure shapes ψ_m (linear) and cof F = J F^-T:
//!
//! r_a = ∫ (P_d + p cof F) g_a, r_m = ∫ ψ_m (J − 1 − p/κ),
//! K_ab = ∫ g_a · (A_d + p ∂cof F/∂F) · g_b, K_am = ∫ ψ_m cof F g_a, K_mn = −∫ ψ_m ψ_n / κ.
//!
//! The unknown pressure is p divided by `pressure_unit_Pa`, so that all blocks have
//! one size; unscaled, static pivoting stalls Newton at 1e-8.

use crate::body::{Body, Field, Inverted};
use crate::chamber::face_volume;
use crate::element::matrix::Element;
use crate::pattern::{ENTRIES, NONE, Pattern};
use crate::platform::Platform;
use crate::solve::State;
use crate::tensor::{Mat3, product, skew};

/// Sums of one pass over the elements; reused without allocation.
#[derive(Debug)]
pub struct Sums {
    /// Lower triangle of the tangent in the order of the pattern.
    pub tangent: Vec<f64>,
    /// Internal less dead force by displacement component, N.
    pub force: Vec<f64>,
    /// Residual of the pressure equation per node, in N (scaled).
    pub volume: Vec<f64>,
    /// ∂(force on unknowns)/∂(platform translation, rotation), row per unknown.
    pub coupling: Vec<[f64; 6]>,
    /// ∂(wrench)/∂(platform translation, rotation) without the geometric term.
    pub platform: [[f64; 6]; 6],
    /// Share of the body's dead force that acts; 1 but on the way to a load.
    pub dead_share: f64,
    /// Input of each actuator: gauge pressure of a chamber, Pa, tension of a tendon, N.
    pub inputs: Vec<f64>,
    /// Amount of each actuator (see [`Body::amounts`]).
    pub amounts: Vec<f64>,
    /// Its derivative by displacement component, actuator after actuator.
    pub amount_gradient: Vec<Vec<f64>>,
    /// Its derivative by (δr, δφ) of what is fixed to the platform beside the nodes: caps of
    /// chambers, points of tendons.
    pub rigid_gradient: Vec<[f64; 6]>,
    /// The same with the nodes that move with the platform.
    pub amount_by_platform: Vec<[f64; 6]>,
    /// Softening of condensed pressures in the tangent, 0 near a solution (see `condensed_pressure`).
    pub softening: f64,
    /// Stored energy, J.
    pub energy_J: f64,
    /// Smallest det F.
    pub smallest_jacobian: f64,
}

impl Sums {
    /// Allocates for one pass.
    pub fn new(body: &Body, pattern: &Pattern) -> Self {
        let n = body.mesh.nodes_m().len();
        let actuators = body.actuators();
        Self {
            tangent: vec![0.0; pattern.symbolic.entries()],
            force: vec![0.0; 3 * n],
            volume: vec![0.0; n],
            coupling: vec![[0.0; 6]; pattern.unknowns],
            platform: [[0.0; 6]; 6],
            dead_share: 1.0,
            inputs: vec![0.0; actuators],
            amounts: vec![0.0; actuators],
            amount_gradient: vec![vec![0.0; 3 * n]; actuators],
            rigid_gradient: vec![[0.0; 6]; actuators],
            amount_by_platform: vec![[0.0; 6]; actuators],
            softening: 0.0,
            energy_J: 0.0,
            smallest_jacobian: f64::INFINITY,
        }
    }

    /// Forces and tangent at a state whose platform nodes are on its platform.
    ///
    /// # Errors
    /// [`Inverted`] when det F ≤ 0 at a quadrature point.
    pub fn assemble(
        &mut self,
        body: &Body,
        pattern: &Pattern,
        state: &State,
    ) -> Result<(), Inverted> {
        let (field, platform) = (&state.field, &state.platform);
        let arm = |node| platform.arm(&body.mesh, node);
        let actuators = self.inputs.len();
        self.inputs.copy_from_slice(&state.inputs[..actuators]);
        self.amounts.fill(0.0);
        self.amount_gradient.iter_mut().for_each(|g| g.fill(0.0));
        self.platform = [[0.0; 6]; 6];
        self.add_caps(body, platform);
        let mut wall = body.chambers.faces.iter().peekable();
        let mut wound = body.wound.iter().peekable();
        self.tangent.fill(0.0);
        for (force, dead) in self.force.iter_mut().zip(&body.dead_force_N) {
            *force = -self.dead_share * dead;
        }
        self.volume.fill(0.0);
        self.coupling.fill([0.0; 6]);
        self.energy_J = 0.0;
        self.smallest_jacobian = f64::INFINITY;
        let mut element = Element::default();
        for (e, tet) in body.mesh.tetrahedra().iter().enumerate() {
            element.evaluate(body, e, field, self.softening)?;
            self.energy_J += element.energy;
            self.smallest_jacobian = self.smallest_jacobian.min(element.smallest_jacobian);
            while let Some(face) = wall.next_if(|face| face.element == e) {
                let nodes = face.local.map(|k| tet[k]);
                let volume = face_volume(&nodes.map(|node| body.place_m(field, node)));
                self.amounts[face.chamber] += volume.volume_m3;
                for (node, gradient) in nodes.iter().zip(volume.gradient) {
                    for k in 0..3 {
                        self.amount_gradient[face.chamber][3 * node + k] += gradient[k];
                    }
                }
                element.add_pressure(&face.local, &volume, self.inputs[face.chamber]);
            }
            while let Some(part) = wound.next_if(|part| part.element == e) {
                let threads = part.at(|k| body.place_m(field, tet[k]));
                self.energy_J += threads.energy_J;
                element.add_nodes(&part.local, &threads.force, |a, b| threads.stiffness[a][b]);
            }
            for a in 0..10 {
                for i in 0..3 {
                    self.force[3 * tet[a] + i] += element.force[i][a];
                }
            }
            for m in 0..4 {
                self.volume[tet[m]] += element.volume[m];
            }
            element.scatter(
                &pattern.scatter[e * ENTRIES..(e + 1) * ENTRIES],
                &mut self.tangent,
            );
            if pattern.touches_platform[e] {
                self.couple(pattern, &element, tet, &arm);
            }
        }
        self.add_tendons(body, pattern, field, platform);
        for (k, gradient) in self.amount_gradient.iter().enumerate() {
            let of_nodes = platform
                .wrench(&body.mesh, &pattern.platform_nodes, gradient)
                .0;
            self.amount_by_platform[k] =
                std::array::from_fn(|i| of_nodes[i] + self.rigid_gradient[k][i]);
        }
        Ok(())
    }

    /// What the chambers' caps on the platform add.
    fn add_caps(&mut self, body: &Body, platform: &Platform) {
        for chamber in 0..body.chambers.count() {
            let (gradient, tangent) = body.chambers.of_cap(chamber, platform);
            self.amounts[chamber] = body.chambers.of_caps_m3(chamber, platform);
            self.rigid_gradient[chamber] = gradient;
            for i in 0..6 {
                for j in 0..6 {
                    self.platform[i][j] -= self.inputs[chamber] * tangent[i][j];
                }
            }
        }
    }

    /// Forces and stiffness of the tendons (see [`crate::tendon`]).
    fn add_tendons(&mut self, body: &Body, pattern: &Pattern, field: &Field, platform: &Platform) {
        let first = body.chambers.count();
        self.rigid_gradient[first..].fill([0.0; 6]);
        let arm_of = |node: usize| {
            let moves = pattern.platform_nodes.binary_search(&node).is_ok();
            moves.then(|| platform.arm(&body.mesh, node))
        };
        for (segment, scatter) in body.tendons.segments.iter().zip(&pattern.scatter_segments) {
            let k = first + segment.tendon;
            let tension = self.inputs[k];
            let stretch = segment.stretch(|node| body.place_m(field, node), platform);
            let n = stretch.along;
            self.amounts[k] -= stretch.length_m;
            for &(node, weight) in &segment.nodes {
                for i in 0..3 {
                    self.amount_gradient[k][3 * node + i] -= weight * n[i];
                    self.force[3 * node + i] += tension * weight * n[i];
                }
            }
            let moment = crate::tensor::cross(stretch.arm_m, n);
            for i in 0..3 {
                self.rigid_gradient[k][i] -= segment.on_platform * n[i];
                self.rigid_gradient[k][3 + i] -= moment[i];
            }
            let pull = n.map(|v| tension * v);
            let geometric = product(&skew(pull), &skew(stretch.arm_m));
            for i in 0..3 {
                for j in 0..3 {
                    self.platform[3 + i][3 + j] += geometric[i][j];
                }
            }
            // ∂(T n)/∂(x₂ − x₁), and by (δr, δφ).
            let across: Mat3 = std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    let same = f64::from(u8::from(i == j));
                    tension / stretch.length_m * (same - n[i] * n[j])
                })
            });
            let by_platform = segment.by_platform(&stretch, arm_of);
            let turned: [[f64; 6]; 3] = std::array::from_fn(|i| {
                std::array::from_fn(|j| (0..3).map(|m| across[i][m] * by_platform[m][j]).sum())
            });
            for i in 0..6 {
                for j in 0..6 {
                    self.platform[i][j] += (0..3)
                        .map(|m| by_platform[m][i] * turned[m][j])
                        .sum::<f64>();
                }
            }
            let mut places = scatter.iter();
            for (row, &(node, weight)) in segment.nodes.iter().enumerate() {
                for i in 0..3 {
                    let unknown = pattern.of_displacement[3 * node + i];
                    if unknown != NONE {
                        let target = &mut self.coupling[unknown as usize];
                        (0..6).for_each(|j| target[j] += weight * turned[i][j]);
                    }
                    let before = segment.nodes[..row].iter();
                    let columns = before.flat_map(|(_, w)| (0..3).map(move |j| (*w, j)));
                    let own = (0..=i).map(|j| (weight, j));
                    for ((other, j), place) in columns.chain(own).zip(&mut places) {
                        if *place != NONE {
                            self.tangent[*place as usize] += weight * other * across[i][j];
                        }
                    }
                }
            }
        }
    }

    /// Columns of the element matrix that belong to platform nodes, times
    /// δx = δr + δφ × arm.
    fn couple(
        &mut self,
        pattern: &Pattern,
        element: &Element,
        tet: &[usize; 10],
        arm: &impl Fn(usize) -> [f64; 3],
    ) {
        let arms: [Option<[f64; 3]>; 10] = std::array::from_fn(|a| {
            pattern
                .platform_nodes
                .binary_search(&tet[a])
                .is_ok()
                .then(|| arm(tet[a]))
        });
        for row in 0..34 {
            let mut by_platform = [0.0; 6];
            for b in 0..10 {
                let Some(d) = arms[b] else { continue };
                let k: [f64; 3] = std::array::from_fn(|j| element.entry(row, 3 * b + j));
                for j in 0..3 {
                    by_platform[j] += k[j];
                }
                // k · (δφ × d) = δφ · (d × k)
                let turn = crate::tensor::cross(d, k);
                for j in 0..3 {
                    by_platform[3 + j] += turn[j];
                }
            }
            let unknown = if row < 30 {
                pattern.of_displacement[3 * tet[row / 3] + row % 3]
            } else {
                pattern.of_pressure[tet[row - 30]]
            };
            if unknown != NONE {
                let target = &mut self.coupling[unknown as usize];
                for j in 0..6 {
                    target[j] += by_platform[j];
                }
            }
            if row < 30
                && let Some(d) = arms[row / 3]
            {
                let i = row % 3;
                let mut axis = [0.0; 3];
                axis[i] = 1.0;
                let turn = crate::tensor::cross(d, axis);
                for j in 0..6 {
                    self.platform[i][j] += by_platform[j];
                    for k in 0..3 {
                        self.platform[3 + k][j] += turn[k] * by_platform[j];
                    }
                }
            }
        }
    }
}
