//! Monomials of an energy by symmetry and degree, and their names.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use crate::basis::advance;
use crate::energy::groups::{Group, GroupTerm, group_terms};
use crate::energy::invariants::Symmetry;
use crate::error::ModelError;

/// Highest degree in q of an energy.
pub const MAX_DEGREE: usize = 8;

/// The terms of an energy: those of its symmetry, then those of the groups that break it.
///
/// No term is there twice, so that each coefficient has one meaning.
#[derive(Clone, Debug, PartialEq)]
pub struct EnergyTerms {
    symmetry: Symmetry,
    degree: usize,
    groups: Vec<Group>,
    symmetric: Vec<[u8; 6]>,
    broken: Vec<GroupTerm>,
}

impl EnergyTerms {
    /// All terms up to `degree` in q, those of groups up to degree 4.
    ///
    /// # Errors
    /// A degree out of 1 to 8, or a group whose terms the symmetry has already.
    ///
    /// ```
    /// use ecm_poly::Symmetry;
    /// use ecm_poly::energy::{EnergyTerms, Group};
    /// # fn main() -> Result<(), ecm_poly::ModelError> {
    /// let terms = EnergyTerms::new(Symmetry::Alike, 4, &[Group::UnlikeEnds])?;
    /// assert_eq!(terms.count(), 22 + 6);
    /// assert!(EnergyTerms::new(Symmetry::General, 4, &[Group::UnlikeEnds]).is_err());
    /// # Ok(()) }
    /// ```
    pub fn new(symmetry: Symmetry, degree: usize, groups: &[Group]) -> Result<Self, ModelError> {
        let groups = Group::in_order(groups, symmetry)?;
        Ok(Self {
            symmetry,
            degree,
            symmetric: terms(symmetry, degree)?,
            broken: group_terms(&groups, degree),
            groups,
        })
    }

    /// Number of terms, and of coefficients.
    pub fn count(&self) -> usize {
        self.symmetric.len() + self.broken.len()
    }
    /// Symmetry of the mechanism.
    pub fn symmetry(&self) -> Symmetry {
        self.symmetry
    }
    /// Highest degree in q.
    pub fn degree(&self) -> usize {
        self.degree
    }
    /// Groups that break the symmetry, in a fixed order.
    pub fn groups(&self) -> &[Group] {
        &self.groups
    }
    /// Exponents of the six variables of [`Symmetry::variable_names`].
    pub fn symmetric(&self) -> &[[u8; 6]] {
        &self.symmetric
    }
    /// Terms of the groups.
    pub fn broken(&self) -> &[GroupTerm] {
        &self.broken
    }
}

/// Exponents of the six variables, by degree in q, then in the order of the paper's eq. (4).
///
/// Without the constant, which has no wrench. The linear term c_x of a body of revolution is
/// included: a true length slightly different from L causes a force at the rest pose.
pub fn terms(symmetry: Symmetry, degree: usize) -> Result<Vec<[u8; 6]>, ModelError> {
    if !(1..=MAX_DEGREE).contains(&degree) {
        return Err(ModelError::Setting {
            name: "degree",
            found: format!("{degree}"),
            expected: "a degree from 1 to 8",
        });
    }
    let of_variable = symmetry.variable_degrees();
    let in_q = |row: &[u8; 6]| -> usize {
        row.iter()
            .zip(of_variable)
            .map(|(&e, d)| usize::from(e) * usize::from(d))
            .sum()
    };
    let mut rows = Vec::new();
    let mut current = [0_u8; 6];
    advance(&mut current);
    while current.iter().map(|&e| usize::from(e)).sum::<usize>() <= degree {
        if in_q(&current) <= degree && symmetry.admits(&current) {
            rows.push(current);
        }
        advance(&mut current);
    }
    rows.sort_by(|a, b| in_q(a).cmp(&in_q(b)).then(b.cmp(a)));
    Ok(rows)
}

/// A term's name, like `c_x^2 |c_perp|^2`.
pub fn term_name(symmetry: Symmetry, exponents: &[u8; 6]) -> String {
    let mut name = String::new();
    for (variable, &e) in symmetry.variable_names().iter().zip(exponents) {
        if e == 0 {
            continue;
        }
        if !name.is_empty() {
            name.push(' ');
        }
        if e == 1 {
            name.push_str(variable);
        } else if variable.contains('^') {
            name.push_str(&format!("({variable})^{e}"));
        } else {
            name.push_str(&format!("{variable}^{e}"));
        }
    }
    name
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn counts_of_the_conventions() {
        let count = |s, d| terms(s, d).unwrap().len();
        let counts = |s| [count(s, 4), count(s, 5), count(s, 6)];
        assert_eq!(counts(Symmetry::Alike), [22, 37, 65]);
        assert_eq!(counts(Symmetry::Revolution), [28, 48, 88]);
        assert_eq!(count(Symmetry::General, 4), 209);
        assert_eq!(count(Symmetry::General, 6), 923);
    }

    #[test]
    fn order_and_names_of_the_first_terms() {
        let names = |s: Symmetry| -> Vec<String> {
            terms(s, 2)
                .unwrap()
                .iter()
                .map(|t| term_name(s, t))
                .collect()
        };
        assert_eq!(
            names(Symmetry::Alike),
            ["c_x", "c_x^2", "|c_perp|^2", "|theta_perp|^2", "theta_x^2"]
        );
        assert_eq!(names(Symmetry::Revolution)[5], "b");
        assert_eq!(
            names(Symmetry::General)[..8].join(", "),
            "c_x, c_y, c_z, theta_x, theta_y, theta_z, c_x^2, c_x c_y"
        );
        assert!(terms(Symmetry::Alike, 0).is_err() && terms(Symmetry::Alike, 9).is_err());
    }
}
