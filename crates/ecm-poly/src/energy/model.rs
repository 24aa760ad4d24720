//! A fitted energy: its tables, their covariance, and evaluation of many poses.

use std::collections::BTreeMap;
use std::vec::Vec;

use ecm_se3::stiffness::StiffnessKind;
use ecm_se3::{Mat6, Pose, Vec6};

use crate::energy::bulk;
use crate::energy::groups::{Group, GroupTerm, group_terms, in_coordinates};
use crate::energy::invariants::Symmetry;
use crate::energy::mid_frame::EnergyMap;
use crate::energy::regressor::{check_length, check_scale, regressor};
use crate::energy::tables::{EnergyTables, SimdTables};
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
    groups: Vec<Group>,
    broken: Vec<GroupTerm>,
    /// The groups' part as monomials in (c, θ); `None` without groups.
    extra: Option<Broken>,
    tables: EnergyTables<f64>,
    /// The same energy for SIMD with eight or sixteen lanes, for a body of revolution of degree 4 to 6.
    narrow: Option<SimdTables<f64, 8>>,
    wide: Option<SimdTables<f64, 16>>,
}

/// Monomials in (c, θ), their coefficients and the tables of fast evaluation.
#[derive(Clone, Debug)]
struct Broken {
    exponents: Vec<[u8; 6]>,
    coefficients: Vec<f64>,
    tables: EnergyTables<f64>,
}

