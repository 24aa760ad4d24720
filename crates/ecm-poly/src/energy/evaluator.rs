//! The fastest evaluation of one energy: by SIMD for a body of revolution of degree 4 to 8, by the
//! sparse sums of its plan otherwise.

use alloc::vec::Vec;

use ecm_se3::stiffness::StiffnessKind;
use ecm_se3::{Mat6, Pose, Wrench};

use crate::arithmetic::Arithmetic;
use crate::energy::expansion::Monomial;
use crate::energy::invariants::Symmetry;
use crate::energy::plan::EnergyPlan;
use crate::energy::simd::SimdPlan;
use crate::energy::simd_tables::SimdTables;
use crate::energy::tables::{EnergyTables, LARGEST_MEMORY};
use crate::shape::ShapeError;

/// Energy, wrench and stiffness at a pose.
pub(crate) trait Evaluate: Copy + Sync {
    fn energy<A: Arithmetic<f64>>(&self, pose: &Pose<f64>) -> f64;
    fn wrench<A: Arithmetic<f64>>(&self, pose: &Pose<f64>) -> Wrench<f64>;
    fn wrench_and_stiffness<A: Arithmetic<f64>>(
        &self,
        pose: &Pose<f64>,
        kind: StiffnessKind,
    ) -> (Wrench<f64>, Mat6<f64>);
}

macro_rules! evaluate {
    ($($plan:ident),*) => {$(
        impl<const N: usize> Evaluate for $plan<'_, f64, N> {
            #[inline(always)]
            fn energy<A: Arithmetic<f64>>(&self, pose: &Pose<f64>) -> f64 {
                self.energy::<A>(pose)
            }
            #[inline(always)]
            fn wrench<A: Arithmetic<f64>>(&self, pose: &Pose<f64>) -> Wrench<f64> {
                self.wrench::<A>(pose)
            }
            #[inline(always)]
            fn wrench_and_stiffness<A: Arithmetic<f64>>(
                &self,
                pose: &Pose<f64>,
                kind: StiffnessKind,
            ) -> (Wrench<f64>, Mat6<f64>) {
                self.wrench_and_stiffness::<A>(pose, kind)
            }
        }
    )*};
}
evaluate!(EnergyPlan, SimdPlan);

/// Work with an evaluation.
pub(crate) trait Work {
    type Output;
    fn with<E: Evaluate>(self, evaluation: E) -> Self::Output;
}

/// Tables of the fastest evaluation.
#[derive(Clone, Debug)]
pub(crate) struct Evaluator {
    tables: EnergyTables<f64>,
    simd: Option<Simd>,
}

#[derive(Clone, Debug)]
enum Simd {
    Narrow(SimdTables<f64, 8>),
    Wide(SimdTables<f64, 16>),
}

impl Evaluator {
    /// From exponents of the variables and coefficients (J) of coordinates divided by `scale`.
    pub(crate) fn new(
        (symmetry, degree): (Symmetry, usize),
        exponents: &[Monomial],
        coefficients: &[f64],
        scale: [f64; 2],
        length_m: f64,
    ) -> Result<Self, ShapeError> {
        // Of an energy beside a product of inputs symmetry leaves a few of all terms.
        let all = exponents.iter().zip(coefficients);
        let (some, weights): (Vec<_>, Vec<_>) = all.filter(|(_, c)| **c != 0.0).unzip();
        let narrow = || {
            SimdTables::new(symmetry, degree, exponents, coefficients, scale, length_m)
                .map(Simd::Narrow)
        };
        let wide = || {
            SimdTables::new(symmetry, degree, exponents, coefficients, scale, length_m)
                .map(Simd::Wide)
        };
        Ok(Self {
            tables: EnergyTables::new(symmetry, &some, &weights, scale, length_m)?,
            simd: narrow().or_else(wide),
        })
    }

    /// Does `work` with the fastest evaluation.
    #[inline]
    pub(crate) fn run<W: Work>(&self, work: W) -> W::Output {
        match &self.simd {
            Some(Simd::Narrow(tables)) => work.with(tables.plan()),
            Some(Simd::Wide(tables)) => work.with(tables.plan()),
            None => self.run_plan(work),
        }
    }

    /// Does `work` with the plan, in the smallest memory that holds its monomials.
    fn run_plan<W: Work>(&self, work: W) -> W::Output {
        match self.tables.monomials() {
            0..=128 => work.with(self.tables.checked_plan::<128>()),
            129..=256 => work.with(self.tables.checked_plan::<256>()),
            257..=1024 => work.with(self.tables.checked_plan::<1024>()),
            _ => work.with(self.tables.checked_plan::<LARGEST_MEMORY>()),
        }
    }
}
