//! The constants of the effects of time that a stepper carries.

use core::ops::Range;

use ecm_se3::{Mat6, Pose, Real, Vec6, Wrench};

use super::Decay;

/// Relaxing branches of a stepper.
pub const BRANCHES: usize = 2;

/// Most springs side by side that slip one after the other.
pub const SPRINGS: usize = 5;

/// One relaxing branch: m' = x' − m/τ, and the force share · m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Branch<R> {
    /// Factor of the branch, over the static force.
    pub share: R,
    /// Time constant τ (s).
    pub tau_s: R,
    /// x is k q with the stiffness k at rest, which is passive; else the static force Q(q) itself.
    pub linear: bool,
}

/// Softening below the largest load W so far: h (1 − η g(W_max − W)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Softening<R> {
    /// η.
    pub share: R,
    /// Width w of the loss, in the unit of W; 0: g = 1 − W/W_max, a straight line.
    pub width: R,
    /// Whether g(u) = u/(u + w) with a width; else tanh(u/w).
    pub hyperbolic: bool,
    /// a of W² = |a (p − p0)|² + |b h|²; where a and b are zero W is the work |(p − p0) · h|/2.
    pub of_pose: Vec6<R>,
    /// b.
    pub of_wrench: Vec6<R>,
}

impl<R: Real> Softening<R> {
    /// No softening; the largest load is the largest work.
    pub const fn none() -> Self {
        Self {
            share: R::ZERO,
            width: R::ZERO,
            hyperbolic: false,
            of_pose: [R::ZERO; 6],
            of_wrench: [R::ZERO; 6],
        }
    }

    /// Whether W is the work.
    pub fn is_of_work(&self) -> bool {
        let all = self.of_pose.iter().chain(&self.of_wrench);
        all.fold(R::ZERO, |sum, &x| sum + x * x) <= R::ZERO
    }

    /// W and ∂W/∂p, at p − p0, h and K.
    pub(crate) fn load(&self, away: &Vec6<R>, h: &Vec6<R>, stiffness: &Mat6<R>) -> (R, Vec6<R>) {
        let weighed =
            |weights: &Vec6<R>, of: &Vec6<R>| core::array::from_fn(|j| weights[j] * of[j]);
        let along =
            |x: &Vec6<R>, j: usize| (0..6).fold(R::ZERO, |sum, i| sum + x[i] * stiffness[i][j]);
        if self.is_of_work() {
            let product = (0..6).fold(R::ZERO, |sum, j| sum + away[j] * h[j]);
            let half = if product < R::ZERO { -R::HALF } else { R::HALF };
            let slope = core::array::from_fn(|j| half * (h[j] + along(away, j)));
            return (half * product, slope);
        }
        let (a, b) = (weighed(&self.of_pose, away), weighed(&self.of_wrench, h));
        let load = length(a.iter().chain(&b));
        if load <= R::ZERO {
            return (R::ZERO, [R::ZERO; 6]);
        }
        let (a, b) = (weighed(&self.of_pose, &a), weighed(&self.of_wrench, &b));
        (load, core::array::from_fn(|j| (a[j] + along(&b, j)) / load))
    }

    /// g, and how fast it falls with W.
    pub(crate) fn lost(&self, load: R, largest: R) -> (R, R) {
        let below = largest - load;
        if largest <= R::ZERO {
            return (R::ZERO, R::ZERO);
        }
        if self.width <= R::ZERO {
            return (R::ONE - load / largest, R::ONE / largest);
        }
        if self.hyperbolic {
            let all = below + self.width;
            return (below / all, self.width / (all * all));
        }
        // tanh x of 1 − e^(−2x)
        let lost = Decay::new(R::TWO * below / self.width).lost;
        let tanh = lost / (R::TWO - lost);
        (tanh, (R::ONE - tanh * tanh) / self.width)
    }
}

/// Length of a vector of at most twelve numbers.
///
/// The sum of their sizes is at most √12 times the root: seven steps of Newton have all digits.
pub(crate) fn length<'a, R: Real + 'a>(of: impl Iterator<Item = &'a R>) -> R {
    let (mut square, mut root) = (R::ZERO, R::ZERO);
    for &x in of {
        square += x * x;
        root += if x < R::ZERO { -x } else { x };
    }
    for _ in 0..if root > R::ZERO { 7 } else { 0 } {
        root = R::HALF * (root + square / root);
    }
    root
}

