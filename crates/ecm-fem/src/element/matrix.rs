//! Forces and matrix of one element, for each way to treat the pressure.

use crate::body::{Body, Field, Formulation, Inverted, PAD, deformation, element_displacement};
use crate::chamber::FaceVolume;
use crate::tensor::{Mat3, cofactor, skew};

/// Forces and matrix of one element.
#[derive(Debug, Default)]
pub(crate) struct Element {
    pub energy: f64,
    pub smallest_jacobian: f64,
    /// By component, then node.
    pub force: [[f64; PAD]; 3],
    /// Residual of the pressure equations.
    pub volume: [f64; 4],
    /// `[a][i][k][b]`, valid for b ≥ 4 ⌊a / 4⌋.
    stiffness: [[[[f64; PAD]; 3]; 3]; 10],
    /// `[m][i][a]`.
    mixed: [[[f64; PAD]; 3]; 4],
    compliance: [[f64; 4]; 4],
}

impl Element {
    #[inline(never)]
    pub fn evaluate(
        &mut self,
        body: &Body,
        e: usize,
        field: &Field,
        softening: f64,
    ) -> Result<(), Inverted> {
        *self = Self {
            smallest_jacobian: f64::INFINITY,
            ..Self::default()
        };
        let tet = &body.mesh.tetrahedra()[e];
        let u = element_displacement(tet, field);
        let scale = body.modulus_scale[e];
        let unit = body.pressure_unit_Pa;
        // Both times the pressure unit.
        let (by_kappa, compliance) = body.compliances(e, softening);
        let (by_kappa, compliance) = (unit * by_kappa, unit * compliance);
        let rule = body.rule.points();
        let points = &body.points[e * rule.len()..(e + 1) * rule.len()];
        let formulation = body.formulation;
        let condensed = body.condensed_pressures();
        let corner_pressure: [f64; 4] = if condensed == 0 {
            std::array::from_fn(|m| field.pressure[tet[m]])
        } else {
            [0.0; 4]
        };
        // Stored pressure, and its update by the residual J − 1 − p/κ.
        let stored_and_updated = |stored: f64, gap: f64| {
            let scaled = stored + (gap - by_kappa * stored) / compliance;
            (unit * stored, unit * scaled)
        };
        let energy = |scaled: f64, gap: f64| unit * scaled * (gap - 0.5 * by_kappa * scaled);
        let (mut volume, mut mean) = (0.0, (0.0, 0.0));
        if formulation == Formulation::ConstantPressure {
            let mut mean_gap = 0.0;
            for point in points {
                volume += point.volume_m3;
                mean_gap +=
                    point.volume_m3 * (crate::tensor::determinant(&deformation(point, &u)) - 1.0);
            }
            mean_gap /= volume;
            mean = stored_and_updated(field.pressure[e], mean_gap);
            self.energy += volume * energy(mean.1 / unit, mean_gap);
        }
        for (q, (point, (psi, _))) in points.iter().zip(rule).enumerate() {
            let f = deformation(point, &u);
            let cof = cofactor(&f);
            let jacobian = f[0][0] * cof[0][0] + f[0][1] * cof[0][1] + f[0][2] * cof[0][2];
            if jacobian.is_nan() || jacobian <= 0.0 {
                return Err(Inverted);
            }
            self.smallest_jacobian = self.smallest_jacobian.min(jacobian);
            let weight = point.volume_m3;
            let scaled: f64 = (0..4).map(|m| psi[m] * corner_pressure[m]).sum();
            // In the geometric stiffness, and in the forces.
            let (geometric_p, p) = match formulation {
                Formulation::TaylorHood => (unit * scaled, unit * scaled),
                Formulation::ConstantPressure => mean,
                Formulation::Displacement => {
                    stored_and_updated(field.pressure[e * condensed + q], jacobian - 1.0)
                }
            };
            let mut response = body.material.respond(&f, jacobian);
            let distortion = weight * scale;
            self.energy += distortion * response.energy;
            match formulation {
                Formulation::TaylorHood | Formulation::Displacement => {
                    self.energy += weight * energy(p / unit, jacobian - 1.0);
                }
                Formulation::ConstantPressure => {}
            }
            let stabilisation = body.stabilisation(e, &f, jacobian, p);
            let more = stabilisation.as_ref().map_or(0.0, |x| x.pressure);
            let (geometric_p, p) = (geometric_p + more, p + more);
            self.energy += stabilisation.as_ref().map_or(0.0, |x| weight * x.energy);
            // Weighted stress and tangent with the pressure's part.
            let wp = weight * p;
            for i in 0..3 {
                for j in 0..3 {
                    let mut stress = distortion * response.stress[i][j] + wp * cof[i][j];
                    if let Some(x) = &stabilisation {
                        stress += weight * x.stress[i][j];
                    }
                    for a in 0..PAD {
                        self.force[i][a] += stress * point.gradients[j][a];
                    }
                }
            }
            for row in &mut response.tangent {
                for value in row {
                    *value *= distortion;
                }
            }
            add_cofactor_tangent(&mut response.tangent, &f, weight * geometric_p);
            if formulation == Formulation::Displacement {
                for r in 0..9 {
                    for q in 0..9 {
                        response.tangent[r][q] +=
                            weight * unit / compliance * cof[r / 3][r % 3] * cof[q / 3][q % 3];
                    }
                }
            }
            let (mut mixing, mut by_kappa, mut compliance) = (cof, by_kappa, compliance);
            if let Some(x) = &stabilisation {
                x.add_tangent(&mut response.tangent, &cof, weight);
                by_kappa = unit * x.by_kappa;
                compliance = compliance.max(by_kappa);
                for i in 0..3 {
                    for j in 0..3 {
                        mixing[i][j] -= x.mixing[i][j];
                    }
                }
            }
            self.add_stiffness(&response.tangent, &point.gradients);
            let mut spread = [[0.0; PAD]; 3];
            for i in 0..3 {
                for j in 0..3 {
                    for a in 0..PAD {
                        spread[i][a] += mixing[i][j] * point.gradients[j][a];
                    }
                }
            }
            let gap = jacobian - 1.0 - by_kappa * scaled;
            for m in 0..4 {
                let c = weight * unit * psi[m];
                self.volume[m] += c * gap;
                for i in 0..3 {
                    for a in 0..PAD {
                        self.mixed[m][i][a] += c * spread[i][a];
                    }
                }
                for n in 0..=m {
                    self.compliance[m][n] -= c * compliance * psi[n];
                }
            }
        }
        if formulation == Formulation::ConstantPressure {
            self.add_mean_dilatation(1.0 / (volume * unit * compliance));
        }
        Ok(())
    }

