//! The same steps along a single coordinate, which has no frame: relaxation, friction, temperature and age.

use super::{BRANCHES, Decay, Effects, Inputs};

/// What a mechanism of one coordinate remembers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineState {
    /// Coordinate of the last step.
    pub point: f64,
    /// Static value there.
    pub value: f64,
    /// m of each branch.
    pub memory: [f64; BRANCHES],
    /// What rounding left out of m.
    pub carry: [f64; BRANCHES],
    /// Stretch of the spring that slips.
    pub stretch: f64,
}

/// Numbers of a [`LineState`].
pub const LINE_NUMBERS: usize = 3 + 2 * BRANCHES;

impl LineState {
    /// After an infinite rest at a point with its static value.
    pub fn new(point: f64, value: f64) -> Self {
        Self {
            point,
            value,
            memory: [0.0; BRANCHES],
            carry: [0.0; BRANCHES],
            stretch: 0.0,
        }
    }

    /// Value and its derivative, dt (s) after the step before, from the static ones at `point`.
    ///
    /// A linear branch follows the first stiffness of the effects, friction its first spring and
    /// slip. None, and the state as it was,
    /// where dt is negative, a number is not finite, or the point is beyond the limits.
    ///
    /// ```
    /// use ecm_poly::stepper::{Branch, Effects};
    /// use ecm_poly::stepper::line::LineState;
    /// let mut effects = Effects::none(1.0);
    /// effects.stiffness[0] = 100.0;
    /// effects.branches[0] = Branch { share: 0.5, tau_s: 1.0, linear: true };
    /// let mut state = LineState::new(0.0, 0.0);
    /// let inputs = effects.default_inputs();
    /// let sudden = state.step(&effects, 0.1, (10.0, 100.0), 0.0, &inputs);
    /// assert_eq!(sudden, Some((15.0, 150.0)));
    ///
    /// let mut rubs = Effects::none(1.0);
    /// (rubs.friction[0], rubs.slip[0]) = (20.0, 0.05);
    /// let mut state = LineState::new(0.0, 0.0);
    /// let there = state.step(&rubs, 0.1, (10.0, 100.0), 0.1, &inputs);
    /// let back = state.step(&rubs, 0.075, (7.5, 100.0), 0.1, &inputs);
    /// assert_eq!((there, back), (Some((11.0, 100.0)), Some((8.0, 120.0))));
    /// ```
    pub fn step(
        &mut self,
        effects: &Effects<f64>,
        point: f64,
        (value, slope): (f64, f64),
        dt: f64,
        inputs: &Inputs<f64>,
    ) -> Option<(f64, f64)> {
        if effects
            .limits
            .is_some_and(|[low, high]| !(low <= point && point <= high))
        {
            return None;
        }
        let finite = dt.is_finite() && inputs.are_finite() && (point + value + slope).is_finite();
        if !(finite && dt >= 0.0) {
            return None;
        }
        let size = effects.size(inputs);
        let (mut sum, mut steep) = (size * value, size * slope);
        for (b, branch) in effects.branches.iter().enumerate() {
            let decay = Decay::new(dt / branch.tau_s);
            let (driven, of_slope) = if branch.linear {
                let k = effects.stiffness[0];
                (k * (point - self.point), k)
            } else {
                (value - self.value, slope)
            };
            let old = self.memory[b];
            let change = (decay.share * driven - decay.lost * old) + self.carry[b];
            let new = old + change;
            self.carry[b] = change - (new - old);
            self.memory[b] = new;
            sum += branch.share * new;
            steep += branch.share * decay.share * of_slope;
        }
        let (wanted, limit) = (self.stretch + (point - self.point), effects.slip[0]);
        self.stretch = if wanted > limit {
            limit
        } else if wanted < -limit {
            -limit
        } else {
            steep += effects.friction[0];
            wanted
        };
        sum += effects.friction[0] * self.stretch;
        self.point = point;
        self.value = value;
        Some((sum, steep))
    }
}
