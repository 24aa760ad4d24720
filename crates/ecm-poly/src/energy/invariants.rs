//! The variables that an energy is a polynomial in, and their derivatives in q.
//!
//! The energy of a body of revolution about x depends on c and θ only through c_x, |c⊥|², |θ⊥|², θ_x,
//! a = c⊥·θ⊥ and b = c_y θ_z − c_z θ_y. A mirror plane through the axis turns the signs of
//! θ_x and a, so their joint power is even; for equal ends b changes its sign as well.

use ecm_se3::{Mat6, Real, Vec6};

/// Symmetry of the shape and material of a mechanism.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Symmetry {
    /// Body of revolution with equal ends: even joint powers of θ_x and a, no b.
    Alike,
    /// Body of revolution: the terms of `Alike`, and the same with one factor b.
    Revolution,
    /// No symmetry: all monomials in (c, θ).
    General,
}

impl Symmetry {
    /// Degree in q of each of the six variables.
    pub fn variable_degrees(self) -> [u8; 6] {
        match self {
            Symmetry::General => [1; 6],
            Symmetry::Alike | Symmetry::Revolution => [1, 2, 2, 1, 2, 2],
        }
    }

    /// Number of lengths and of angles in each of the six variables.
    pub fn lengths_and_angles(self) -> [(u8, u8); 6] {
        match self {
            Symmetry::General => [(1, 0), (1, 0), (1, 0), (0, 1), (0, 1), (0, 1)],
            Symmetry::Alike | Symmetry::Revolution => {
                [(1, 0), (2, 0), (0, 2), (0, 1), (1, 1), (1, 1)]
            }
        }
    }

    /// Names of the six variables.
    pub fn variable_names(self) -> [&'static str; 6] {
        match self {
            Symmetry::General => ["c_x", "c_y", "c_z", "theta_x", "theta_y", "theta_z"],
            Symmetry::Alike | Symmetry::Revolution => {
                ["c_x", "|c_perp|^2", "|theta_perp|^2", "theta_x", "a", "b"]
            }
        }
    }

    /// Whether a monomial of the six variables has this symmetry.
    pub fn admits(self, exponents: &[u8; 6]) -> bool {
        let [_, _, _, theta_x, a, b] = *exponents;
        match self {
            Symmetry::General => true,
            Symmetry::Alike => theta_x % 2 == a % 2 && b == 0,
            // b² = |c⊥|² |θ⊥|² − a², so one factor b is enough.
            Symmetry::Revolution => theta_x % 2 == a % 2 && b <= 1,
        }
    }

    /// The name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Symmetry::Alike => "alike",
            Symmetry::Revolution => "revolution",
            Symmetry::General => "general",
        }
    }

    /// The symmetry of a name; `None` for an unknown one.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Alike, Self::Revolution, Self::General]
            .into_iter()
            .find(|s| s.name() == name)
    }

    /// The six variables of dimensionless coordinates q.
    #[inline(always)]
    pub fn variables<R: Real>(self, q: &Vec6<R>) -> Vec6<R> {
        match self {
            Symmetry::General => *q,
            Symmetry::Alike | Symmetry::Revolution => [
                q[0],
                q[1] * q[1] + q[2] * q[2],
                q[4] * q[4] + q[5] * q[5],
                q[3],
                q[1] * q[4] + q[2] * q[5],
                q[1] * q[5] - q[2] * q[4],
            ],
        }
    }

    /// ∂U/∂q from ∂U/∂v.
    #[inline(always)]
    pub fn gradient<R: Real>(self, q: &Vec6<R>, first: &Vec6<R>) -> Vec6<R> {
        match self {
            Symmetry::General => *first,
            Symmetry::Alike | Symmetry::Revolution => {
                let [x, p, t, theta_x, a, b] = *first;
                let (p2, t2) = (R::TWO * p, R::TWO * t);
                [
                    x,
                    p2 * q[1] + a * q[4] + b * q[5],
                    p2 * q[2] + a * q[5] - b * q[4],
                    theta_x,
                    t2 * q[4] + a * q[1] - b * q[2],
                    t2 * q[5] + a * q[2] + b * q[1],
                ]
            }
        }
    }

    /// ∂²U/∂q² from ∂U/∂v and ∂²U/∂v².
    #[inline(always)]
    pub fn hessian<R: Real>(self, q: &Vec6<R>, first: &Vec6<R>, second: &Mat6<R>) -> Mat6<R> {
        if self == Symmetry::General {
            return *second;
        }
        // Column j of ∂²U/∂v² chained once, then the rows; both by the rule of `gradient`.
        let mut half = [[R::ZERO; 6]; 6];
        for i in 0..6 {
            half[i] = self.gradient(q, &second[i]);
        }
        let mut h = [[R::ZERO; 6]; 6];
        for j in 0..6 {
            let column = core::array::from_fn(|i| half[i][j]);
            let chained = self.gradient(q, &column);
            for i in 0..=j {
                h[i][j] = chained[i];
            }
        }
        let [_, p, t, _, a, b] = *first;
        h[1][1] += R::TWO * p;
        h[2][2] += R::TWO * p;
        h[4][4] += R::TWO * t;
        h[5][5] += R::TWO * t;
        h[1][4] += a;
        h[2][5] += a;
        h[1][5] += b;
        h[2][4] -= b;
        for j in 0..6 {
            for i in 0..j {
                h[j][i] = h[i][j];
            }
        }
        h
    }
}
