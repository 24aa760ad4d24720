//! Shape functions of the ten-node tetrahedron.
//!
//! Corners N_i = l_i (2 l_i − 1), mid-edge nodes N_ij = 4 l_i l_j, in barycentric
//! coordinates l; the map is isoparametric, so edges may be curved.

use crate::mesh::EDGES;

/// The ten shape functions at barycentric `l`.
pub fn shape(l: &[f64; 4]) -> [f64; 10] {
    let mut n = [0.0; 10];
    for i in 0..4 {
        n[i] = l[i] * (2.0 * l[i] - 1.0);
    }
    for (e, [i, j]) in EDGES.iter().enumerate() {
        n[4 + e] = 4.0 * l[*i] * l[*j];
    }
    n
}

/// Derivatives by (l1, l2, l3), with l0 = 1 − l1 − l2 − l3.
pub fn local_gradients(l: &[f64; 4]) -> [[f64; 3]; 10] {
    let mut by_l = [[0.0; 4]; 10];
    for i in 0..4 {
        by_l[i][i] = 4.0 * l[i] - 1.0;
    }
    for (e, [i, j]) in EDGES.iter().enumerate() {
        by_l[4 + e][*i] = 4.0 * l[*j];
        by_l[4 + e][*j] = 4.0 * l[*i];
    }
    by_l.map(|d| [d[1] - d[0], d[2] - d[0], d[3] - d[0]])
}

/// dX/dl (rows X, columns l1..l3) and its determinant at barycentric `l`.
pub fn jacobian(x: &[[f64; 3]; 10], l: &[f64; 4]) -> ([[f64; 3]; 3], f64) {
    let d = local_gradients(l);
    let mut j = [[0.0; 3]; 3];
    for a in 0..10 {
        for r in 0..3 {
            for c in 0..3 {
                j[r][c] += x[a][r] * d[a][c];
            }
        }
    }
    (j, crate::tensor::determinant(&j))
}

/// Gradients of the shape functions by position, and the Jacobian determinant.
pub fn gradients(x: &[[f64; 3]; 10], l: &[f64; 4]) -> ([[f64; 3]; 10], f64) {
    let (j, det) = jacobian(x, l);
    // dN/dX = dN/dl (dX/dl)^-1 = cof(J) dN/dl / det J.
    let cofactor = crate::tensor::cofactor(&j);
    let g = local_gradients(l)
        .map(|d| [0, 1, 2].map(|r| (0..3).map(|c| cofactor[r][c] * d[c]).sum::<f64>() / det));
    (g, det)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shape_functions_sum_to_one_and_are_nodal() {
        let l = [0.1, 0.2, 0.3, 0.4];
        assert!((shape(&l).iter().sum::<f64>() - 1.0).abs() < 1e-15);
        for (e, [i, j]) in EDGES.iter().enumerate() {
            let mut mid = [0.0; 4];
            mid[*i] = 0.5;
            mid[*j] = 0.5;
            for (a, n) in shape(&mid).iter().enumerate() {
                let expected = if a == 4 + e { 1.0 } else { 0.0 };
                assert!((n - expected).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn gradients_are_derivatives_of_the_shape_functions() {
        let l = [0.15, 0.25, 0.2, 0.4];
        let h = 1e-6;
        for k in 0..3 {
            let (mut up, mut down) = (l, l);
            up[k + 1] += h;
            up[0] -= h;
            down[k + 1] -= h;
            down[0] += h;
            let (nu, nd) = (shape(&up), shape(&down));
            for a in 0..10 {
                let fd = (nu[a] - nd[a]) / (2.0 * h);
                assert!((fd - local_gradients(&l)[a][k]).abs() < 1e-9);
            }
        }
    }
}
