//! The left Jacobian J(θ) with δφ = J δθ (virtual rotation in base axes), its inverse and derivatives.

use crate::linear::{
    Mat3, Vec3, add, cross, diagonal, dot, outer, product, scaled, skew, sub, sum, times,
};
use crate::real::Real;
use crate::stumpff::Stumpff;

/// `J(θ) = I + c₂ [θ]× + c₃ [θ]×²` of a rotation vector (rad).
#[inline]
pub fn left_jacobian<R: Real>(theta: &Vec3<R>) -> Mat3<R> {
    left_jacobian_from(theta, &Stumpff::new(dot(theta, theta)))
}

/// As [`left_jacobian`], with given functions of |θ|².
#[inline(always)]
pub fn left_jacobian_from<R: Real>(theta: &Vec3<R>, functions: &Stumpff<R>) -> Mat3<R> {
    // [θ]×² = θ θᵀ − s I and 1 − s c₃ = c₁.
    with_parts(theta, functions.c[1], functions.c[2], functions.c[3])
}

/// `J(θ)⁻¹ = I − ½ [θ]× + g [θ]×²`, g = (c₃ − 2 c₄)/(2 c₂); it exists for |θ| < 2π.
#[inline]
pub fn left_jacobian_inverse<R: Real>(theta: &Vec3<R>) -> Mat3<R> {
    left_jacobian_inverse_from(theta, &Stumpff::new(dot(theta, theta)))
}

/// As [`left_jacobian_inverse`], with given functions of |θ|².
#[inline(always)]
pub fn left_jacobian_inverse_from<R: Real>(theta: &Vec3<R>, functions: &Stumpff<R>) -> Mat3<R> {
    let c = &functions.c;
    let g = (c[3] - R::TWO * c[4]) / (R::TWO * c[2]);
    with_parts(theta, R::ONE - dot(theta, theta) * g, -R::HALF, g)
}

/// `x I + y [θ]× + z θ θᵀ`.
#[inline(always)]
fn with_parts<R: Real>(theta: &Vec3<R>, x: R, y: R, z: R) -> Mat3<R> {
    sum(
        &diagonal(x),
        &sum(&times(y, &skew(theta)), &times(z, &outer(theta, theta))),
    )
}

/// ∂J/∂θ_j for j = x, y, z.
pub fn left_jacobian_derivatives<R: Real>(theta: &Vec3<R>) -> [Mat3<R>; 3] {
    let functions = Stumpff::new(dot(theta, theta));
    let cross_theta = skew(theta);
    let square = product(&cross_theta, &cross_theta);
    let outer_part = sum(
        &times(R::TWO * functions.first(2), &cross_theta),
        &times(R::TWO * functions.first(3), &square),
    );
    let mut derivatives = [[[R::ZERO; 3]; 3]; 3];
    for j in 0..3 {
        let mut unit = [R::ZERO; 3];
        unit[j] = R::ONE;
        let e = skew(&unit);
        let inner = sum(&product(&e, &cross_theta), &product(&cross_theta, &e));
        derivatives[j] = sum(
            &times(theta[j], &outer_part),
            &sum(&times(functions.c[2], &e), &times(functions.c[3], &inner)),
        );
    }
    derivatives
}

/// D = ∂(J(θ)ᵀ τ)/∂θ at constant moment τ (N m): the contribution of the rotating axes to the Hessian.
#[inline]
pub fn torque_derivative<R: Real>(theta: &Vec3<R>, torque: &Vec3<R>) -> Mat3<R> {
    torque_derivative_from(theta, &Stumpff::new(dot(theta, theta)), torque)
}

/// As [`torque_derivative`], with given functions of |θ|².
#[inline(always)]
pub fn torque_derivative_from<R: Real>(
    theta: &Vec3<R>,
    functions: &Stumpff<R>,
    torque: &Vec3<R>,
) -> Mat3<R> {
    // Jᵀτ = τ − c₂ θ × τ + c₃ (θ (θ·τ) − s τ)
    let along = dot(theta, torque);
    let (c2, c3) = (functions.c[2], functions.c[3]);
    let square = sub(&scaled(along, theta), &scaled(dot(theta, theta), torque));
    let slope = add(
        &scaled(-R::TWO * functions.first(2), &cross(theta, torque)),
        &scaled(R::TWO * functions.first(3), &square),
    );
    let column = sub(&slope, &scaled(R::TWO * c3, torque));
    sum(
        &sum(&outer(&column, theta), &times(c3, &outer(theta, torque))),
        &sum(&diagonal(c3 * along), &times(c2, &skew(torque))),
    )
}
