//! A control loop that holds the platform at a pose with the model's wrench and stiffness.
//!
//! e = p_d − p, S = Σ e dt, y = w² (e + g S) + 2 w (e − e_before) / dt, g = w / 4,
//! wrench = h(p_d) − M G + M B y + g K(p_d) S, M = diag(m I, j I), B = diag(I, J(θ_d)).
//!
//! h(p_d) balances the mechanism at the held pose p_d, and −M G the weight of the platform, whose centre
//! of mass is at its origin; G is gravity in base axes. B takes a small change of the pose to a twist:
//! a moment turns the platform about axes in space, not along the rotation vector. w was chosen at the
//! export from the stiffness over the model's poses, the mass and the delay (docs/control.md):
//!
@SUMMARY@
//!
@+//! h(p_d) is what `step` gives along the held pose: fed forward, it carries what relaxes and slips and
@+//! cannot make the loop unstable. Half-way the state is stored as numbers and loaded, as by a restart.
@+//!
//! Replace `Plant` by your robot: read the pose, command the wrench. Here it is a rigid platform of
//! that mass on a mechanism 20 % softer than the model says and without damping, whose commands come
//! late by the whole delay, pushed for 200 steps. `cargo run --release --example control`
#![allow(clippy::excessive_precision, clippy::unreadable_literal)]

use std::collections::VecDeque;

@-use @NAME@::{value, value_and_stiffness};
@+use @NAME@::{DEFAULT_INPUTS, State, init, step, value_and_stiffness};

const STEPS: usize = @COUNT@;
const SUBSTEPS: usize = 4;
const DELAY_STEPS: usize = @DELAY@;
/// s.
const DT: @REAL@ = @DT@;
/// kg, of the platform and what it carries.
const MASS: @REAL@ = @MASS@;
/// kg m², about any axis through its origin.
const INERTIA: @REAL@ = @INERTIA@;
/// w, rad/s.
const BANDWIDTH: @REAL@ = @BANDWIDTH@;
/// m/s², base axes.
const GRAVITY: [@REAL@; 3] = [@GRAVITY@];
#[rustfmt::skip]
const HELD: [@REAL@; 6] = [@HELD@];
@+const REST: [@REAL@; 6] = [@REST@];
const COLUMNS: [&str; 6] = [@COLUMNS@];

type Vec3 = [@REAL@; 3];
type Vec6 = [@REAL@; 6];

