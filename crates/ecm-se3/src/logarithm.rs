//! Rotation vectors of rotation matrices and quaternions; the only part that needs `std`.

use crate::error::RotationError;
use crate::linear::{Mat3, Vec3, cross, dot, scaled, transposed, transposed_product};

/// Largest entry of RᵀR − I of a matrix that still counts as a rotation: three digits, as people
/// write them.
const DEVIATION: f64 = 1e-3;

/// θ = log R (rad), |θ| ≤ π, of a rotation matrix; at |θ| = π one of the two signs.
///
/// By way of the unit quaternion, taken from the largest of its four components, so that
/// no digit is lost near 0 or π. A matrix that is only nearly orthogonal gives the vector
/// of a rotation near it.
///
/// # Errors
/// A reflection, a matrix that is not orthogonal to three digits, or one with NaN.
///
/// ```
/// use ecm_se3::{rotation_matrix, rotation_vector};
/// # fn main() -> Result<(), ecm_se3::RotationError> {
/// let theta = rotation_vector(&rotation_matrix(&[0.1, -0.2, 0.3]))?;
/// assert!((theta[2] - 0.3).abs() < 1e-15);
/// let mirror = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// assert!(rotation_vector(&mirror).is_err());
/// # Ok(()) }
/// ```
pub fn rotation_vector(rotation: &Mat3<f64>) -> Result<Vec3<f64>, RotationError> {
    check(rotation)?;
    Ok(vector_of_quaternion(&quaternion(rotation)))
}

fn check(rotation: &Mat3<f64>) -> Result<(), RotationError> {
    let product = transposed_product(rotation, rotation);
    let mut deviation = 0.0_f64;
    for i in 0..3 {
        for j in 0..3 {
            let unit = if i == j { 1.0 } else { 0.0 };
            let entry = (product[i][j] - unit).abs();
            // `max` would pass over NaN.
            if entry > deviation || entry.is_nan() {
                deviation = entry;
            }
        }
    }
    let [x, y, z] = transposed(rotation);
    let determinant = dot(&x, &cross(&y, &z));
    if deviation <= DEVIATION && determinant > 0.0 {
        return Ok(());
    }
    Err(RotationError {
        matrix: *rotation,
        determinant,
        deviation,
    })
}

/// Unit quaternion (w, x, y, z), w ≥ 0, of a rotation matrix.
fn quaternion(rotation: &Mat3<f64>) -> [f64; 4] {
    let m = rotation;
    let trace = m[0][0] + m[1][1] + m[2][2];
    let squares = [trace, m[0][0], m[1][1], m[2][2]];
    let mut largest = 0;
    for k in 1..4 {
        if squares[k] > squares[largest] {
            largest = k;
        }
    }
    let mut q = [0.0; 4];
    if largest == 0 {
        q = [
            1.0 + trace,
            m[2][1] - m[1][2],
            m[0][2] - m[2][0],
            m[1][0] - m[0][1],
        ];
    } else {
        let i = largest - 1;
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        q[0] = m[k][j] - m[j][k];
        q[1 + i] = 1.0 + m[i][i] - m[j][j] - m[k][k];
        q[1 + j] = m[i][j] + m[j][i];
        q[1 + k] = m[i][k] + m[k][i];
    }
    let norm = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    let sign = if q[0] < 0.0 { -1.0 } else { 1.0 };
    q.map(|x| sign * x / norm)
}

/// θ = 2 atan2(|v|, w) v/|v| (rad) of a unit quaternion (w, v), w ≥ 0.
fn vector_of_quaternion(quaternion: &[f64; 4]) -> Vec3<f64> {
    let [w, x, y, z] = *quaternion;
    let sine = (x * x + y * y + z * z).sqrt();
    // Below 1e-8 the quotient 2 atan(t)/t is 2 to the last bit.
    let factor = if sine < 1e-8 {
        2.0 / w
    } else {
        2.0 * sine.atan2(w) / sine
    };
    scaled(factor, &[x, y, z])
}
