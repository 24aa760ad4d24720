//! Groups of terms that break the symmetry of a mechanism, switched on by name.
//!
//! With C = c_y + i c_z and D = −θ_z + i θ_y (both polar vectors of the yz plane, D the direction in
//! which the top leans), a monomial c_xⁿ θ_xᵏ Cᵃ C̄ᵇ Dᶜ D̄ᵈ turns m = a − b + c − d times when
//! the body turns once about its axis. Exchanging the ends, a mirror at x = L/2, changes the
//! signs of C and θ_x; a mirror through the axis conjugates C and D and changes the sign of θ_x.
//!
//! | group | m | exchange of the ends | mirror through the axis |
//! |---|---|---|---|
//! | `unlike_ends` | 0 | odd | even |
//! | `handedness` | 0 | odd | odd |
//! | `precurvature` | 1 | even | any direction |
//! | `face_tilt` | 1 | even and odd | any direction |
//! | `anisotropy` | 2 | even | any direction |

use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec::Vec;

use crate::basis::advance;
use crate::energy::invariants::Symmetry;
use crate::error::ModelError;

/// Highest degree of a group's terms; broken symmetries are small.
pub const GROUP_DEGREE: usize = 4;

/// A broken symmetry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Group {
    /// The two ends differ, as the base of a cone: K(y, θz) ≠ −(L/2) K(y, y).
    UnlikeEnds,
    /// A handed body or material, as a helix: stretch couples to twist.
    Handedness,
    /// The axis is bent at rest, symmetrically towards both ends.
    Precurvature,
    /// One end face is not square to the axis, or set off sideways.
    FaceTilt,
    /// Stiffer in one plane of bending than in the other.
    Anisotropy,
}

impl Group {
    /// All of them.
    pub const ALL: [Group; 5] = [
        Group::UnlikeEnds,
        Group::Handedness,
        Group::Precurvature,
        Group::FaceTilt,
        Group::Anisotropy,
    ];

    /// The name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Group::UnlikeEnds => "unlike_ends",
            Group::Handedness => "handedness",
            Group::Precurvature => "precurvature",
            Group::FaceTilt => "face_tilt",
            Group::Anisotropy => "anisotropy",
        }
    }

    /// The groups of a list of names, in a fixed order and each once.
    ///
    /// # Errors
    /// An unknown name, or a group whose terms the symmetry has already.
    pub fn from_names<S: AsRef<str>>(
        names: &[S],
        symmetry: Symmetry,
    ) -> Result<Vec<Self>, ModelError> {
        let mut groups = Vec::new();
        for name in names {
            let name = name.as_ref();
            let found = Self::ALL.into_iter().find(|g| g.name() == name);
            groups.push(found.ok_or_else(|| ModelError::Setting {
                name: "group",
                found: format!("{name:?}"),
                expected: "unlike_ends, handedness, precurvature, face_tilt or anisotropy",
            })?);
        }
        Self::in_order(&groups, symmetry)
    }

    /// Groups in a fixed order and each once.
    ///
    /// # Errors
    /// A group whose terms the symmetry has already.
    pub(crate) fn in_order(groups: &[Self], symmetry: Symmetry) -> Result<Vec<Self>, ModelError> {
        let inside = |group: &Self| match symmetry {
            Symmetry::Alike => false,
            Symmetry::Revolution => *group == Group::UnlikeEnds,
            Symmetry::General => true,
        };
        if let Some(group) = groups.iter().find(|group| inside(group)) {
            return Err(ModelError::Setting {
                name: "group",
                found: format!("{:?} with symmetry {}", group.name(), symmetry.name()),
                expected: "a group whose terms the symmetry does not have already: leave it out",
            });
        }
        let mut groups = groups.to_vec();
        groups.sort_unstable();
        groups.dedup();
        Ok(groups)
    }

    fn contains(self, term: &GroupTerm) -> bool {
        let [_, k, a, b, ..] = term.powers;
        let ends_odd = (a + b + k) % 2 == 1;
        // Re is even under the mirror, Im odd, and θ_x turns its sign.
        let mirror_odd = (k % 2 == 1) != term.imaginary;
        match self {
            Group::UnlikeEnds => term.turns() == 0 && ends_odd && !mirror_odd,
            Group::Handedness => term.turns() == 0 && ends_odd && mirror_odd,
            Group::Precurvature => term.turns() == 1 && !ends_odd,
            Group::FaceTilt => term.turns() == 1,
            Group::Anisotropy => term.turns() == 2 && !ends_odd,
        }
    }
}