    /// Force and stiffness of a gauge pressure, Pa, on one face.
    pub fn add_pressure(&mut self, local: &[usize; 6], of: &FaceVolume, pressure_Pa: f64) {
        let force = of.gradient.map(|g| g.map(|v| -pressure_Pa * v));
        self.add_nodes(local, &force, |a, b| {
            skew(of.turn[a][b].map(|v| -pressure_Pa * v))
        });
    }

    /// Force by node and stiffness by pair of nodes, of those at `local` in the element.
    pub fn add_nodes(
        &mut self,
        local: &[usize],
        force: &[[f64; 3]],
        stiffness: impl Fn(usize, usize) -> Mat3,
    ) {
        for (a, &la) in local.iter().enumerate() {
            for i in 0..3 {
                self.force[i][la] += force[a][i];
            }
            for (b, &lb) in local.iter().enumerate().filter(|(_, lb)| **lb >= la) {
                let block = stiffness(a, b);
                for i in 0..3 {
                    for k in 0..3 {
                        self.stiffness[la][i][k][lb] += block[i][k];
                    }
                }
            }
        }
    }

    /// K_ab += c b_a b_b with b = ∂∫J/∂u times the pressure unit, the sum of the rows of `mixed`.
    fn add_mean_dilatation(&mut self, c: f64) {
        let b: [[f64; PAD]; 3] = std::array::from_fn(|i| {
            std::array::from_fn(|a| (0..4).map(|m| self.mixed[m][i][a]).sum())
        });
        for a in 0..10 {
            for i in 0..3 {
                for k in 0..3 {
                    for n in a / 4 * 4..PAD {
                        self.stiffness[a][i][k][n] += c * b[i][a] * b[k][n];
                    }
                }
            }
        }
    }

