//! Readings, and their sums over an interval.

use ecm_se3::{Mat6, Pose, Real, Vec6};

use super::parameters::Noise;
use crate::stepper::BRANCHES;

/// What was measured at one moment, and what the model says there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading<R> {
    /// Measured pose.
    pub pose: Pose<R>,
    /// Measured wrench.
    pub wrench: Vec6<R>,
    /// Wrench of the model at the measured pose, with the parameters it was fitted with.
    pub predicted: Vec6<R>,
    /// K = ∂h/∂p there.
    pub stiffness: Mat6<R>,
    /// Wrench of each relaxing branch with share 1 ([`branch_wrenches`]); zeros without.
    ///
    /// [`branch_wrenches`]: super::branch_wrenches
    pub branches: [Vec6<R>; BRANCHES],
}

impl<R: Real> Reading<R> {
    pub(super) fn is_finite(&self) -> bool {
        let all = |values: &[R]| values.iter().all(|x| x.is_finite());
        all(&self.wrench)
            && all(&self.predicted)
            && self.stiffness.iter().all(|row| all(row))
            && self.branches.iter().all(|row| all(row))
    }
}

/// Sums over the readings of an interval.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Block<R> {
    /// Sum of poses.
    pub pose: Vec6<R>,
    /// Sum of measured wrenches.
    pub wrench: Vec6<R>,
    /// Sum of the model's wrenches.
    pub predicted: Vec6<R>,
    /// Sums of the branches' wrenches.
    pub branches: [Vec6<R>; BRANCHES],
    /// Time since the block before (s), pauses included.
    pub time_s: R,
    /// Time of the readings in the sums (s).
    pub read_s: R,
    /// Number of readings in the sums.
    pub readings: R,
}

impl<R: Real> Block<R> {
    pub(super) const EMPTY: Self = Self {
        pose: [R::ZERO; 6],
        wrench: [R::ZERO; 6],
        predicted: [R::ZERO; 6],
        branches: [[R::ZERO; 6]; BRANCHES],
        time_s: R::ZERO,
        read_s: R::ZERO,
        readings: R::ZERO,
    };

    /// Adds a reading; what was read before a pause longer than a block is dropped.
    pub(super) fn add(&mut self, reading: &Reading<R>, dt: R, interval_s: R) {
        if dt > interval_s {
            let time_s = self.time_s;
            *self = Self {
                time_s,
                ..Self::EMPTY
            };
        }
        let pose = reading.pose.to_array();
        for i in 0..6 {
            self.pose[i] += pose[i];
            self.wrench[i] += reading.wrench[i];
            self.predicted[i] += reading.predicted[i];
            for (sum, branch) in self.branches.iter_mut().zip(&reading.branches) {
                sum[i] += branch[i];
            }
        }
        self.time_s += dt;
        self.read_s += dt;
        self.readings += R::ONE;
    }

    pub(super) fn is_finite(&self) -> bool {
        let all = |values: &[R]| values.iter().all(|x| x.is_finite());
        let sums = [&self.pose, &self.wrench, &self.predicted];
        sums.into_iter().chain(&self.branches).all(|sum| all(sum))
            && all(&[self.time_s, self.read_s, self.readings])
    }

    /// Means over the readings.
    pub(super) fn mean(&self) -> Self {
        let share = R::ONE / self.readings;
        let six = |sum: &Vec6<R>| sum.map(|x| share * x);
        Self {
            pose: six(&self.pose),
            wrench: six(&self.wrench),
            predicted: six(&self.predicted),
            branches: self.branches.map(|sum| six(&sum)),
            ..*self
        }
    }

    /// How many readings of independent noise the mean is worth.
    fn independent(&self, noise: &Noise<R>) -> R {
        if noise.time_s * self.readings <= self.read_s {
            return self.readings;
        }
        if noise.time_s < self.read_s {
            self.read_s / noise.time_s
        } else {
            R::ONE
        }
    }

    /// Whether a coordinate of the mean pose is 10 standard deviations from another.
    pub(super) fn moved(&self, from: &Vec6<R>, noise: &Noise<R>) -> bool {
        let many = R::from_u16(100) / self.independent(noise);
        (0..6).any(|i| {
            let (d, sd) = (self.pose[i] - from[i], noise.pose[i / 3]);
            d * d > many * sd * sd
        })
    }

    /// Σ_p Kᵀ x: what a wrench over its covariance says of the error of the mean pose.
    pub(super) fn pose_shift(&self, noise: &Noise<R>, stiffness: &Mat6<R>, x: &Vec6<R>) -> Vec6<R> {
        let share = R::ONE / self.independent(noise);
        core::array::from_fn(|j| {
            let sum = (0..6).fold(R::ZERO, |sum, a| sum + stiffness[a][j] * x[a]);
            share * noise.pose[j / 3] * noise.pose[j / 3] * sum
        })
    }

    /// Moves the pose, and the model's wrench with it.
    pub(super) fn shift(&mut self, by: &Vec6<R>, stiffness: &Mat6<R>) {
        for a in 0..6 {
            self.pose[a] += by[a];
            for j in 0..6 {
                self.predicted[a] += stiffness[a][j] * by[j];
            }
        }
    }

    /// Covariance of the mean: instruments with K Σ_p Kᵀ of the pose, and that last part's diagonal.
    pub(super) fn noise(&self, noise: &Noise<R>, stiffness: &Mat6<R>) -> (Mat6<R>, Vec6<R>) {
        let share = R::ONE / self.independent(noise);
        let variance: Vec6<R> =
            core::array::from_fn(|j| share * noise.pose[j / 3] * noise.pose[j / 3]);
        let mut matrix: Mat6<R> = core::array::from_fn(|a| {
            core::array::from_fn(|b| {
                (0..6).fold(R::ZERO, |sum, j| {
                    sum + stiffness[a][j] * variance[j] * stiffness[b][j]
                })
            })
        });
        let of_pose = core::array::from_fn(|a| matrix[a][a]);
        for (a, row) in matrix.iter_mut().enumerate() {
            row[a] += share * noise.wrench[a / 3] * noise.wrench[a / 3];
        }
        (matrix, of_pose)
    }
}
