//! Integrals over faces of elements.

use super::FACES;

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

/// Visits the points of one curved six-node triangle with its shape functions and the area
/// that belongs to the point (six-point rule, exact for degree 4; Dunavant 1985).
pub fn integrate(x: &[[f64; 3]; 6], mut visit: impl FnMut(&[f64; 6], f64)) {
    let rule = [
        (0.445_948_490_915_965, 0.223_381_589_678_011),
        (0.091_576_213_509_771, 0.109_951_743_655_322),
    ];
    for (a, weight) in rule {
        let b = 1.0 - 2.0 * a;
        for [l0, l1, l2] in [[a, a, b], [a, b, a], [b, a, a]] {
            let n = [
                l0 * (2.0 * l0 - 1.0),
                l1 * (2.0 * l1 - 1.0),
                l2 * (2.0 * l2 - 1.0),
                4.0 * l0 * l1,
                4.0 * l1 * l2,
                4.0 * l0 * l2,
            ];
            // d/dl1 and d/dl2 with l0 = 1 − l1 − l2.
            let d1 = [
                1.0 - 4.0 * l0,
                4.0 * l1 - 1.0,
                0.0,
                4.0 * (l0 - l1),
                4.0 * l2,
                -4.0 * l2,
            ];
            let d2 = [
                1.0 - 4.0 * l0,
                0.0,
                4.0 * l2 - 1.0,
                -4.0 * l1,
                4.0 * l1,
                4.0 * (l0 - l2),
            ];
            let at = |w: &[f64; 6], k: usize| (0..6).map(|i| w[i] * x[i][k]).sum::<f64>();
            let (t1, t2) = ([0, 1, 2].map(|k| at(&d1, k)), [0, 1, 2].map(|k| at(&d2, k)));
            let normal = [
                t1[1] * t2[2] - t1[2] * t2[1],
                t1[2] * t2[0] - t1[0] * t2[2],
                t1[0] * t2[1] - t1[1] * t2[0],
            ];
            let da = 0.5 * weight * normal.iter().map(|c| c * c).sum::<f64>().sqrt();
            visit(&n, da);
        }
    }
}