/// Adds up equal monomials.
fn collected(monomials: impl Iterator<Item = ([u8; 6], f64)>) -> (Vec<[u8; 6]>, Vec<f64>) {
    let mut sums = BTreeMap::new();
    for (exponents, weight) in monomials {
        *sums.entry(exponents).or_insert(0.0) += weight;
    }
    sums.into_iter().unzip()
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
        Self::with_groups(length_m, degree, symmetry, &[], scale, coefficients)
    }

    /// The same with the coefficients of [`group_terms`] after those of the symmetry.
    pub fn with_groups(
        length_m: f64,
        degree: usize,
        symmetry: Symmetry,
        groups: &[Group],
        scale: [f64; 2],
        all_coefficients: &[f64],
    ) -> Result<Self, ModelError> {
        check_length(length_m)?;
        check_scale(scale)?;
        let exponents = terms(symmetry, degree)?;
        let broken = group_terms(groups, degree);
        check_count(
            "coefficients",
            "numbers",
            all_coefficients.len(),
            exponents.len() + broken.len(),
        )?;
        check_finite("coefficients", all_coefficients, 1)?;
        let (coefficients, of_groups) = all_coefficients.split_at(exponents.len());
        let extra = (!broken.is_empty()).then(|| {
            let weighted = broken.iter().zip(of_groups);
            let (exponents, coefficients) = collected(
                weighted.flat_map(|(term, &c)| term.monomials.iter().map(move |m| (m.0, c * m.1))),
            );
            let general = Symmetry::General;
            let tables = EnergyTables::new(general, &exponents, &coefficients, scale, length_m);
            Broken {
                exponents,
                coefficients,
                tables,
            }
        });
        let tables = EnergyTables::new(symmetry, &exponents, coefficients, scale, length_m);
        Ok(Self {
            tables,
            narrow: SimdTables::new(symmetry, &exponents, coefficients, scale, length_m),
            wide: SimdTables::new(symmetry, &exponents, coefficients, scale, length_m),
            length_m,
            degree,
            symmetry,
            scale,
            covariance: std::vec![0.0; all_coefficients.len().pow(2)],
            rank: all_coefficients.len(),
            exponents,
            coefficients: all_coefficients.to_vec(),
            groups: groups.to_vec(),
            broken,
            extra,
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

    /// The symmetric part, term by term.
    pub fn map(&self) -> Result<EnergyMap<'_, f64>, ModelError> {
        Ok(EnergyMap::new(
            self.symmetry,
            &self.exponents,
            &self.coefficients[..self.exponents.len()],
            self.scale,
            self.length_m,
        )?)
    }

    /// Symmetry, exponents and coefficients (J) of one energy, for an export.
    ///
    /// With groups all terms are expanded in (c, θ).
    pub fn written_out(&self) -> (Symmetry, Vec<[u8; 6]>, Vec<f64>) {
        let own = || self.exponents.iter().zip(&self.coefficients);
        let Some(extra) = &self.extra else {
            let (exponents, coefficients) = own().map(|(e, &c)| (*e, c)).unzip();
            return (self.symmetry, exponents, coefficients);
        };
        let symmetric = own().flat_map(|(e, &c)| {
            let monomials = in_coordinates(e).into_iter();
            monomials.map(move |(e, w)| (e, c * w))
        });
        let broken = extra.exponents.iter().zip(&extra.coefficients);
        let (exponents, coefficients) = collected(symmetric.chain(broken.map(|(e, &c)| (*e, c))));
        (Symmetry::General, exponents, coefficients)
    }

    /// U (J) of each pose.
    pub fn energy(&self, poses: &[Vec6<f64>]) -> Result<Vec<f64>, ModelError> {
        check_finite("poses", poses.as_flattened(), 6)?;
        let map = self.map()?;
        let energies = poses.iter().map(|p| map.energy(&Pose::from_array(p)));
        let mut energies: Vec<f64> = energies.collect();
        if let Some(extra) = &self.extra {
            let general = Symmetry::General;
            let (exponents, coefficients) = (&extra.exponents, &extra.coefficients);
            let scale = self.scale;
            let map = EnergyMap::new(general, exponents, coefficients, scale, self.length_m)?;
            for (energy, pose) in energies.iter_mut().zip(poses) {
                *energy += map.energy(&Pose::from_array(pose));
            }
        }
        check_finite("the energy", &energies, 1)?;
        Ok(energies)
    }

    /// h of each pose.
    pub fn predict(&self, poses: &[Vec6<f64>]) -> Result<Vec<Vec6<f64>>, ModelError> {
        check_finite("poses", poses.as_flattened(), 6)?;
        let mut wrenches = match (&self.narrow, &self.wide) {
            (Some(simd), _) => bulk::simd_wrenches(simd.plan(), poses),
            (None, Some(simd)) => bulk::simd_wrenches(simd.plan(), poses),
            (None, None) => bulk::wrenches(self.tables.plan(), poses)?,
        };
        if let Some(extra) = &self.extra {
            let added = bulk::wrenches(extra.tables.plan(), poses)?;
            add(wrenches.as_flattened_mut(), added.as_flattened());
        }
        check_finite("the prediction", wrenches.as_flattened(), 6)?;
        Ok(wrenches)
    }

    /// The stiffness of each pose.
    pub fn stiffness(
        &self,
        poses: &[Vec6<f64>],
        kind: StiffnessKind,
    ) -> Result<Vec<Mat6<f64>>, ModelError> {
        check_finite("poses", poses.as_flattened(), 6)?;
        let mut stiffnesses = match (&self.narrow, &self.wide) {
            (Some(simd), _) => bulk::simd_stiffnesses(simd.plan(), poses, kind),
            (None, Some(simd)) => bulk::simd_stiffnesses(simd.plan(), poses, kind),
            (None, None) => bulk::stiffnesses(self.tables.plan(), poses, kind)?,
        };
        if let Some(extra) = &self.extra {
            // All three kinds are linear in U.
            let added = bulk::stiffnesses(extra.tables.plan(), poses, kind)?;
            let sums = stiffnesses.as_flattened_mut().as_flattened_mut();
            add(sums, added.as_flattened().as_flattened());
        }
        check_finite("the stiffness", stiffnesses.as_flattened().as_flattened(), 36)?;
        Ok(stiffnesses)
    }

    /// Φ (6 N, k), row-major: h = Φ β.
    pub fn regressor(&self, poses: &[Vec6<f64>]) -> Result<Vec<f64>, ModelError> {
        regressor(
            poses,
            self.length_m,
            self.symmetry,
            (&self.exponents, &self.broken),
            self.scale,
        )
    }

    /// Groups of terms that break the symmetry.
    pub fn groups(&self) -> &[Group] {
        &self.groups
    }
    /// Their terms, whose coefficients follow those of the symmetry.
    pub fn group_terms(&self) -> &[GroupTerm] {
        &self.broken
    }

    /// Coefficients (J), in the order of [`EnergyModel::exponents`], then of the group terms.
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
    /// Symmetry of the mechanism.
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
    /// Whitened squared residual per degree of freedom; 1 where the given covariance is right.
    pub fn residual_variance(&self) -> f64 {
        self.residual_variance
    }
}

fn add(sums: &mut [f64], values: &[f64]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += value;
    }
}