fn cross(a: &Vec3, b: &Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The second half of a pose or a twist.
fn angular(p: &Vec6) -> Vec3 {
    [p[3], p[4], p[5]]
}

/// J(θ) x = x + c₂ θ × x + c₃ θ × (θ × x), c_k = 1/k! − θ²/(k + 2)! + …
fn turned(theta: &Vec3, x: &Vec3) -> Vec3 {
    let s: @REAL@ = theta.iter().map(|t| t * t).sum();
    let (mut second, mut third): (@REAL@, @REAL@) = (0.0, 0.0);
    for j in (0..12_u16).rev() {
        let [a, b, c] = [3, 4, 5].map(|k| @REAL@::from(2 * j + k));
        second = 1.0 - second * s / (a * b);
        third = 1.0 - third * s / (b * c);
    }
    let once = cross(theta, x);
    let twice = cross(theta, &once);
    std::array::from_fn(|i| x[i] + second / 2.0 * once[i] + third / 6.0 * twice[i])
}

#[derive(Clone)]
struct Controller {
    held: Vec6,
    feed: Vec6,
    stiffness: [Vec6; 6],
    sum: Vec6,
    before: Vec6,
@+    /// What the mechanism remembers.
@+    state: State<@REAL@>,
}

impl Controller {
@-    /// None where the model has no wrench.
@+    /// It has just been moved there from a long rest; None where the model has no wrench.
    fn new(held: Vec6) -> Option<Self> {
        let (feed, stiffness) = value_and_stiffness(&held);
@-        let start = Self { held, feed, stiffness, sum: [0.0; 6], before: [0.0; 6] };
@+        let state = init(&REST)?;
@+        let mut start = Self { held, feed, stiffness, sum: [0.0; 6], before: [0.0; 6], state };
@+        start.feed_forward(0.0);
        feed[0].is_finite().then_some(start)
    }
@+
@+    /// The wrench at the held pose, seconds later; where it is refused, that of the step before.
@+    fn feed_forward(&mut self, seconds: @REAL@) {
@+        if let Some((feed, _)) = step(&mut self.state, &self.held, seconds, &DEFAULT_INPUTS) {
@+            self.feed = feed;
@+        }
@+    }
@+
@+    /// The same controller with a state that was stored as numbers; None where they are damaged.
@+    fn reloaded(&self, numbers: &[@REAL@]) -> Option<Self> {
@+        Some(Self { state: State::from_numbers(numbers)?, ..self.clone() })
@+    }

    /// Once a step: pose in, wrench of the robot on the platform out.
    fn step(&mut self, pose: &Vec6) -> Vec6 {
@+        self.feed_forward(DT);
        let (w, g) = (BANDWIDTH, BANDWIDTH / 4.0);
        let y: Vec6 = std::array::from_fn(|i| {
            let e = self.held[i] - pose[i];
            self.sum[i] += e * DT;
            let y = w * w * (e + g * self.sum[i]) + 2.0 * w / DT * (e - self.before[i]);
            self.before[i] = e;
            y
        });
        let moment = turned(&angular(&self.held), &angular(&y));
        std::array::from_fn(|i| {
            let feedback = if i < 3 { MASS * (y[i] - GRAVITY[i]) } else { INERTIA * moment[i - 3] };
            let row = self.stiffness[i].iter().zip(&self.sum);
            self.feed[i] + feedback + g * row.map(|(k, s)| k * s).sum::<@REAL@>()
        })
    }
}

struct Plant {
    start: Vec6,
    /// Since the start: small changes are not rounded away.
    moved: Vec6,
    /// Linear and angular velocity in base axes.
    speed: Vec6,
    /// Commands on their way.
    late: VecDeque<Vec6>,
    /// Stiffness over the model's.
    softness: @REAL@,
@+    /// What it remembers itself.
@+    state: State<@REAL@>,
}

impl Plant {
    fn new(c: &Controller, softness: @REAL@, delay_steps: usize) -> Self {
        let carried =
            std::array::from_fn(|i| c.feed[i] - if i < 3 { MASS * GRAVITY[i] } else { 0.0 });
        let late = std::iter::repeat_n(carried, delay_steps).collect();
@-        Self { start: c.held, moved: [0.0; 6], speed: [0.0; 6], late, softness }
@+        Self { start: c.held, moved: [0.0; 6], speed: [0.0; 6], late, softness, state: c.state }
    }

    fn pose(&self) -> Vec6 {
        std::array::from_fn(|i| self.start[i] + self.moved[i])
    }

    /// One step: Newton's law in small steps, θ' = J⁻¹ ω = ω − θ × ω / 2 + g θ × (θ × ω).
    fn step(&mut self, wrench: Vec6, push: @REAL@) {
        self.late.push_back(wrench);
        let acting = self.late.pop_front().unwrap_or(wrench);
        let small = DT / SUBSTEPS as @REAL@;
        for _ in 0..SUBSTEPS {
            let pose = self.pose();
@-            let h = value(&pose);
@+            let taken = step(&mut self.state, &pose, small, &DEFAULT_INPUTS);
@+            let h = taken.map_or([@REAL@::NAN; 6], |(h, _)| h);
            for i in 0..6 {
                let force = acting[i] - self.softness * h[i] + if i == 1 { push } else { 0.0 };
                self.speed[i] +=
                    small * if i < 3 { force / MASS + GRAVITY[i] } else { force / INERTIA };
            }
            let (theta, omega) = (angular(&pose), angular(&self.speed));
            let t: @REAL@ = theta.iter().map(|x| x * x).sum();
            let g = 1.0 / 12.0 + t * (1.0 / 720.0 + t * (1.0 / 30240.0 + t / 1209600.0));
            let once = cross(&theta, &omega);
            let twice = cross(&theta, &once);
            for i in 0..3 {
                self.moved[i] += small * self.speed[i];
                self.moved[3 + i] += small * (omega[i] - 0.5 * once[i] + g * twice[i]);
            }
        }
    }
}

fn main() -> Result<(), String> {
    let mut controller = Controller::new(HELD).ok_or("not held: the model has no wrench there")?;
    let mut plant = Plant::new(&controller, 0.8, DELAY_STEPS);
    // Moves a free platform by 1 mm.
    let push = 0.001 * MASS * BANDWIDTH * BANDWIDTH;
    let time = |step: usize| 1e3 * DT * (step + 1) as @REAL@;
    let (mut felt, mut error, mut worst): (@REAL@, @REAL@, usize) = (0.0, 0.0, 0);
@PRINTED@
    for step in 0..STEPS {
@+        let stored = controller.state.to_numbers();
@+        let twin = if step == STEPS / 2 { controller.reloaded(&stored) } else { None };
        let wrench = controller.step(&plant.pose());
@+        if step == STEPS / 2 {
@+            let again = twin.map(|mut twin| twin.step(&plant.pose()));
@+            if again != Some(wrench) {
@+                return Err("not held: the stored state went on with another wrench.".to_string());
@+            }
@+        }
        plant.step(wrench, if (500..700).contains(&step) { push } else { 0.0 });
        error = 0.0;
        for (i, moved) in plant.moved.iter().enumerate() {
            let e = moved.abs();
            let limit = if i < 3 { 0.05 } else { 0.5 };
            if e.is_nan() || e >= limit {
                return Err(format!(
                    "not held: after {:.0} ms {} has left the held pose by {e:.3e}. The loop is \
                     unstable here: export again with the mass, inertia and delay of this robot.",
                    time(step), COLUMNS[i]
                ));
            }
            if e > error {
                (error, worst) = (e, i);
            }
        }
        if step >= 500 {
            felt = felt.max(error);
        }
        if step % 500 == 499 {
            println!("{:5.0} ms: largest error {error:.3e} ({})", time(step), COLUMNS[worst]);
        }
    }
    if felt > 2e-5 && error < 1e-5 {
        println!("held: the push moved the platform by {felt:.3e}, at the end it is {error:.3e} away (m, rad)");
        return Ok(());
    }
    Err(format!(
        "not held: after {:.0} ms {} is still {error:.3e} from the held pose (at most 1e-5); the push \
         moved it by {felt:.3e} (at least 2e-5).",
        time(STEPS - 1), COLUMNS[worst]
    ))
}
