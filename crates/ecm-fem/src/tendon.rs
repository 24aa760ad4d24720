//! Tendons: threads without friction, straight between points of base, body and platform.
//!
//! A tendon of length ℓ(u) that is pulled with the tension T ≥ 0 has the potential Π = U + T ℓ. Its
//! amount is −ℓ, so that it enters as a chamber does: force −a ∂q/∂x and tangent −a ∂²q/∂x². Along a
//! segment with ends x₁, x₂ and the unit vector n between them, ∂ℓ/∂x₂ = n and
//! ∂²ℓ/∂x₂² = (I − n nᵀ) / ℓ. A point in the body moves as the shape functions of its element say.

use crate::FemError;
use crate::element::tet10;
use crate::mesh::Mesh;
use crate::platform::Platform;
use crate::tensor::{Mat3, apply, norm, skew};

/// Smallest rest length of a segment over the length of the body.
const SHORTEST: f64 = 1e-4;

/// Barycentric coordinate outside of an element up to which a point still belongs to it: the outline
/// of a mesh is not exactly that of the body.
const OUTSIDE: f64 = 0.05;

/// The way from one point of a tendon to the next: x₂ − x₁ = fixed + R turned + Σ weight × node.
#[derive(Debug, Clone)]
pub(crate) struct Segment {
    pub tendon: usize,
    /// Nodes of the points in the body.
    pub nodes: Vec<(usize, f64)>,
    /// Part of points that the base carries, m.
    fixed_m: [f64; 3],
    /// Weight of the platform's origin.
    pub on_platform: f64,
    /// Part of points that the platform carries, from its origin, in its axes, m.
    turned_m: [f64; 3],
}

/// All tendons of a body.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tendons {
    pub names: Vec<String>,
    pub segments: Vec<Segment>,
}

/// A segment in a state.
pub(crate) struct Stretch {
    pub length_m: f64,
    /// Unit vector from its first to its second end.
    pub along: [f64; 3],
    /// ∂(x₂ − x₁)/∂δφ of the part that is fixed to the platform: its arm.
    pub arm_m: [f64; 3],
}

impl Tendons {
    /// Finds the elements of the points in the body.
    ///
    /// # Errors
    /// A point of the body that lies outside of it; a segment without a length.
    pub fn new(mesh: &Mesh) -> Result<Self, FemError> {
        let mut tendons = Self::default();
        for (index, tendon) in mesh.tendons().iter().enumerate() {
            let refused = |problem: String| FemError::Tendon {
                name: tendon.name.clone(),
                problem,
            };
            let mut points: Vec<Segment> = Vec::new();
            let at = |fixed_m: &[f64; 3]| Segment {
                tendon: index,
                nodes: Vec::new(),
                fixed_m: *fixed_m,
                on_platform: 0.0,
                turned_m: [0.0; 3],
            };
            points.extend(tendon.base_m.iter().map(at));
            for point in &tendon.body_m {
                let nodes = locate(mesh, point).ok_or_else(|| {
                    refused(format!(
                        "its point ({:.4}, {:.4}, {:.4}) m lies outside of the body",
                        point[0], point[1], point[2]
                    ))
                })?;
                points.push(Segment {
                    nodes,
                    ..at(&[0.0; 3])
                });
            }
            points.extend(tendon.platform_m.iter().map(|x| Segment {
                on_platform: 1.0,
                turned_m: [x[0] - mesh.length_m(), x[1], x[2]],
                ..at(&[0.0; 3])
            }));
            if points.len() < 2 {
                return Err(refused(format!(
                    "it has {} points; expected at least 2, of base, body and platform",
                    points.len()
                )));
            }
            let begin = tendons.segments.len();
            (tendons.segments).extend(points.windows(2).map(|pair| pair[0].to(&pair[1])));
            let rest = Platform::at_rest(mesh.length_m());
            let shortest = SHORTEST * mesh.length_m();
            let short = tendons.segments[begin..]
                .iter()
                .map(|s| s.stretch(|node| mesh.nodes_m()[node], &rest).length_m)
                .position(|length| length.is_nan() || length < shortest);
            if let Some(k) = short {
                return Err(refused(format!(
                    "its points {} and {} lie at one place",
                    k + 1,
                    k + 2
                )));
            }
            tendons.names.push(tendon.name.clone());
        }
        Ok(tendons)
    }

    pub fn count(&self) -> usize {
        self.names.len()
    }

    /// Length of each tendon, m.
    pub fn lengths_m(
        &self,
        at: impl Fn(usize) -> [f64; 3] + Copy,
        platform: &Platform,
    ) -> Vec<f64> {
        let mut lengths = vec![0.0; self.count()];
        for segment in &self.segments {
            lengths[segment.tendon] += segment.stretch(at, platform).length_m;
        }
        lengths
    }
}