/// Re or Im of c_xⁿ θ_xᵏ Cᵃ C̄ᵇ Dᶜ D̄ᵈ.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupTerm {
    /// n, k, a, b, c, d.
    pub powers: [u8; 6],
    /// Im, not Re.
    pub imaginary: bool,
    /// As a sum of monomials in (c_x, c_y, c_z, θ_x, θ_y, θ_z).
    pub monomials: Vec<([u8; 6], f64)>,
}

impl GroupTerm {
    fn turns(&self) -> i8 {
        let [_, _, a, b, c, d] = self.powers.map(|e| e as i8);
        a - b + c - d
    }

    /// Row of a model file: n, k, a, b, c, d, and 0 for Re or 1 for Im.
    pub fn row(&self) -> Vec<u8> {
        let mut row = self.powers.to_vec();
        row.push(u8::from(self.imaginary));
        row
    }

    /// Like `Re c_x C D`, `*` for conjugates.
    pub fn name(&self) -> String {
        let mut name = if self.imaginary { "Im" } else { "Re" }.to_string();
        let factors = ["c_x", "theta_x", "C", "C*", "D", "D*"];
        for (factor, &power) in factors.iter().zip(&self.powers) {
            match power {
                0 => {}
                1 => name.push_str(&format!(" {factor}")),
                e => name.push_str(&format!(" {factor}^{e}")),
            }
        }
        name
    }
}

/// The terms of all groups without repeats: by degree, then in the order of the paper's eq. (4).
pub fn group_terms(groups: &[Group], degree: usize) -> Vec<GroupTerm> {
    let highest = degree.min(GROUP_DEGREE);
    let mut found = Vec::new();
    let mut powers = [0_u8; 6];
    advance(&mut powers);
    while powers.iter().map(|&e| usize::from(e)).sum::<usize>() <= highest {
        for imaginary in [false, true] {
            let mut term = GroupTerm {
                powers,
                imaginary,
                monomials: Vec::new(),
            };
            // Only the first of a pair of conjugates: the second is the same up to its sign.
            let [n, k, a, b, c, d] = powers;
            let first = term.turns() > 0 || (term.turns() == 0 && [a, b, c, d] >= [b, a, d, c]);
            if first && groups.iter().any(|g| g.contains(&term)) {
                term.monomials = expanded([n, k, a, b, c, d], imaginary);
                if !term.monomials.is_empty() {
                    found.push(term);
                }
            }
        }
        advance(&mut powers);
    }
    found
}

/// A polynomial in (c, θ): exponents, real and imaginary coefficient.
type Complex = Vec<([u8; 6], [f64; 2])>;

fn times(sum: &Complex, factor: &Complex) -> Complex {
    let mut result: Complex = Vec::new();
    for (e, [x, y]) in sum {
        for (f, [u, v]) in factor {
            let key = core::array::from_fn(|i| e[i] + f[i]);
            let value = [x * u - y * v, x * v + y * u];
            match result.iter_mut().find(|(k, _)| *k == key) {
                Some((_, old)) => *old = [old[0] + value[0], old[1] + value[1]],
                None => result.push((key, value)),
            }
        }
    }
    result
}

