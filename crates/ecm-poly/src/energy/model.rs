//! A fitted energy: its tables, their covariance, and evaluation of many poses.

use std::vec::Vec;

use ecm_se3::stiffness::StiffnessKind;
use ecm_se3::{Mat6, Pose, Vec6};

use crate::energy::bulk;
use crate::energy::fit::{check_length, check_scale, regressor};
use crate::energy::invariants::Symmetry;
use crate::energy::mid_frame::EnergyMap;
use crate::energy::tables::{EnergyTables, LaneTables};
use crate::energy::terms::terms;
use crate::error::{ModelError, check_count, check_finite};

/// U(q) = Σ β_t Π v_i^e_ti; h and K follow.
#[derive(Clone, Debug)]
pub struct EnergyModel {
    length_m: f64,
    degree: usize,
    symmetry: Symmetry,
    scale: [f64; 2],
    exponents: Vec<[u8; 6]>,
    coefficients: Vec<f64>,
    covariance: Vec<f64>,
    rank: usize,
    condition_number: f64,
    residual_variance: f64,
    tables: EnergyTables<f64>,
    /// The same energy in eight or sixteen lanes, where it has a body of revolution's degrees.
    narrow: Option<LaneTables<f64, 8>>,
    wide: Option<LaneTables<f64, 16>>,
}

impl EnergyModel {
    /// From coefficients (J) in the order of [`terms`], of coordinates divided by `scale`.
    pub fn from_coefficients(
        length_m: f64,
        degree: usize,
        symmetry: Symmetry,
        scale: [f64; 2],
        coefficients: &[f64],
    ) -> Result<Self, ModelError> {
        check_length(length_m)?;
        check_scale(scale)?;
        let exponents = terms(symmetry, degree)?;
        check_count(
            "coefficients",
            "numbers",
            coefficients.len(),
            exponents.len(),
        )?;
        check_finite("coefficients", coefficients, 1)?;
        let tables = EnergyTables::new(symmetry, &exponents, coefficients, scale, length_m);
        Ok(Self {
            tables,
            narrow: LaneTables::new(symmetry, &exponents, coefficients, scale, length_m),
            wide: LaneTables::new(symmetry, &exponents, coefficients, scale, length_m),
            length_m,
            degree,
            symmetry,
            scale,
            covariance: std::vec![0.0; coefficients.len().pow(2)],
            rank: exponents.len(),
            exponents,
            coefficients: coefficients.to_vec(),
            condition_number: f64::NAN,
            residual_variance: f64::NAN,
        })
    }

    pub(crate) fn set_fit(
        &mut self,
        covariance: Vec<f64>,
        rank: usize,
        condition_number: f64,
        residual_variance: f64,
    ) {
        self.covariance = covariance;
        self.rank = rank;
        self.condition_number = condition_number;
        self.residual_variance = residual_variance;
    }

    /// The evaluation tables.
    pub fn map(&self) -> Result<EnergyMap<'_, f64>, ModelError> {
        Ok(EnergyMap::new(
            self.symmetry,
            &self.exponents,
            &self.coefficients,
            self.scale,
            self.length_m,
        )?)
    }

    /// The tables of fast evaluation, for an export.
    pub fn tables(&self) -> &EnergyTables<f64> {
        &self.tables
    }

    /// U (J) of each pose.
    pub fn energy(&self, poses: &[Vec6<f64>]) -> Result<Vec<f64>, ModelError> {
        check_finite("poses", poses.as_flattened(), 6)?;
        let map = self.map()?;
        let energies = poses.iter().map(|p| map.energy(&Pose::from_array(p)));
        Ok(energies.collect())
    }

    /// h of each pose.
    pub fn predict(&self, poses: &[Vec6<f64>]) -> Result<Vec<Vec6<f64>>, ModelError> {
        check_finite("poses", poses.as_flattened(), 6)?;
        match (&self.narrow, &self.wide) {
            (Some(lanes), _) => Ok(bulk::wrenches_in_lanes(lanes.plan(), poses)),
            (None, Some(lanes)) => Ok(bulk::wrenches_in_lanes(lanes.plan(), poses)),
            (None, None) => bulk::wrenches(self.tables.plan(), poses),
        }
    }

    /// The stiffness of each pose.
    pub fn stiffness(
        &self,
        poses: &[Vec6<f64>],
        kind: StiffnessKind,
    ) -> Result<Vec<Mat6<f64>>, ModelError> {
        check_finite("poses", poses.as_flattened(), 6)?;
        match (&self.narrow, &self.wide) {
            (Some(lanes), _) => Ok(bulk::stiffnesses_in_lanes(lanes.plan(), poses, kind)),
            (None, Some(lanes)) => Ok(bulk::stiffnesses_in_lanes(lanes.plan(), poses, kind)),
            (None, None) => bulk::stiffnesses(self.tables.plan(), poses, kind),
        }
    }

    /// Φ (6 N, k), row-major: h = Φ β.
    pub fn regressor(&self, poses: &[Vec6<f64>]) -> Result<Vec<f64>, ModelError> {
        regressor(
            poses,
            self.length_m,
            self.symmetry,
            &self.exponents,
            self.scale,
        )
    }

    /// Coefficients (J), in the order of [`EnergyModel::exponents`].
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }
    /// Covariance of the coefficients (J²), row-major (k, k); zero where it was not fitted.
    pub fn covariance(&self) -> &[f64] {
        &self.covariance
    }
    /// Exponents of the six variables of [`Symmetry::variable_names`].
    pub fn exponents(&self) -> &[[u8; 6]] {
        &self.exponents
    }
    /// Length (m) and angle (rad) that make the coordinates dimensionless.
    pub fn scale(&self) -> [f64; 2] {
        self.scale
    }
    /// Undeformed length of the mechanism (m).
    pub fn length_m(&self) -> f64 {
        self.length_m
    }
    /// Highest degree in q.
    pub fn degree(&self) -> usize {
        self.degree
    }
    /// What the mechanism's shape leaves unchanged.
    pub fn symmetry(&self) -> Symmetry {
        self.symmetry
    }
    /// Singular values used by the fit.
    pub fn rank(&self) -> usize {
        self.rank
    }
    /// κ of the whitened, column-scaled regressor; NaN where it was not fitted.
    pub fn condition_number(&self) -> f64 {
        self.condition_number
    }
    /// Whitened residual square per degree of freedom; 1 where the covariance tells the truth.
    pub fn residual_variance(&self) -> f64 {
        self.residual_variance
    }
}
