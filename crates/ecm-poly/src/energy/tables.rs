//! Owned tables of an [`EnergyPlan`].

use alloc::vec::Vec;

use ecm_se3::Real;

use crate::energy::invariants::Symmetry;
use crate::energy::plan::{EnergyPlan, ROWS};
use crate::shape::ShapeError;

/// Most monomials of an energy: all of six variables up to degree 8 are 3003.
pub const LARGEST_MEMORY: usize = 4096;

/// Owned tables of an [`EnergyPlan`].
#[derive(Clone, Debug)]
pub struct EnergyTables<R> {
    symmetry: Symmetry,
    length_m: R,
    products: Vec<(u16, u8)>,
    ends: [u16; ROWS],
    columns: Vec<u16>,
    weights: Vec<R>,
}

impl<R: Real> EnergyTables<R> {
    /// From tables that fit together.
    ///
    /// # Errors
    /// More monomials than [`LARGEST_MEMORY`], or tables that do not fit together.
    pub(crate) fn of_parts(
        (symmetry, length_m): (Symmetry, R),
        products: Vec<(u16, u8)>,
        ends: [u16; ROWS],
        columns: Vec<u16>,
        weights: Vec<R>,
    ) -> Result<Self, ShapeError> {
        let tables = Self {
            symmetry,
            length_m,
            products,
            ends,
            columns,
            weights,
        };
        tables.plan::<LARGEST_MEMORY>()?;
        Ok(tables)
    }

    /// The tables, borrowed, with memory for `S` monomials: a power of two of at least
    /// [`EnergyTables::monomials`].
    ///
    /// # Errors
    /// Too small an `S`, or one that is no power of two.
    pub fn plan<const S: usize>(&self) -> Result<EnergyPlan<'_, R, S>, ShapeError> {
        EnergyPlan::new(
            self.symmetry,
            self.length_m,
            &self.products,
            self.ends,
            &self.columns,
            &self.weights,
        )
    }

    /// As [`EnergyTables::plan`] without its checks, for `S` of at least [`EnergyTables::monomials`].
    #[inline(always)]
    pub(crate) fn checked_plan<const S: usize>(&self) -> EnergyPlan<'_, R, S> {
        debug_assert!(S.is_power_of_two() && self.products.len() < S);
        EnergyPlan::of_checked(
            self.symmetry,
            self.length_m,
            &self.products,
            self.ends,
            &self.columns,
            &self.weights,
        )
    }

    /// Number of monomials, with the constant one.
    pub fn monomials(&self) -> usize {
        self.products.len() + 1
    }
    /// Symmetry, whose variables the monomials are products of.
    pub fn symmetry(&self) -> Symmetry {
        self.symmetry
    }
    /// Undeformed length (m).
    pub fn length_m(&self) -> R {
        self.length_m
    }
    /// Monomial t + 1 is monomial `.0` times variable `.1`.
    pub fn products(&self) -> &[(u16, u8)] {
        &self.products
    }
    /// End of the entries of each row.
    pub fn ends(&self) -> &[u16; ROWS] {
        &self.ends
    }
    /// Monomial of each entry.
    pub fn columns(&self) -> &[u16] {
        &self.columns
    }
    /// Weight of each entry (J and powers of 1/m).
    pub fn weights(&self) -> &[R] {
        &self.weights
    }
}
