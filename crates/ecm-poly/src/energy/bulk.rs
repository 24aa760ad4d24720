//! Evaluation of one pose or many, with the SIMD instructions of this machine and on all its cores.

use alloc::vec::Vec;

use ecm_se3::stiffness::StiffnessKind;
use ecm_se3::{Mat6, Pose, Vec6, Wrench};

use crate::arithmetic::{Arithmetic, Task, dispatch};
use crate::energy::evaluator::{Evaluate, Evaluator, Work};
use crate::parallel::{PIECE, fill};

/// U at each pose.
struct Energies<'a>(&'a [Pose<f64>], &'a mut [f64]);

/// h at each pose.
struct Wrenches<'a>(&'a [Pose<f64>], &'a mut [Vec6<f64>]);

/// h and a stiffness at each pose.
struct Stiffnesses<'a> {
    kind: StiffnessKind,
    poses: &'a [Pose<f64>],
    wrenches: &'a mut [Wrench<f64>],
    stiffnesses: &'a mut [Mat6<f64>],
}

/// Work with one evaluation, compiled for this machine.
struct With<W, E>(W, E);

impl Work for Energies<'_> {
    type Output = ();
    fn with<E: Evaluate>(self, evaluation: E) {
        dispatch(With(self, evaluation));
    }
}

impl<E: Evaluate> Task for With<Energies<'_>, E> {
    type Output = ();
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) {
        let Energies(poses, energies) = self.0;
        for (energy, pose) in energies.iter_mut().zip(poses) {
            *energy = self.1.energy::<A>(pose);
        }
    }
}

impl Work for Wrenches<'_> {
    type Output = ();
    fn with<E: Evaluate>(self, evaluation: E) {
        dispatch(With(self, evaluation));
    }
}

impl<E: Evaluate> Task for With<Wrenches<'_>, E> {
    type Output = ();
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) {
        let Wrenches(poses, wrenches) = self.0;
        for (wrench, pose) in wrenches.iter_mut().zip(poses) {
            *wrench = self.1.wrench::<A>(pose).to_array();
        }
    }
}

impl Work for Stiffnesses<'_> {
    type Output = ();
    fn with<E: Evaluate>(self, evaluation: E) {
        dispatch(With(self, evaluation));
    }
}

impl<E: Evaluate> Task for With<Stiffnesses<'_>, E> {
    type Output = ();
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) {
        let work = self.0;
        let results = work.wrenches.iter_mut().zip(work.stiffnesses);
        for (pose, (wrench, stiffness)) in work.poses.iter().zip(results) {
            (*wrench, *stiffness) = self.1.wrench_and_stiffness::<A>(pose, work.kind);
        }
    }
}

/// U of each pose (J).
pub(crate) fn energies(evaluator: &Evaluator, poses: &[Pose<f64>]) -> Vec<f64> {
    let of_piece = |poses: &[_], energies: &mut [_]| evaluator.run(Energies(poses, energies));
    fill(poses, 0.0, of_piece)
}

/// h of each pose (N, N m).
pub(crate) fn wrenches(evaluator: &Evaluator, poses: &[Pose<f64>]) -> Vec<Vec6<f64>> {
    let of_piece = |poses: &[_], wrenches: &mut [_]| evaluator.run(Wrenches(poses, wrenches));
    fill(poses, [0.0; 6], of_piece)
}

/// The stiffness of each pose.
pub(crate) fn stiffnesses(
    evaluator: &Evaluator,
    poses: &[Pose<f64>],
    kind: StiffnessKind,
) -> Vec<Mat6<f64>> {
    fill(poses, [[0.0; 6]; 6], |poses, stiffnesses| {
        let mut wrenches = [Wrench::default(); PIECE];
        evaluator.run(Stiffnesses {
            kind,
            poses,
            wrenches: &mut wrenches,
            stiffnesses,
        });
    })
}

/// h and the stiffness of one pose, without allocation.
#[inline]
pub(crate) fn one(
    evaluator: &Evaluator,
    pose: &Pose<f64>,
    kind: StiffnessKind,
) -> (Wrench<f64>, Mat6<f64>) {
    let (mut wrench, mut stiffness) = (Wrench::default(), [[0.0; 6]; 6]);
    evaluator.run(Stiffnesses {
        kind,
        poses: core::slice::from_ref(pose),
        wrenches: core::slice::from_mut(&mut wrench),
        stiffnesses: core::slice::from_mut(&mut stiffness),
    });
    (wrench, stiffness)
}