/// Effects of time beside a static map; an effect that is zero is absent.
///
/// All act in the mid-frame coordinates q and their forces Q, and add to the static wrench h. With
/// fewer than all columns there is no frame: q is p and Q is h, each column in its place of six.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effects<R> {
    /// Undeformed length L (m).
    pub length_m: R,
    /// k (N/m, N m/rad): the stiffness at rest along q, of which a frame has the diagonal.
    pub stiffness: Mat6<R>,
    /// Stress relaxation.
    pub branches: [Branch<R>; BRANCHES],
    /// Stiffness (N/m, N m/rad) of the springs that slip: row i of Q, column j of their stretch.
    pub friction: Mat6<R>,
    /// Stretch (m, rad) at which each of them slips.
    pub slip: Vec6<R>,
    /// Stretch (m, rad) up to which each of them does not pull: a play.
    pub play: Vec6<R>,
    /// Whether they slip as one, where the length of their stretches over these limits is 1: of
    /// columns without a frame, which this couples.
    pub together: bool,
    /// Springs side by side for each of them, up to [`SPRINGS`], which slip one after the other: of n
    /// the i-th at (2 i − 1)/n of the stretch, with 1/n of the stiffness.
    pub springs: usize,
    /// Whether they follow the pose p and add to the wrench h, not along q to Q.
    pub of_pose: bool,
    /// β (1/K): h (1 − β (T − T0)).
    pub softer_per_kelvin: R,
    /// T0 (°C).
    pub reference_degc: R,
    /// α (1/K): a body larger by g = 1 + α (T − T0) has g² f(c/g, θ) and g³ m(c/g, θ).
    pub growth_per_kelvin: R,
    /// α (1/s): h (1 + α g(t)), g(t) = t, or τ (1 − e^(−t/τ)) where it settles.
    pub ageing_per_s: R,
    /// 1/τ (1/s) of the ageing; 0: it is steady.
    pub settling_per_s: R,
    /// D in D p': force or moment per rate of the pose, a diagonal where there is a frame.
    pub damping: Mat6<R>,
    /// Softening below the largest load W_max.
    pub softening: Softening<R>,
    /// Share of the deflection at W_max that stays as a set s: h(p − s).
    pub set_share: R,
    /// Temperatures (°C) for which the model was measured; None: any.
    pub temperature_range_degc: Option<[R; 2]>,
    /// Ages (s) for which the model was measured; None: any.
    pub age_range_s: Option<[R; 2]>,
    /// Largest |c| (m) and |θ| (rad) of the mid frame that are a pose and no fault; None: any. Farther
    /// ones are refused, and the state stays.
    pub limits: Option<[R; 2]>,
    /// Without a frame the same, as least and largest p; None: there is a frame.
    pub columns: Option<[Vec6<R>; 2]>,
}

impl<R: Real> Effects<R> {
    /// No effect.
    pub const fn none(length_m: R) -> Self {
        let branch = Branch {
            share: R::ZERO,
            tau_s: R::ONE,
            linear: true,
        };
        Self {
            length_m,
            stiffness: [[R::ZERO; 6]; 6],
            branches: [branch; BRANCHES],
            friction: [[R::ZERO; 6]; 6],
            slip: [R::ZERO; 6],
            play: [R::ZERO; 6],
            together: false,
            springs: 1,
            of_pose: false,
            softer_per_kelvin: R::ZERO,
            reference_degc: R::ZERO,
            growth_per_kelvin: R::ZERO,
            ageing_per_s: R::ZERO,
            settling_per_s: R::ZERO,
            damping: [[R::ZERO; 6]; 6],
            softening: Softening::none(),
            set_share: R::ZERO,
            temperature_range_degc: None,
            age_range_s: None,
            limits: None,
            columns: None,
        }
    }

