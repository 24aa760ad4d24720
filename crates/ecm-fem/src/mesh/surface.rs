//! Integrals over faces of elements.

use super::FACES;
use crate::tensor::{cross, norm};

/// Area centre of all element faces whose six nodes are in `named` (sorted);
/// `None` when there is no such face.
pub fn centre(nodes: &[[f64; 3]], tets: &[[usize; 10]], named: &[usize]) -> Option<[f64; 3]> {
    let mut area = 0.0;
    let mut moment = [0.0; 3];
    for tet in tets {
        for face in &FACES {
            if face.iter().all(|&i| named.binary_search(&tet[i]).is_ok()) {
                let x = face.map(|i| nodes[tet[i]]);
                integrate(&x, |n, da| {
                    area += da;
                    for k in 0..3 {
                        moment[k] += da * (0..6).map(|i| n[i] * x[i][k]).sum::<f64>();
                    }
                });
            }
        }
    }
    (area > 0.0).then(|| moment.map(|m| m / area))
}

/// A point of the six-point rule (exact for degree 4; Dunavant 1985) on a curved six-node triangle.
pub struct SurfacePoint {
    /// Shape functions.
    pub shape: [f64; 6],
    /// Their derivatives by the two coordinates of the triangle.
    pub slope: [[f64; 2]; 6],
    /// Place.
    pub at: [f64; 3],
    /// Its derivatives by the two coordinates.
    pub along: [[f64; 3]; 2],
    /// Weight in the coordinates of the triangle, whose area there is 1/2.
    pub weight: f64,
}

/// Visits the points of one triangle.
pub fn visit(x: &[[f64; 3]; 6], mut visit: impl FnMut(&SurfacePoint)) {
    let rule = [
        (0.445_948_490_915_965, 0.223_381_589_678_011),
        (0.091_576_213_509_771, 0.109_951_743_655_322),
    ];
    for (a, weight) in rule {
        let b = 1.0 - 2.0 * a;
        for [l0, l1, l2] in [[a, a, b], [a, b, a], [b, a, a]] {
            let shape = [
                l0 * (2.0 * l0 - 1.0),
                l1 * (2.0 * l1 - 1.0),
                l2 * (2.0 * l2 - 1.0),
                4.0 * l0 * l1,
                4.0 * l1 * l2,
                4.0 * l0 * l2,
            ];
            // d/dl1 and d/dl2 with l0 = 1 − l1 − l2.
            let slope = [
                [1.0 - 4.0 * l0, 1.0 - 4.0 * l0],
                [4.0 * l1 - 1.0, 0.0],
                [0.0, 4.0 * l2 - 1.0],
                [4.0 * (l0 - l1), -4.0 * l1],
                [4.0 * l2, 4.0 * l1],
                [-4.0 * l2, 4.0 * (l0 - l2)],
            ];
            let sum = |w: &dyn Fn(usize) -> f64| {
                [0, 1, 2].map(|k| (0..6).map(|i| w(i) * x[i][k]).sum::<f64>())
            };
            visit(&SurfacePoint {
                at: sum(&|i| shape[i]),
                along: [sum(&|i| slope[i][0]), sum(&|i| slope[i][1])],
                shape,
                slope,
                weight: 0.5 * weight,
            });
        }
    }
}

/// Visits the points of one triangle with its shape functions and the area that belongs to each.
pub fn integrate(x: &[[f64; 3]; 6], mut with_area: impl FnMut(&[f64; 6], f64)) {
    visit(x, |point| {
        let normal = cross(point.along[0], point.along[1]);
        with_area(&point.shape, point.weight * norm(normal));
    });
}
