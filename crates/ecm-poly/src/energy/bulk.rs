//! Evaluation of one pose or many, with the SIMD instructions of this machine and on all its cores.

use std::vec::Vec;

use ecm_se3::stiffness::StiffnessKind;
use ecm_se3::{Mat6, Pose, Vec6, Wrench};

use crate::arithmetic::{Arithmetic, Task, dispatch};
use crate::energy::evaluator::{Evaluate, Evaluator, Work};
use crate::parallel::fill;

/// What is computed at a pose.
trait Quantity: Copy + Send + Sync {
    type Value: Copy + Send;
    const ZERO: Self::Value;
    fn of<E: Evaluate, A: Arithmetic<f64>>(self, evaluation: &E, pose: &Pose<f64>) -> Self::Value;
}

#[derive(Clone, Copy)]
struct Energy;

impl Quantity for Energy {
    type Value = f64;
    const ZERO: f64 = 0.0;
    #[inline(always)]
    fn of<E: Evaluate, A: Arithmetic<f64>>(self, evaluation: &E, pose: &Pose<f64>) -> f64 {
        evaluation.energy::<A>(pose)
    }
}

#[derive(Clone, Copy)]
struct OnlyWrench;

impl Quantity for OnlyWrench {
    type Value = Vec6<f64>;
    const ZERO: Vec6<f64> = [0.0; 6];
    #[inline(always)]
    fn of<E: Evaluate, A: Arithmetic<f64>>(self, evaluation: &E, pose: &Pose<f64>) -> Vec6<f64> {
        evaluation.wrench::<A>(pose).to_array()
    }
}

#[derive(Clone, Copy)]
struct Stiffness(StiffnessKind);

impl Quantity for Stiffness {
    type Value = Mat6<f64>;
    const ZERO: Mat6<f64> = [[0.0; 6]; 6];
    #[inline(always)]
    fn of<E: Evaluate, A: Arithmetic<f64>>(self, evaluation: &E, pose: &Pose<f64>) -> Mat6<f64> {
        evaluation.wrench_and_stiffness::<A>(pose, self.0).1
    }
}

#[derive(Clone, Copy)]
struct Both(StiffnessKind);

impl Quantity for Both {
    type Value = (Wrench<f64>, Mat6<f64>);
    const ZERO: Self::Value = (
        Wrench {
            force: [0.0; 3],
            torque: [0.0; 3],
        },
        [[0.0; 6]; 6],
    );
    #[inline(always)]
    fn of<E: Evaluate, A: Arithmetic<f64>>(self, evaluation: &E, pose: &Pose<f64>) -> Self::Value {
        evaluation.wrench_and_stiffness::<A>(pose, self.0)
    }
}

/// A quantity at each pose, into `results`.
struct Rows<'a, Q: Quantity> {
    quantity: Q,
    poses: &'a [Pose<f64>],
    results: &'a mut [Q::Value],
}

impl<Q: Quantity> Work for Rows<'_, Q> {
    type Output = ();
    fn with<E: Evaluate>(self, evaluation: E) {
        dispatch(RowsWith(self, evaluation));
    }
}

struct RowsWith<'a, Q: Quantity, E>(Rows<'a, Q>, E);

impl<Q: Quantity, E: Evaluate> Task for RowsWith<'_, Q, E> {
    type Output = ();
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) {
        let rows = self.0;
        for (result, pose) in rows.results.iter_mut().zip(rows.poses) {
            *result = rows.quantity.of::<E, A>(&self.1, pose);
        }
    }
}

fn all<Q: Quantity>(evaluator: &Evaluator, poses: &[Pose<f64>], quantity: Q) -> Vec<Q::Value> {
    fill(poses, Q::ZERO, |poses, results| {
        evaluator.run(Rows {
            quantity,
            poses,
            results,
        });
    })
}

/// U of each pose (J).
pub(crate) fn energies(evaluator: &Evaluator, poses: &[Pose<f64>]) -> Vec<f64> {
    all(evaluator, poses, Energy)
}

/// h of each pose (N, N m).
pub(crate) fn wrenches(evaluator: &Evaluator, poses: &[Pose<f64>]) -> Vec<Vec6<f64>> {
    all(evaluator, poses, OnlyWrench)
}

/// The stiffness of each pose.
pub(crate) fn stiffnesses(
    evaluator: &Evaluator,
    poses: &[Pose<f64>],
    kind: StiffnessKind,
) -> Vec<Mat6<f64>> {
    all(evaluator, poses, Stiffness(kind))
}

/// h and the stiffness of one pose, without allocation.
#[inline]
pub(crate) fn one(
    evaluator: &Evaluator,
    pose: &Pose<f64>,
    kind: StiffnessKind,
) -> (Wrench<f64>, Mat6<f64>) {
    let mut results = [Both::ZERO];
    evaluator.run(Rows {
        quantity: Both(kind),
        poses: std::slice::from_ref(pose),
        results: &mut results,
    });
    results[0]
}