    /// K_ab += g_a · A · g_b for b from the block of four that holds a.
    #[inline(always)]
    fn add_stiffness(&mut self, tangent: &[[f64; 9]; 9], g: &[[f64; PAD]; 3]) {
        // half[J][i][k][b] = Σ_L A_iJkL g_b,L
        let mut half = [[[[0.0; PAD]; 3]; 3]; 3];
        for i in 0..3 {
            for j in 0..3 {
                for k in 0..3 {
                    let row = &tangent[3 * i + j][3 * k..3 * k + 3];
                    let out = &mut half[j][i][k];
                    for b in 0..PAD {
                        out[b] = row[0] * g[0][b] + row[1] * g[1][b] + row[2] * g[2][b];
                    }
                }
            }
        }
        for a in 0..10 {
            let (g0, g1, g2) = (g[0][a], g[1][a], g[2][a]);
            let start = a / 4 * 4;
            for i in 0..3 {
                for k in 0..3 {
                    let out = &mut self.stiffness[a][i][k][start..];
                    let (h0, h1, h2) = (
                        &half[0][i][k][start..],
                        &half[1][i][k][start..],
                        &half[2][i][k][start..],
                    );
                    for b in 0..out.len() {
                        out[b] += g0 * h0[b] + g1 * h1[b] + g2 * h2[b];
                    }
                }
            }
        }
    }

    /// Adds the lower triangle in the order of [`crate::pattern::entries`].
    #[inline(never)]
    pub fn scatter(&self, targets: &[u32], tangent: &mut [f64]) {
        let mut at = targets.iter();
        let mut add = |value: f64| {
            if let Some(&target) = at.next()
                && let Some(entry) = tangent.get_mut(target as usize)
            {
                *entry += value;
            }
        };
        for a in 0..10 {
            for i in 0..3 {
                for k in i..3 {
                    add(self.stiffness[a][i][k][a]);
                }
                for b in a + 1..10 {
                    for k in 0..3 {
                        add(self.stiffness[a][i][k][b]);
                    }
                }
            }
        }
        for m in 0..4 {
            for a in 0..10 {
                for i in 0..3 {
                    add(self.mixed[m][i][a]);
                }
            }
        }
        for m in 0..4 {
            for n in 0..=m {
                add(self.compliance[m][n]);
            }
        }
    }

    /// Entry of the 34 × 34 matrix with a displacement column.
    pub fn entry(&self, row: usize, column: usize) -> f64 {
        if row >= 30 {
            return self.mixed[row - 30][column % 3][column / 3];
        }
        let (a, b) = (row.min(column), row.max(column));
        self.stiffness[a / 3][a % 3][b % 3][b / 3]
    }
}

/// A_iJkL += p ∂(cof F)_iJ/∂F_kL = p ε_ikm ε_JLN F_mN.
#[inline(always)]
fn add_cofactor_tangent(tangent: &mut [[f64; 9]; 9], f: &Mat3, p: f64) {
    for i in 0..3 {
        let (k1, k2) = ((i + 1) % 3, (i + 2) % 3);
        for j in 0..3 {
            let (l1, l2) = ((j + 1) % 3, (j + 2) % 3);
            let row = &mut tangent[3 * i + j];
            // ε_i,k1,k2 = +1 with m the remaining index.
            row[3 * k1 + l1] += p * f[k2][l2];
            row[3 * k1 + l2] -= p * f[k2][l1];
            row[3 * k2 + l1] -= p * f[k1][l2];
            row[3 * k2 + l2] += p * f[k1][l1];
        }
    }
}