    /// Whether the inputs are in the ranges for which the model was measured.
    ///
    /// A step outside is finite and extrapolates: the effects go on as straight lines.
    ///
    /// ```
    /// use ecm_poly::stepper::{Effects, Inputs};
    /// let mut effects = Effects::none(0.1);
    /// effects.temperature_range_degc = Some([18.0, 26.0]);
    /// let at = |temperature_degc| Inputs { temperature_degc, age_s: 1e6 };
    /// assert!(effects.inputs_inside(&at(20.0)));
    /// assert!(!effects.inputs_inside(&at(30.0)) && !effects.inputs_inside(&at(f64::NAN)));
    /// ```
    pub fn inputs_inside(&self, inputs: &Inputs<R>) -> bool {
        let inside = |range: &Option<[R; 2]>, x: R| match range {
            Some([low, high]) => *low <= x && x <= *high,
            None => x.is_finite(),
        };
        inside(&self.temperature_range_degc, inputs.temperature_degc)
            && inside(&self.age_range_s, inputs.age_s)
    }

    /// The factor of temperature and age on h.
    pub(crate) fn size(&self, inputs: &Inputs<R>) -> R {
        let warmer = inputs.temperature_degc - self.reference_degc;
        let grown = inputs.age_s * Decay::new(inputs.age_s * self.settling_per_s).share;
        R::ONE - self.softer_per_kelvin * warmer + self.ageing_per_s * grown
    }

    /// Coordinates that act on force i: in a frame stiffness, friction and damping are diagonal.
    #[inline(always)]
    pub(crate) fn coupled(&self, i: usize) -> Range<usize> {
        match self.columns {
            Some(_) => 0..6,
            None => i..i + 1,
        }
    }

    #[inline(always)]
    pub(crate) fn damps(&self) -> bool {
        self.damping.as_flattened().iter().any(|&d| d * d > R::ZERO)
    }

    #[inline(always)]
    pub(crate) fn grows(&self) -> bool {
        self.growth_per_kelvin * self.growth_per_kelvin > R::ZERO
    }

    /// Size of the body over that at T0.
    fn grown(&self, inputs: &Inputs<R>) -> R {
        R::ONE + self.growth_per_kelvin * (inputs.temperature_degc - self.reference_degc)
    }

    /// The pose at which the body, had it not grown, would be deformed as it is at this one.
    pub(crate) fn ungrown(&self, pose: &Pose<R>, inputs: &Inputs<R>) -> Option<Pose<R>> {
        let g = self.grown(inputs);
        let mut p = pose.to_array();
        p.iter_mut().take(3).for_each(|x| *x = *x / g);
        Pose::checked(&p)
    }

    /// Wrench and stiffness of the grown body, from those at the pose of `ungrown`.
    pub(crate) fn regrown(
        &self,
        wrench: &Wrench<R>,
        mut tangent: Mat6<R>,
        inputs: &Inputs<R>,
    ) -> (Wrench<R>, Mat6<R>) {
        let g = self.grown(inputs);
        let powers = [g * g, g * g * g];
        for (i, row) in tangent.iter_mut().enumerate() {
            for (j, k) in row.iter_mut().enumerate() {
                let power = powers[i / 3];
                *k = *k * if j < 3 { power / g } else { power };
            }
        }
        let wrench = Wrench {
            force: wrench.force.map(|x| powers[0] * x),
            torque: wrench.torque.map(|x| powers[1] * x),
        };
        (wrench, tangent)
    }

    /// The inputs at which temperature and age change nothing.
    pub const fn default_inputs(&self) -> Inputs<R> {
        Inputs {
            temperature_degc: self.reference_degc,
            age_s: R::ZERO,
        }
    }
}

/// The matrix with these numbers on its diagonal.
pub fn diagonal<R: Real>(numbers: &Vec6<R>) -> Mat6<R> {
    let entry = |i: usize, j: usize| if i == j { numbers[i] } else { R::ZERO };
    core::array::from_fn(|i| core::array::from_fn(|j| entry(i, j)))
}

/// What a step is told beside pose and time.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Inputs<R> {
    /// Temperature of the mechanism (°C).
    pub temperature_degc: R,
    /// Time since the campaign began in which ageing was found (s).
    pub age_s: R,
}

impl<R: Real> Inputs<R> {
    #[inline(always)]
    pub(crate) fn are_finite(&self) -> bool {
        self.temperature_degc.is_finite() && self.age_s.is_finite()
    }
}