fn expanded(powers: [u8; 6], imaginary: bool) -> Vec<([u8; 6], f64)> {
    let unit = |i: usize| {
        let mut e = [0; 6];
        e[i] = 1;
        e
    };
    // c_x, θ_x, C, C̄, D = −θ_z + i θ_y, D̄.
    let factors: [Complex; 6] = [
        alloc::vec![(unit(0), [1.0, 0.0])],
        alloc::vec![(unit(3), [1.0, 0.0])],
        alloc::vec![(unit(1), [1.0, 0.0]), (unit(2), [0.0, 1.0])],
        alloc::vec![(unit(1), [1.0, 0.0]), (unit(2), [0.0, -1.0])],
        alloc::vec![(unit(5), [-1.0, 0.0]), (unit(4), [0.0, 1.0])],
        alloc::vec![(unit(5), [-1.0, 0.0]), (unit(4), [0.0, -1.0])],
    ];
    let mut sum: Complex = alloc::vec![([0; 6], [1.0, 0.0])];
    for (factor, &power) in factors.iter().zip(&powers) {
        for _ in 0..power {
            sum = times(&sum, factor);
        }
    }
    let part = usize::from(imaginary);
    let real = sum.into_iter().map(|(e, value)| (e, value[part]));
    real.filter(|(_, value)| *value != 0.0).collect()
}

/// A body of revolution's monomial as a sum of monomials in (c, θ).
pub(crate) fn in_coordinates(exponents: &[u8; 6]) -> Vec<([u8; 6], f64)> {
    let monomial = |pairs: &[usize], sign: f64| {
        let mut e = [0; 6];
        pairs.iter().for_each(|&i| e[i] += 1);
        (e, [sign, 0.0])
    };
    let variables: [Complex; 6] = [
        alloc::vec![monomial(&[0], 1.0)],
        alloc::vec![monomial(&[1, 1], 1.0), monomial(&[2, 2], 1.0)],
        alloc::vec![monomial(&[4, 4], 1.0), monomial(&[5, 5], 1.0)],
        alloc::vec![monomial(&[3], 1.0)],
        alloc::vec![monomial(&[1, 4], 1.0), monomial(&[2, 5], 1.0)],
        alloc::vec![monomial(&[1, 5], 1.0), monomial(&[2, 4], -1.0)],
    ];
    let mut sum: Complex = alloc::vec![([0; 6], [1.0, 0.0])];
    for (variable, &power) in variables.iter().zip(exponents) {
        for _ in 0..power {
            sum = times(&sum, variable);
        }
    }
    sum.into_iter().map(|(e, value)| (e, value[0])).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn count(groups: &[Group], degree: usize) -> usize {
        group_terms(groups, degree).len()
    }

    #[test]
    fn groups_of_second_degree() {
        let names = |g| -> Vec<String> {
            let terms = group_terms(&[g], 2);
            terms.iter().map(GroupTerm::name).collect()
        };
        assert_eq!(names(Group::UnlikeEnds), ["Re C D*"]);
        assert_eq!(
            names(Group::Anisotropy),
            ["Re C^2", "Im C^2", "Re D^2", "Im D^2"]
        );
        assert_eq!(names(Group::Precurvature)[..2], ["Re D", "Im D"]);
        assert!(names(Group::Handedness).contains(&"Re c_x theta_x".to_string()));
    }

    #[test]
    fn groups_fill_up_what_symmetry_leaves() {
        // Unlike ends are the revolution's b terms; all m = 0 parities together are all invariants.
        let revolution = crate::energy::terms::terms(Symmetry::Revolution, 4)
            .unwrap()
            .len();
        let alike = crate::energy::terms::terms(Symmetry::Alike, 4)
            .unwrap()
            .len();
        assert_eq!(count(&[Group::UnlikeEnds], 4), revolution - alike);
        let both = count(&[Group::Precurvature, Group::FaceTilt], 4);
        assert_eq!(both, count(&[Group::FaceTilt], 4));
        assert!(count(&[Group::Precurvature], 4) < both);
    }
}
