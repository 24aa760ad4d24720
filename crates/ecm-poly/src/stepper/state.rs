//! What a mechanism remembers between two steps, and the same as plain numbers.

use ecm_se3::{Real, Vec6};

use super::{BRANCHES, SPRINGS};

/// What a mechanism remembers: plain numbers, which may be stored and loaded.
///
/// At most [`STATE_NUMBERS`] numbers: 584 bytes in double, 292 in single precision.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct State<R> {
    /// Pose of the largest load so far.
    pub farthest: Vec6<R>,
    /// q of the last step.
    pub coordinates: Vec6<R>,
    /// Q of the static wrench there.
    pub force: Vec6<R>,
    /// Stretch z of the springs that slip (m, rad), of those side by side the first one.
    pub stretch: Vec6<R>,
    /// m of each branch (N, N m).
    pub memory: [Vec6<R>; BRANCHES],
    /// What rounding left out of m: else slow branches would stand still in single precision.
    pub carry: [Vec6<R>; BRANCHES],
    /// W_max: J, or as `Softening` measures it.
    pub largest: R,
    /// Stretch of the further springs side by side.
    pub further: [Vec6<R>; SPRINGS - 1],
}

/// Numbers of a [`State`] with all springs.
pub const STATE_NUMBERS: usize = state_numbers(SPRINGS);

/// Numbers of a [`State`] of so many springs side by side: those of `further` are the last.
pub const fn state_numbers(springs: usize) -> usize {
    19 + 12 * BRANCHES + 6 * springs
}

impl<R: Real> State<R> {
    /// All numbers, in the order of the fields.
    ///
    /// ```
    /// use ecm_poly::stepper::{STATE_NUMBERS, State};
    /// let numbers: [f64; STATE_NUMBERS] = core::array::from_fn(|i| i as f64);
    /// let state = State::from_numbers(&numbers).ok_or("a NaN")?;
    /// assert_eq!(state.to_numbers(), numbers);
    /// # Ok::<(), &str>(())
    /// ```
    pub fn to_numbers(&self) -> [R; STATE_NUMBERS] {
        let rows = [
            &self.farthest,
            &self.coordinates,
            &self.force,
            &self.stretch,
        ];
        let memories = self.memory.iter().chain(&self.carry);
        let known = rows.into_iter().chain(memories).flatten();
        let further = self.further.as_flattened();
        let mut all = known.chain([&self.largest]).chain(further);
        core::array::from_fn(|_| all.next().copied().unwrap_or(R::ZERO))
    }

    /// The state of these numbers, the last ones of springs that are not there absent.
    ///
    /// None where one is not finite, because every later step would be NaN, or of another count.
    pub fn from_numbers(numbers: &[R]) -> Option<Self> {
        let known = (1..=SPRINGS).any(|springs| state_numbers(springs) == numbers.len());
        if !(known && numbers.iter().all(|x| x.is_finite())) {
            return None;
        }
        let mut rest = numbers.iter().copied();
        let mut number = || rest.next().unwrap_or(R::ZERO);
        let mut row = || core::array::from_fn(|_| number());
        Some(Self {
            farthest: row(),
            coordinates: row(),
            force: row(),
            stretch: row(),
            memory: core::array::from_fn(|_| row()),
            carry: core::array::from_fn(|_| row()),
            largest: number(),
            further: core::array::from_fn(|_| core::array::from_fn(|_| number())),
        })
    }
}
