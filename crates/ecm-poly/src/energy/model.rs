//! A fitted energy: its tables, their covariance, and evaluation of many poses.

use alloc::collections::BTreeMap;
use alloc::vec::Vec;

use ecm_se3::stiffness::StiffnessKind;
use ecm_se3::{Mat6, Pose, Real, Vec6, Wrench};

use crate::energy::bulk;
use crate::energy::evaluator::Evaluator;
use crate::energy::groups::{Group, GroupTerm, in_coordinates};
use crate::energy::invariants::Symmetry;
use crate::energy::regressor::{check_length, check_scale, regressor};
use crate::energy::tables::EnergyTables;
use crate::energy::terms::EnergyTerms;
use crate::error::{ModelError, check_count, check_finite, checked_poses};

/// U(q) = Σ β_t Π v_i^e_ti; h and K follow.
#[derive(Clone, Debug)]
pub struct EnergyModel {
    length_m: f64,
    scale: [f64; 2],
    terms: EnergyTerms,
    coefficients: Vec<f64>,
    covariance: Vec<f64>,
    rank: usize,
    condition_number: f64,
    residual_variance: f64,
    symmetric: Evaluator,
    /// The groups' part as monomials in (c, θ); `None` without groups.
    broken: Option<Broken>,
}

/// Monomials in (c, θ), their coefficients and their evaluation.
#[derive(Clone, Debug)]
struct Broken {
    exponents: Vec<[u8; 6]>,
    coefficients: Vec<f64>,
    evaluator: Evaluator,
}

/// Adds up equal monomials.
fn collected(monomials: impl Iterator<Item = ([u8; 6], f64)>) -> (Vec<[u8; 6]>, Vec<f64>) {
    let mut sums = BTreeMap::new();
    for (exponents, weight) in monomials {
        *sums.entry(exponents).or_insert(0.0) += weight;
    }
    sums.into_iter().unzip()
}

impl Broken {
    fn new(
        terms: &EnergyTerms,
        coefficients: &[f64],
        scale: [f64; 2],
        length_m: f64,
    ) -> Result<Option<Self>, ModelError> {
        if terms.broken().is_empty() {
            return Ok(None);
        }
        let weighted = terms.broken().iter().zip(coefficients);
        let (exponents, coefficients) = collected(
            weighted.flat_map(|(term, &c)| term.monomials.iter().map(move |m| (m.0, c * m.1))),
        );
        let whole = (Symmetry::General, terms.degree());
        let evaluator = Evaluator::new(whole, &exponents, &coefficients, scale, length_m)?;
        Ok(Some(Self {
            exponents,
            coefficients,
            evaluator,
        }))
    }
}

impl EnergyModel {
    /// From coefficients (J) in the order of [`EnergyTerms`], of coordinates divided by `scale`.
    pub fn from_coefficients(
        length_m: f64,
        degree: usize,
        symmetry: Symmetry,
        scale: [f64; 2],
        coefficients: &[f64],
    ) -> Result<Self, ModelError> {
        Self::with_groups(length_m, degree, symmetry, &[], scale, coefficients)
    }

    /// The same with the coefficients of the groups' terms after those of the symmetry.
    ///
    /// # Errors
    /// A length, scale or degree out of range, a group whose terms the symmetry has already, or
    /// another number of coefficients than [`EnergyTerms::count`].
    pub fn with_groups(
        length_m: f64,
        degree: usize,
        symmetry: Symmetry,
        groups: &[Group],
        scale: [f64; 2],
        coefficients: &[f64],
    ) -> Result<Self, ModelError> {
        let terms = EnergyTerms::new(symmetry, degree, groups)?;
        Self::of_terms(length_m, terms, scale, coefficients)
    }

    pub(crate) fn of_terms(
        length_m: f64,
        terms: EnergyTerms,
        scale: [f64; 2],
        coefficients: &[f64],
    ) -> Result<Self, ModelError> {
        check_length(length_m)?;
        check_scale(scale)?;
        check_count("coefficients", "numbers", coefficients.len(), terms.count())?;
        check_finite("coefficients", coefficients, 1)?;
        let symmetric = terms.symmetric();
        let (of_symmetry, of_groups) = coefficients.split_at(symmetric.len());
        let whole = (terms.symmetry(), terms.degree());
        Ok(Self {
            symmetric: Evaluator::new(whole, symmetric, of_symmetry, scale, length_m)?,
            broken: Broken::new(&terms, of_groups, scale, length_m)?,
            length_m,
            scale,
            covariance: alloc::vec![0.0; coefficients.len().pow(2)],
            rank: coefficients.len(),
            coefficients: coefficients.to_vec(),
            condition_number: f64::NAN,
            residual_variance: f64::NAN,
            terms,
        })
    }

    #[cfg(feature = "std")]
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

    /// The whole energy as one plan, for a controller; with groups all terms are expanded in (c, θ).
    ///
    /// # Errors
    /// More monomials than any memory of a plan holds, which no degree up to 8 has.
    pub fn tables<R: Real>(&self) -> Result<EnergyTables<R>, ModelError> {
        let (symmetry, exponents, coefficients) = self.written_out();
        let (scale, length_m) = (self.scale, self.length_m);
        Ok(EnergyTables::new(
            symmetry,
            &exponents,
            &coefficients,
            scale,
            length_m,
        )?)
    }

    /// Squares of the largest |c| (m) and |θ| (rad) that count as inside the training data.
    #[cfg(feature = "std")]
    pub(crate) fn reach_squared(&self) -> [f64; 2] {
        // Fits average repeated poses; the measured ones lie a little further out.
        let [length, angle] = self.scale.map(|largest| 1.01 * largest);
        [length, angle.min(core::f64::consts::PI)].map(|reach| reach * reach)
    }

