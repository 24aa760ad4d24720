//! The three classical tests of a solid that keeps its volume.

use super::Material;
use crate::FemError;

/// Kinds of tests by name: the second stretch is the first to this power, the third keeps the
/// volume and has no stress.
pub const TESTS: [(&str, f64); 3] = [
    ("uniaxial", -0.5),
    ("equibiaxial", 1.0),
    ("pure_shear", 0.0),
];

/// Force per undeformed area, Pa, in the pulled direction, of the incompressible solid.
///
/// With F = diag(l, l^s, l^(−1−s)) and the distortional stress P of the material, the pressure
/// follows from the free third direction: P₁₁ − P₃₃ F₃₃ / F₁₁ (Ogden 1984, §4.4).
///
/// # Errors
/// A test that is not in [`TESTS`], a stretch that is not positive.
///
/// # Examples
/// ```
/// use ecm_fem::material::{NeoHookean, nominal_stress};
/// let solid = NeoHookean::new(3e5, 0.5)?; // μ = 0.1 MPa
/// let stress = nominal_stress(&solid, "uniaxial", &[1.0, 2.0])?;
/// assert!(stress[0].abs() < 1e-6 && (stress[1] - 1e5 * (2.0 - 0.25)).abs() < 1e-6);
/// # Ok::<(), ecm_fem::FemError>(())
/// ```
pub fn nominal_stress(
    material: &dyn Material,
    test: &str,
    stretches: &[f64],
) -> Result<Vec<f64>, FemError> {
    let Some((_, power)) = TESTS.iter().find(|(name, _)| *name == test) else {
        return Err(FemError::Word {
            name: "test",
            value: test.into(),
            expected: "\"uniaxial\", \"equibiaxial\" or \"pure_shear\"",
        });
    };
    let stress = |&first: &f64| {
        if !(first.is_finite() && first > 0.0) {
            return Err(FemError::Parameter {
                name: "stretch",
                value: first,
                expected: "above 0 (1 is undeformed)",
            });
        }
        let second = first.powf(*power);
        let third = 1.0 / (first * second);
        let f = [[first, 0.0, 0.0], [0.0, second, 0.0], [0.0, 0.0, third]];
        let p = material.respond(&f, 1.0).stress;
        Ok(p[0][0] - p[2][2] * third / first)
    };
    stretches.iter().map(stress).collect()
}
