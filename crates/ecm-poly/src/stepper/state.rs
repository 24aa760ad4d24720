//! What a mechanism remembers between two steps, and the same as plain numbers.

use ecm_se3::{Real, Vec6};

use super::BRANCHES;

/// What a mechanism remembers: plain numbers, which may be stored and loaded.
///
/// [`STATE_NUMBERS`] numbers: 392 bytes in double, 196 in single precision.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct State<R> {
    /// Pose of the largest load so far.
    pub farthest: Vec6<R>,
    /// q of the last step.
    pub coordinates: Vec6<R>,
    /// Q of the static wrench there.
    pub force: Vec6<R>,
    /// Stretch z of the springs that slip (m, rad).
    pub stretch: Vec6<R>,
    /// m of each branch (N, N m).
    pub memory: [Vec6<R>; BRANCHES],
    /// What rounding left out of m: else slow branches would stand still in single precision.
    pub carry: [Vec6<R>; BRANCHES],
    /// W_max: J, or as `Softening` measures it.
    pub largest: R,
}

/// Numbers of a [`State`].
pub const STATE_NUMBERS: usize = 25 + 12 * BRANCHES;

impl<R: Real> State<R> {
    /// All numbers, in the order of the fields.
    ///
    /// ```
    /// use ecm_poly::stepper::State;
    /// let numbers: [f64; 49] = core::array::from_fn(|i| i as f64);
    /// let state = State::from_numbers(&numbers).ok_or("a NaN")?;
    /// assert_eq!(state.to_numbers(), numbers);
    /// # Ok::<(), &str>(())
    /// ```
    pub fn to_numbers(&self) -> [R; STATE_NUMBERS] {
        let rows = self.rows();
        core::array::from_fn(|i| match rows.get(i / 6) {
            Some(row) => row[i % 6],
            None => self.largest,
        })
    }

    /// The state of these numbers; None where one is not finite, because every later step would
    /// be NaN.
    pub fn from_numbers(numbers: &[R; STATE_NUMBERS]) -> Option<Self> {
        if !numbers.iter().all(|x| x.is_finite()) {
            return None;
        }
        let row = |k: usize| core::array::from_fn(|j| numbers[6 * k + j]);
        Some(Self {
            farthest: row(0),
            coordinates: row(1),
            force: row(2),
            stretch: row(3),
            memory: core::array::from_fn(|b| row(4 + b)),
            carry: core::array::from_fn(|b| row(4 + BRANCHES + b)),
            largest: numbers[STATE_NUMBERS - 1],
        })
    }

    fn rows(&self) -> [&Vec6<R>; 4 + 2 * BRANCHES] {
        core::array::from_fn(|k| match k {
            0 => &self.farthest,
            1 => &self.coordinates,
            2 => &self.force,
            3 => &self.stretch,
            _ if k < 4 + BRANCHES => &self.memory[k - 4],
            _ => &self.carry[k - 4 - BRANCHES],
        })
    }
}
