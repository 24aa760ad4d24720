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

/// Sums over the readings of half an interval.
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
    /// Time of the readings (s).
    pub read_s: R,
    /// Number of readings.
    pub readings: R,
}

impl<R: Real> Block<R> {
    pub(super) const EMPTY: Self = Self {
        pose: [R::ZERO; 6],
        wrench: [R::ZERO; 6],
        predicted: [R::ZERO; 6],
        branches: [[R::ZERO; 6]; BRANCHES],
        read_s: R::ZERO,
        readings: R::ZERO,
    };

    /// Adds a reading.
    pub(super) fn add(&mut self, reading: &Reading<R>, dt: R) {
        let pose = reading.pose.to_array();
        for i in 0..6 {
            self.pose[i] += pose[i];
            self.wrench[i] += reading.wrench[i];
            self.predicted[i] += reading.predicted[i];
            for (sum, branch) in self.branches.iter_mut().zip(&reading.branches) {
                sum[i] += branch[i];
            }
        }
        self.read_s += dt;
        self.readings += R::ONE;
    }

    pub(super) fn is_finite(&self) -> bool {
        let all = |values: &[R]| values.iter().all(|x| x.is_finite());
        let sums = [&self.pose, &self.wrench, &self.predicted];
        sums.into_iter().chain(&self.branches).all(|sum| all(sum))
            && all(&[self.read_s, self.readings])
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
}

/// The two halves of an interval.
pub(super) struct Pair<R> {
    /// Means of each; the same twice where only one has readings.
    pub halves: [Block<R>; 2],
    /// Means of both.
    pub pose: Vec6<R>,
    /// Whether each half has readings of its own.
    pub two: bool,
    /// How many readings of independent noise the mean of both halves is worth.
    pub independent: R,
}

impl<R: Real> Pair<R> {
    pub fn new(halves: &[Block<R>; 2], noise: &Noise<R>) -> Self {
        let [first, second] = halves;
        let readings = first.readings + second.readings;
        let two = first.readings > R::ZERO && second.readings > R::ZERO;
        let halves = match (two, first.readings > R::ZERO) {
            (true, _) => [first.mean(), second.mean()],
            (false, true) => [first.mean(); 2],
            (false, false) => [second.mean(); 2],
        };
        // Variance of the mean of two means: (1/n1 + 1/n2) / 4.
        let white = if two {
            R::from_u16(4) * first.readings * second.readings / readings
        } else {
            readings
        };
        let read_s = first.read_s + second.read_s;
        let independent = if noise.time_s * white <= read_s {
            white
        } else if noise.time_s < read_s {
            read_s / noise.time_s
        } else {
            R::ONE
        };
        let pose = core::array::from_fn(|i| R::HALF * (halves[0].pose[i] + halves[1].pose[i]));
        Self {
            halves,
            pose,
            two,
            independent,
        }
    }

    /// Means of the wrenches of the model and of the branches.
    pub fn of_model(&self) -> [Vec6<R>; 1 + BRANCHES] {
        let [first, second] = &self.halves;
        core::array::from_fn(|k| {
            let of = |half: &Block<R>| match k {
                0 => half.predicted,
                _ => half.branches[k - 1],
            };
            let (one, other) = (of(first), of(second));
            core::array::from_fn(|a| R::HALF * (one[a] + other[a]))
        })
    }

    /// Whether a coordinate of the mean pose is 10 standard deviations from another.
    pub fn moved(&self, from: &Vec6<R>, noise: &Noise<R>) -> bool {
        let many = R::from_u16(100) / self.independent;
        (0..6).any(|i| {
            let (d, sd) = (self.pose[i] - from[i], noise.pose[i / 3]);
            d * d > many * sd * sd
        })
    }

    /// K Σ_p Kᵀ of the mean, and of half the difference of the halves.
    pub fn of_pose(&self, noise: &Noise<R>, stiffness: &Mat6<R>) -> Mat6<R> {
        let share = R::ONE / self.independent;
        let variance: Vec6<R> =
            core::array::from_fn(|j| share * noise.pose[j / 3] * noise.pose[j / 3]);
        core::array::from_fn(|a| {
            core::array::from_fn(|b| {
                (0..6).fold(R::ZERO, |sum, j| {
                    sum + stiffness[a][j] * variance[j] * stiffness[b][j]
                })
            })
        })
    }

    /// Covariance of either with the noise of the wrench; `scale` is the modulus.
    pub fn noise(&self, noise: &Noise<R>, of_pose: &Mat6<R>, scale: R) -> Mat6<R> {
        let share = R::ONE / self.independent;
        let mut matrix = of_pose.map(|row| row.map(|x| scale * x * scale));
        for (a, row) in matrix.iter_mut().enumerate() {
            row[a] += share * noise.wrench[a / 3] * noise.wrench[a / 3];
        }
        matrix
    }
}
