//! Owned tables of an [`EnergyPlan`], and their binary form.

use alloc::vec::Vec;

use ecm_se3::Real;

use crate::energy::binary::{BinaryError, Parts, crc32, head};
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

    /// The binary form ([`crate::energy::binary`]); `reach_squared`: squares of the largest |c| (m)
    /// and |θ| (rad) of the training data.
    pub fn to_bytes(&self, reach_squared: [f64; 2]) -> Vec<u8> {
        let single = size_of::<R>() == 4;
        let counts = [self.products.len() as u16, self.columns.len() as u16];
        let length_m = self.length_m.to_f64();
        let mut bytes = head(single, self.symmetry, length_m, reach_squared, counts).to_vec();
        for (monomial, variable) in &self.products {
            bytes.extend(monomial.to_le_bytes());
            bytes.push(*variable);
        }
        bytes.extend(self.ends.iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend(self.columns.iter().flat_map(|x| x.to_le_bytes()));
        for weight in &self.weights {
            if single {
                bytes.extend((weight.to_f64() as f32).to_le_bytes());
            } else {
                bytes.extend(weight.to_f64().to_le_bytes());
            }
        }
        let sum = crc32(&bytes);
        bytes.extend(sum.to_le_bytes());
        bytes
    }

    /// From the bytes of [`EnergyTables::to_bytes`].
    ///
    /// # Errors
    /// As `EnergyMemory::from_bytes`.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, BinaryError> {
        let parts = Parts::new(bytes)?;
        let length_m = R::from_f64(parts.length_m);
        let weights: Vec<R> = parts.weights().collect();
        if !weights.iter().chain([&length_m]).all(|x| x.is_finite()) || length_m <= R::ZERO {
            return Err(BinaryError::Number);
        }
        Self::of_parts(
            (parts.symmetry, length_m),
            parts.products().collect(),
            parts.ends(),
            parts.columns().collect(),
            weights,
        )
        .map_err(BinaryError::Tables)
    }
}