    /// Symmetry, exponents and coefficients (J) of the whole energy.
    fn written_out(&self) -> (Symmetry, Vec<[u8; 6]>, Vec<f64>) {
        let own = || self.terms.symmetric().iter().zip(&self.coefficients);
        let Some(broken) = &self.broken else {
            let (exponents, coefficients) = own().map(|(e, &c)| (*e, c)).unzip();
            return (self.symmetry(), exponents, coefficients);
        };
        let symmetric = own().flat_map(|(e, &c)| {
            let monomials = in_coordinates(e).into_iter();
            monomials.map(move |(e, w)| (e, c * w))
        });
        let added = broken.exponents.iter().zip(&broken.coefficients);
        let (exponents, coefficients) = collected(symmetric.chain(added.map(|(e, &c)| (*e, c))));
        (Symmetry::General, exponents, coefficients)
    }

    /// U (J) of each pose.
    ///
    /// # Errors
    /// A number that is not finite, or a rotation beyond π, with its row.
    pub fn energy(&self, poses: &[Vec6<f64>]) -> Result<Vec<f64>, ModelError> {
        let poses = checked_poses("poses", poses)?;
        let mut energies = bulk::energies(&self.symmetric, &poses);
        if let Some(broken) = &self.broken {
            add(&mut energies, &bulk::energies(&broken.evaluator, &poses));
        }
        check_finite("the energy", &energies, 1)?;
        Ok(energies)
    }

    /// h of each pose (N, N m), on all cores; the same bytes on any number of them.
    ///
    /// # Errors
    /// As [`EnergyModel::energy`].
    pub fn predict(&self, poses: &[Vec6<f64>]) -> Result<Vec<Vec6<f64>>, ModelError> {
        let poses = checked_poses("poses", poses)?;
        let mut wrenches = bulk::wrenches(&self.symmetric, &poses);
        if let Some(broken) = &self.broken {
            let added = bulk::wrenches(&broken.evaluator, &poses);
            add(wrenches.as_flattened_mut(), added.as_flattened());
        }
        check_finite("the prediction", wrenches.as_flattened(), 6)?;
        Ok(wrenches)
    }

    /// The stiffness of each pose, on all cores.
    ///
    /// # Errors
    /// As [`EnergyModel::energy`].
    pub fn stiffness(
        &self,
        poses: &[Vec6<f64>],
        kind: StiffnessKind,
    ) -> Result<Vec<Mat6<f64>>, ModelError> {
        let poses = checked_poses("poses", poses)?;
        let mut stiffnesses = bulk::stiffnesses(&self.symmetric, &poses, kind);
        if let Some(broken) = &self.broken {
            // All three kinds are linear in U.
            let added = bulk::stiffnesses(&broken.evaluator, &poses, kind);
            let sums = stiffnesses.as_flattened_mut().as_flattened_mut();
            add(sums, added.as_flattened().as_flattened());
        }
        check_finite(
            "the stiffness",
            stiffnesses.as_flattened().as_flattened(),
            36,
        )?;
        Ok(stiffnesses)
    }

    /// h (N, N m) and K = ∂h/∂p of one pose, without allocation: for a controller.
    ///
    /// [`ecm_se3::stiffness::convert`] makes the other stiffnesses of K.
    ///
    /// ```
    /// use ecm_poly::{EnergyModel, Pose, Symmetry};
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// // A spring along the axis, U = 250 N/m c_x², among the five terms of degree 2.
    /// let coefficients = [0.0, 250.0, 0.0, 0.0, 0.0];
    /// let model = EnergyModel::from_coefficients(0.1, 2, Symmetry::Alike, [1.0, 1.0], &coefficients)?;
    /// let pose = Pose::from_array(&[0.102, 0.0, 0.0, 0.0, 0.0, 0.0])?;
    /// let (h, k) = model.wrench_and_stiffness(&pose);
    /// assert!((h.force[0] - 1.0).abs() < 1e-12 && (k[0][0] - 500.0).abs() < 1e-9);
    /// # Ok(()) }
    /// ```
    #[inline]
    pub fn wrench_and_stiffness(&self, pose: &Pose<f64>) -> (Wrench<f64>, Mat6<f64>) {
        let kind = StiffnessKind::Partial;
        let (mut wrench, mut stiffness) = bulk::one(&self.symmetric, pose, kind);
        if let Some(broken) = &self.broken {
            let (h, k) = bulk::one(&broken.evaluator, pose, kind);
            add(&mut wrench.force, &h.force);
            add(&mut wrench.torque, &h.torque);
            add(stiffness.as_flattened_mut(), k.as_flattened());
        }
        (wrench, stiffness)
    }

    /// Φ (6 N, k), row-major: h = Φ β.
    pub fn regressor(&self, poses: &[Vec6<f64>]) -> Result<Vec<f64>, ModelError> {
        regressor(poses, self.length_m, &self.terms, self.scale)
    }

    /// Its terms, one for each coefficient.
    pub fn terms(&self) -> &EnergyTerms {
        &self.terms
    }
    /// Groups of terms that break the symmetry.
    pub fn groups(&self) -> &[Group] {
        self.terms.groups()
    }
    /// Their terms, whose coefficients follow those of the symmetry.
    pub fn group_terms(&self) -> &[GroupTerm] {
        self.terms.broken()
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
        self.terms.symmetric()
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
        self.terms.degree()
    }
    /// Symmetry of the mechanism.
    pub fn symmetry(&self) -> Symmetry {
        self.terms.symmetry()
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