impl Segment {
    /// From the point of `self` to the point of `end`.
    fn to(&self, end: &Self) -> Self {
        let minus = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|k| a[k] - b[k]);
        let mut nodes = end.nodes.clone();
        for &(node, weight) in &self.nodes {
            match nodes.iter_mut().find(|(known, _)| *known == node) {
                Some((_, sum)) => *sum -= weight,
                None => nodes.push((node, -weight)),
            }
        }
        Self {
            tendon: self.tendon,
            nodes,
            fixed_m: minus(end.fixed_m, self.fixed_m),
            on_platform: end.on_platform - self.on_platform,
            turned_m: minus(end.turned_m, self.turned_m),
        }
    }

    /// Its length and direction; `at` gives the place of a node.
    pub fn stretch(&self, at: impl Fn(usize) -> [f64; 3], platform: &Platform) -> Stretch {
        let arm_m = apply(&platform.rotation, self.turned_m);
        let mut way: [f64; 3] = std::array::from_fn(|k| {
            self.fixed_m[k] + self.on_platform * platform.position_m[k] + arm_m[k]
        });
        for &(node, weight) in &self.nodes {
            let x = at(node);
            (0..3).for_each(|k| way[k] += weight * x[k]);
        }
        let length_m = norm(way);
        Stretch {
            length_m,
            along: way.map(|v| v / length_m),
            arm_m,
        }
    }

    /// ∂(x₂ − x₁)/∂(δr, δφ): of the rigid part, and of those nodes that move with the platform.
    pub fn by_platform(
        &self,
        stretch: &Stretch,
        arm_of: impl Fn(usize) -> Option<[f64; 3]>,
    ) -> [[f64; 6]; 3] {
        let (mut shift, mut arm) = (self.on_platform, stretch.arm_m);
        for &(node, weight) in &self.nodes {
            if let Some(own) = arm_of(node) {
                shift += weight;
                (0..3).for_each(|k| arm[k] += weight * own[k]);
            }
        }
        let turn: Mat3 = skew(arm);
        std::array::from_fn(|i| {
            std::array::from_fn(|j| match j {
                j if j < 3 => f64::from(u8::from(i == j)) * shift,
                _ => -turn[i][j - 3],
            })
        })
    }
}

/// Nodes and shape functions of a point in the undeformed body; `None` outside of it.
fn locate(mesh: &Mesh, point: &[f64; 3]) -> Option<Vec<(usize, f64)>> {
    let mut best: Option<(f64, usize, [f64; 4])> = None;
    for (e, tet) in mesh.tetrahedra().iter().enumerate() {
        let x = tet.map(|node| mesh.nodes_m()[node]);
        let near = (0..3).all(|k| {
            let (low, high) = (x.iter()).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| {
                (a.min(p[k]), b.max(p[k]))
            });
            let margin = OUTSIDE * (high - low);
            (low - margin..=high + margin).contains(&point[k])
        });
        if !near {
            continue;
        }
        if let Some(l) = barycentric(&x, point) {
            let least = l.iter().copied().fold(f64::INFINITY, f64::min);
            if best.is_none_or(|(known, ..)| least > known) {
                best = Some((least, e, l));
            }
        }
    }
    let (least, e, l) = best?;
    (least >= -OUTSIDE).then(|| {
        let weights = tet10::shape(&l);
        (mesh.tetrahedra()[e].iter().copied())
            .zip(weights)
            .filter(|(_, weight)| weight.abs() > 1e-12)
            .collect()
    })
}

/// Barycentric coordinates of a point by Newton's method on the map of the element.
fn barycentric(x: &[[f64; 3]; 10], point: &[f64; 3]) -> Option<[f64; 4]> {
    let mut l = [0.25; 4];
    for _ in 0..20 {
        let n = tet10::shape(&l);
        let gap: [f64; 3] =
            std::array::from_fn(|k| point[k] - (0..10).map(|a| n[a] * x[a][k]).sum::<f64>());
        let (j, det) = tet10::jacobian(x, &l);
        // J⁻¹ = cof(J)ᵀ / det.
        let cofactor = crate::tensor::cofactor(&j);
        let step: [f64; 3] =
            std::array::from_fn(|c| (0..3).map(|r| cofactor[r][c] * gap[r]).sum::<f64>() / det);
        for k in 0..3 {
            l[k + 1] += step[k];
        }
        l[0] = 1.0 - l[1] - l[2] - l[3];
        if !l.iter().all(|v| v.abs() < 10.0) {
            return None;
        }
        if step.iter().all(|s| s.abs() < 1e-12) {
            return Some(l);
        }
    }
    None
}
