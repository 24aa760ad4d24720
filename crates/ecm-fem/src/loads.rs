//! Dead forces on nodes: body force and traction.

use crate::body::Body;
use crate::element::tet10;
use crate::mesh::{FACES, surface};

impl Body {
    /// ∫ N_a b dV for a force `b(X)` per undeformed volume, N/m³, by displacement component.
    pub fn volume_load(&self, b: impl Fn([f64; 3]) -> [f64; 3]) -> Vec<f64> {
        let nodes = self.mesh.nodes_m();
        let mut force_N = vec![0.0; 3 * nodes.len()];
        let rule = self.rule.points();
        for (e, tet) in self.mesh.tetrahedra().iter().enumerate() {
            let points = &self.points[e * rule.len()..(e + 1) * rule.len()];
            for (point, (lambda, _)) in points.iter().zip(rule) {
                let n = tet10::shape(lambda);
                let at = |k: usize| (0..10).map(|a| n[a] * nodes[tet[a]][k]).sum::<f64>();
                let density = b([at(0), at(1), at(2)]);
                for a in 0..10 {
                    for k in 0..3 {
                        force_N[3 * tet[a] + k] += point.volume_m3 * n[a] * density[k];
                    }
                }
            }
        }
        force_N
    }

    /// ∫ N_a t dA over the element faces whose six nodes are all `on` the loaded surface, for
    /// a dead traction `t` per undeformed area, Pa, by displacement component.
    pub fn surface_load(&self, on: impl Fn([f64; 3]) -> bool, t: [f64; 3]) -> Vec<f64> {
        let nodes = self.mesh.nodes_m();
        let mut force_N = vec![0.0; 3 * nodes.len()];
        let loaded: Vec<bool> = nodes.iter().map(|x| on(*x)).collect();
        for tet in self.mesh.tetrahedra() {
            for face in FACES.iter().map(|f| f.map(|i| tet[i])) {
                if !face.iter().all(|&i| loaded[i]) {
                    continue;
                }
                surface::integrate(&face.map(|i| nodes[i]), |n, da| {
                    for (weight, node) in n.iter().zip(face) {
                        for k in 0..3 {
                            force_N[3 * node + k] += da * weight * t[k];
                        }
                    }
                });
            }
        }
        force_N
    }
}
