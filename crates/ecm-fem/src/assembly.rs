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
use crate::solve::Beside;

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
    /// Gauge pressure in each chamber, Pa.
    pub actuation: Vec<f64>,
    /// Volume of each chamber, m³.
    pub chamber_m3: Vec<f64>,
    /// Its derivative by displacement component, m², chamber after chamber.
    pub chamber_gradient: Vec<Vec<f64>>,
    /// Its derivative by (δr, δφ) of the caps on the platform.
    pub cap_gradient: Vec<[f64; 6]>,
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
        let chambers = body.chambers.count();
        Self {
            tangent: vec![0.0; pattern.symbolic.entries()],
            force: vec![0.0; 3 * n],
            volume: vec![0.0; n],
            coupling: vec![[0.0; 6]; pattern.unknowns],
            platform: [[0.0; 6]; 6],
            dead_share: 1.0,
            actuation: vec![0.0; chambers],
            chamber_m3: vec![0.0; chambers],
            chamber_gradient: vec![vec![0.0; 3 * n]; chambers],
            cap_gradient: vec![[0.0; 6]; chambers],
            softening: 0.0,
            energy_J: 0.0,
            smallest_jacobian: f64::INFINITY,
        }
    }

    /// Forces and tangent at `field`, whose platform nodes are on `platform`.
    ///
    /// # Errors
    /// [`Inverted`] when det F ≤ 0 at a quadrature point.
    pub fn assemble(
        &mut self,
        body: &Body,
        pattern: &Pattern,
        field: &Field,
        platform: &Platform,
    ) -> Result<(), Inverted> {
        let arm = |node| platform.arm(&body.mesh, node);
        self.add_caps(body, platform);
        let mut wall = body.chambers.faces.iter().peekable();
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
                self.chamber_m3[face.chamber] += volume.volume_m3;
                for (node, gradient) in nodes.iter().zip(volume.gradient) {
                    for k in 0..3 {
                        self.chamber_gradient[face.chamber][3 * node + k] += gradient[k];
                    }
                }
                element.add_pressure(&face.local, &volume, self.actuation[face.chamber]);
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
        Ok(())
    }

    /// Sets what acts beside the load; says whether it acted already.
    pub fn set_beside(&mut self, beside: &Beside) -> bool {
        let chambers = self.actuation.len();
        let same =
            self.dead_share == beside.weight && self.actuation == beside.actuation[..chambers];
        self.dead_share = beside.weight;
        self.actuation
            .copy_from_slice(&beside.actuation[..chambers]);
        same
    }

    /// What the chambers' caps on the platform add; all else of the platform is set to nothing.
    fn add_caps(&mut self, body: &Body, platform: &Platform) {
        self.platform = [[0.0; 6]; 6];
        for chamber in 0..body.chambers.count() {
            let pressure = self.actuation[chamber];
            let (gradient, tangent) = body.chambers.of_cap(chamber, platform);
            self.chamber_m3[chamber] = body.chambers.of_caps_m3(chamber, platform);
            self.chamber_gradient[chamber].fill(0.0);
            self.cap_gradient[chamber] = gradient;
            for i in 0..6 {
                for j in 0..6 {
                    self.platform[i][j] -= pressure * tangent[i][j];
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
