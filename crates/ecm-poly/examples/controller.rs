//! A model in a controller: value and stiffness without std, heap or libm.
//!
//! A tilting joint: its moment τ (N m) grows with the tilt θ (rad) and, by a softer amount, with
//! the axial displacement x (m): τ = 4 θ + 10 θ³ − 50 x θ. The tables are constants in flash memory.
//!
//! `cargo run -p ecm-poly --no-default-features --example controller` runs it on a computer; the
//! tests also run it on a Cortex-M, where a firmware calls `holds`.
#![allow(missing_docs)]

use ecm_poly::{Polynomial, ShapeError};

/// Powers of x and θ: θ, x θ, θ³.
static EXPONENTS: [u8; 6] = [0, 1, 1, 1, 0, 3];
static COEFFICIENTS: [f32; 3] = [2.0, -0.25, 1.25];
/// Ranges that the model maps to −1 … 1.
static LOWER: [f32; 2] = [-0.01, -0.5];
static UPPER: [f32; 2] = [0.01, 0.5];

/// τ and (∂τ/∂x, ∂τ/∂θ) at (x, θ).
pub fn moment_and_stiffness(point: &[f32; 2]) -> Result<(f32, [f32; 2]), ShapeError> {
    let model = Polynomial::new(&EXPONENTS, &LOWER, &UPPER, &COEFFICIENTS)?;
    let (mut moment, mut stiffness, mut scratch) = ([0.0], [0.0; 2], [0.0; 8]);
    let scratch = scratch.get_mut(..model.scratch_len()).unwrap_or_default();
    model.value_and_jacobian(point, &mut moment, &mut stiffness, scratch)?;
    Ok((moment[0], stiffness))
}

/// Whether the model agrees with the formula above.
pub fn holds() -> bool {
    let (x, theta) = (0.004_f32, 0.3_f32);
    let moment = 4.0 * theta + 10.0 * theta * theta * theta - 50.0 * x * theta;
    let stiffness = [-50.0 * theta, 4.0 + 30.0 * theta * theta - 50.0 * x];
    let near = |a: f32, b: f32| a - b < 1e-4 && b - a < 1e-4;
    moment_and_stiffness(&[x, theta]).is_ok_and(|(found, slopes)| {
        near(found, moment) && near(slopes[0], stiffness[0]) && near(slopes[1], stiffness[1])
    })
}

#[cfg(not(target_os = "none"))]
#[allow(dead_code)]
fn main() -> std::process::ExitCode {
    std::process::ExitCode::from(u8::from(!holds()))
}
