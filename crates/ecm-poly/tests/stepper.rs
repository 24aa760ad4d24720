//! Effects of time in steps: exact in dt, derivative of themselves, passive, and turned with the body.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use ecm_poly::stepper::{Branch, Effects, Inputs, SPRINGS, Softening, State, Stepper, diagonal};
use ecm_poly::{EnergyModel, Pose, Wrench};
use ecm_se3::linear::{Mat3, Vec3, apply, apply_transposed, cross};
use ecm_se3::{Mat6, Vec6, half_rotation, rotation_matrix, rotation_vector};
use proptest::prelude::*;

const LENGTH: f64 = 0.1034;

fn neck() -> EnergyModel {
    EnergyModel::from_json(include_str!("corpus/energy4.json")).unwrap()
}

/// Relaxation of both kinds, friction, and with `all` what scales or damps the wrench.
fn effects(all: bool) -> Effects<f64> {
    let branch = |share, tau_s, linear| Branch {
        share,
        tau_s,
        linear,
    };
    let stiffness = [4.2e4, 5.1e3, 5.1e3, 9.0, 19.0, 19.0];
    let mut effects = Effects::none(LENGTH);
    effects.stiffness = diagonal(&stiffness);
    effects.branches = [branch(0.3, 2.0, true), branch(0.2, 40.0, !all)];
    effects.friction = diagonal(&stiffness.map(|k| 0.2 * k));
    effects.slip = [1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2];
    if all {
        effects.softer_per_kelvin = 4e-3;
        effects.reference_degc = 21.0;
        effects.growth_per_kelvin = 3e-5;
        effects.ageing_per_s = 1e-6;
        effects.settling_per_s = 1e-4;
        effects.damping = diagonal(&[30.0, 30.0, 30.0, 0.1, 0.1, 0.1]);
        effects.softening.share = 0.08;
        effects.set_share = 0.02;
    }
    effects
}

/// The pose of mid-frame coordinates.
fn pose(q: &Vec6<f64>) -> Pose<f64> {
    let theta = [q[3], q[4], q[5]];
    let r = apply(&half_rotation(&theta), &[LENGTH + q[0], q[1], q[2]]);
    Pose::from_array(&[r[0], r[1], r[2], q[3], q[4], q[5]]).unwrap()
}

/// Coordinates up to 8 mm and 0.4 rad.
fn point() -> impl Strategy<Value = Vec6<f64>> {
    proptest::array::uniform6(-1.0..1.0f64)
        .prop_map(|x| core::array::from_fn(|j| x[j] * if j < 3 { 8e-3 } else { 0.4 }))
}

/// By work, bend, distance and force, as a straight line and with a width.
fn softening() -> impl Strategy<Value = Softening<f64>> {
    let measures = [
        ([0.0; 6], [0.0; 6], 0.1, false),
        ([0.0, 0.0, 0.0, 1.0, 1.0, 1.0], [0.0; 6], 0.2, true),
        (
            [1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH],
            [0.0; 6],
            0.01,
            true,
        ),
        ([0.0; 6], [1.0, 1.0, 1.0, 0.0, 0.0, 0.0], 30.0, false),
    ];
    (proptest::sample::select(measures.to_vec()), any::<bool>()).prop_map(
        |((of_pose, of_wrench, width, hyperbolic), straight)| Softening {
            share: 0.2,
            width: if straight { 0.0 } else { width },
            hyperbolic,
            of_pose,
            of_wrench,
        },
    )
}

fn way() -> impl Strategy<Value = Vec<(Vec6<f64>, f64)>> {
    let dt = (-4.0..4.0f64).prop_map(|x| 10f64.powf(x));
    proptest::collection::vec((point(), dt), 2..8)
}

fn between(a: &Vec6<f64>, b: &Vec6<f64>, share: f64) -> Vec6<f64> {
    core::array::from_fn(|j| a[j] + share * (b[j] - a[j]))
}

fn largest(rows: &Mat6<f64>) -> f64 {
    rows.as_flattened().iter().fold(0.0, |m, x| x.abs().max(m))
}

/// Difference of two wrenches over the size of the mechanism's forces and moments.
fn difference(a: &Wrench<f64>, b: &Wrench<f64>) -> f64 {
    let (a, b) = (a.to_array(), b.to_array());
    (0..6).fold(0.0, |m, j| {
        f64::max(m, (a[j] - b[j]).abs() / if j < 3 { 100.0 } else { 5.0 })
    })
}

proptest! {
    #![proptest_config(common::config(64))]

    #[test]
    fn the_tangent_is_the_derivative_of_the_step(
        way in way(), softening in softening(), springs in 1..=SPRINGS, of_pose in any::<bool>()
    ) {
        let model = neck();
        let effects = Effects { softening, springs, of_pose, ..effects(true) };
        let stepper = Stepper { model: &model, effects };
        let inputs = Inputs { temperature_degc: 27.0, age_s: 5e3 };
        let mut state = stepper.init(&pose(&way[0].0)).unwrap();
        for (q, dt) in &way[1..] {
            let before = state;
            let p = pose(q).to_array();
            let (_, tangent) = stepper.step(&mut state, &pose(q), *dt, &inputs).unwrap();
            let at = |j: usize, e: f64| {
                let mut moved = p;
                moved[j] += e;
                let mut state = before;
                let h = stepper.step(&mut state, &Pose::from_array(&moved).unwrap(), *dt, &inputs);
                let all = std::iter::once(&state.stretch).chain(&state.further).take(springs);
                let sticks = all.enumerate().flat_map(|(s, stretches)| {
                    let share = (2 * s + 1) as f64 / springs as f64;
                    let limits = stepper.effects.slip.map(|limit| share * limit * (1.0 - 1e-12));
                    stretches.iter().zip(limits).map(|(z, y)| z.abs() < y).collect::<Vec<_>>()
                });
                (h.unwrap().0.to_array(), sticks.collect::<Vec<_>>(),
                 state.largest > before.largest)
            };
            for j in 0..6 {
                let e = if j < 3 { 1e-7 } else { 1e-6 };
                let (up, stuck, grown) = at(j, e);
                let (down, stuck_below, grown_below) = at(j, -e);
                // At the edge of slipping or of the largest load there is no derivative.
                if stuck != stuck_below || grown != grown_below {
                    continue;
                }
                for i in 0..6 {
                    let slope = (up[i] - down[i]) / (2.0 * e);
                    let size = largest(&tangent) * if i < 3 { 1.0 } else { 0.1 };
                    prop_assert!((slope - tangent[i][j]).abs() < 1e-6 * size, "{i} {j}: {slope} {}",
                        tangent[i][j]);
                }
            }
        }
    }

    #[test]
    fn what_lies_ahead_is_what_the_steps_will_be(way in way()) {
        let model = neck();
        let stepper = Stepper { model: &model, effects: effects(true) };
        let inputs = Inputs { temperature_degc: 27.0, age_s: 5e3 };
        let mut state = stepper.init(&pose(&way[0].0)).unwrap();
        stepper.step(&mut state, &pose(&way[1].0), 0.3, &inputs).unwrap();
        let before = state;
        let path: Vec<_> = way.iter().map(|(q, _)| pose(q)).collect();
        let ahead: Vec<_> = stepper.predict_ahead(&state, path.clone(), 0.02, &inputs).collect();
        prop_assert_eq!(state, before);
        let taken = path.iter().map(|p| stepper.step(&mut state, p, 0.02, &inputs).unwrap());
        prop_assert_eq!(ahead, taken.collect::<Vec<_>>());
        // It ends where a step would be refused.
        let beyond = Pose::from_array(&[1e200, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
        let blocked = [path[0], beyond, path[1]];
        prop_assert_eq!(stepper.predict_ahead(&state, blocked, 0.02, &inputs).count(), 1);
    }

    #[test]
    fn a_state_goes_through_its_numbers(way in way()) {
        let model = neck();
        let stepper = Stepper { model: &model, effects: effects(true) };
        let mut state = stepper.init(&pose(&way[0].0)).unwrap();
        stepper.step(&mut state, &pose(&way[1].0), 0.3, &stepper.effects.default_inputs()).unwrap();
        let mut numbers = state.to_numbers();
        prop_assert_eq!(State::from_numbers(&numbers), Some(state));
        numbers[way.len() * 6] = f64::NAN;
        prop_assert_eq!(State::from_numbers(&numbers), None);
    }

    #[test]
    fn a_straight_way_may_be_cut_anywhere(way in way(), share in 0.0..1.0f64) {
        let model = neck();
        let mut effects = effects(false);
        effects.branches[1].linear = true;
        let stepper = Stepper { model: &model, effects };
        let inputs = effects.default_inputs();
        let mut whole = stepper.init(&pose(&way[0].0)).unwrap();
        let mut parts = whole;
        for pair in way.windows(2) {
            let (from, (to, dt)) = (&pair[0].0, &pair[1]);
            let (h, _) = stepper.step(&mut whole, &pose(to), *dt, &inputs).unwrap();
            let middle = pose(&between(from, to, share));
            stepper.step(&mut parts, &middle, share * dt, &inputs).unwrap();
            let (cut, _) = stepper.step(&mut parts, &pose(to), (1.0 - share) * dt, &inputs).unwrap();
            prop_assert!(difference(&h, &cut) < 1e-11, "{h:?} {cut:?}");
        }
    }

    #[test]
    fn after_a_long_rest_it_is_settled(way in way()) {
        let model = neck();
        let mut effects = effects(true);
        effects.friction = [[0.0; 6]; 6];
        effects.softening.share = 0.0;
        effects.set_share = 0.0;
        let stepper = Stepper { model: &model, effects };
        let inputs = Inputs { temperature_degc: 15.0, age_s: 0.0 };
        let mut state = stepper.init(&pose(&way[0].0)).unwrap();
        for (q, dt) in &way {
            stepper.step(&mut state, &pose(q), *dt, &inputs).unwrap();
        }
        let last = pose(&way[way.len() - 1].0);
        let (settled, k) = stepper.settled(&last, &inputs).unwrap();
        for (hours, tolerance) in [(1.0, 1e-12), (1e6, 1e-12), (1e300, 1e-12)] {
            let mut state = state;
            let (h, tangent) = stepper.step(&mut state, &last, 3600.0 * hours, &inputs).unwrap();
            prop_assert!(difference(&h, &settled) < tolerance);
            // A later move still meets what relaxes during it: the share falls with 1/dt.
            let beside = core::array::from_fn(|i| core::array::from_fn(|j| tangent[i][j] - k[i][j]));
            prop_assert!(largest(&beside) < (0.03 / hours + 1e-12) * largest(&k));
        }
    }

    #[test]
    fn no_energy_from_nothing(way in way()) {
        let model = neck();
        let effects = effects(false);
        let stepper = Stepper { model: &model, effects };
        let inputs = effects.default_inputs();
        let mut state = stepper.init(&pose(&way[0].0)).unwrap();
        let closed: Vec<_> = way.iter().cycle().take(2 * way.len() + 1).collect();
        let (mut work, mut moved, mut before) = (0.0, 0.0, way[0].0);
        for (q, dt) in &closed[1..] {
            for i in 1..=8 {
                let next = between(&before, q, f64::from(i) / 8.0);
                let last = between(&before, q, f64::from(i - 1) / 8.0);
                let p = pose(&next);
                let (h, _) = stepper.step(&mut state, &p, dt / 8.0, &inputs).unwrap();
                let (elastic, _) = model.wrench_and_stiffness(&p);
                let beside = Wrench::from_array(&core::array::from_fn(|j| {
                    h.to_array()[j] - elastic.to_array()[j]
                }));
                // Held over the step, as a controller would: the elastic part has an energy.
                let force = ecm_se3::mid_frame::MidFrame::new(&p, LENGTH).generalised_force(&beside);
                for j in 0..6 {
                    let part = force[j] * (next[j] - last[j]);
                    work += part;
                    moved += part.abs();
                }
            }
            before = *q;
        }
        prop_assert!(work >= -1e-11 * moved, "{work} of {moved}");
    }

    #[test]
    fn a_turn_and_an_exchange_of_the_ends_change_nothing(way in way(), angle in -3.0..3.0f64) {
        let model = neck();
        // Without damping, which is one of the top frame, W and set, which are of the pose, and friction,
        // whose springs slip along two fixed axes.
        let mut effects = effects(true);
        effects.damping = [[0.0; 6]; 6];
        effects.softening.share = 0.0;
        effects.set_share = 0.0;
        effects.friction = [[0.0; 6]; 6];
        let stepper = Stepper { model: &model, effects };
        let inputs = effects.default_inputs();
        let turn = rotation_matrix(&[angle, 0.0, 0.0]);
        let seen: [View<'_>; 3] = [&|p| *p, &|p| turned(&turn, p), &exchanged];
        let mut states: Vec<State<f64>> =
            seen.iter().map(|see| stepper.init(&see(&pose(&way[0].0))).unwrap()).collect();
        for (q, _) in &way[1..] {
            let p = pose(q);
            let found: Vec<Wrench<f64>> = (seen.iter().zip(&mut states))
                .map(|(see, state)| stepper.step(state, &see(&p), 0.5, &inputs).unwrap().0)
                .collect();
            let expected = Wrench {
                force: apply(&turn, &found[0].force),
                torque: apply(&turn, &found[0].torque),
            };
            prop_assert!(difference(&found[1], &expected) < 1e-10);
            prop_assert!(difference(&found[2], &at_other_end(&p, &found[0])) < 1e-10);
        }
    }
}

/// A pose as it is seen by a frame or from the other end.
type View<'a> = &'a dyn Fn(&Pose<f64>) -> Pose<f64>;

fn turned(turn: &Mat3<f64>, p: &Pose<f64>) -> Pose<f64> {
    let (r, t) = (apply(turn, p.position()), apply(turn, p.rotation_vector()));
    Pose::from_array(&[r[0], r[1], r[2], t[0], t[1], t[2]]).unwrap()
}

/// Half a turn about y, which takes the axis of one end to that of the other.
fn flipped(v: &Vec3<f64>) -> Vec3<f64> {
    [-v[0], v[1], -v[2]]
}

/// The base seen from the top: base' = top F, top' = base F.
fn exchanged(p: &Pose<f64>) -> Pose<f64> {
    let rotation = p.base_from_top();
    let r = flipped(&apply_transposed(&rotation, p.position()).map(|x| -x));
    // F' R' F, as the rotation vector -F theta.
    let t = flipped(&p.rotation_vector().map(|x| -x));
    debug_assert!(rotation_vector(&rotation_matrix(&t)).is_ok());
    Pose::from_array(&[r[0], r[1], r[2], t[0], t[1], t[2]]).unwrap()
}

/// The wrench on the base in the axes of `exchanged`.
fn at_other_end(p: &Pose<f64>, h: &Wrench<f64>) -> Wrench<f64> {
    let back = |v: &Vec3<f64>| flipped(&apply_transposed(&p.base_from_top(), &v.map(|x| -x)));
    let lever = cross(p.position(), &h.force);
    Wrench {
        force: back(&h.force),
        torque: back(&core::array::from_fn(|i| h.torque[i] + lever[i])),
    }
}

#[test]
fn what_cannot_be_a_step_is_refused_and_leaves_the_state() {
    let model = neck();
    let stepper = Stepper {
        model: &model,
        effects: effects(true),
    };
    let inputs = stepper.effects.default_inputs();
    let rest = Pose::at_rest(LENGTH);
    let bent = pose(&[1e-3, 2e-3, 0.0, 0.0, 0.1, 0.2]);
    let mut state = stepper.init(&rest).unwrap();
    stepper.step(&mut state, &bent, 0.1, &inputs).unwrap();
    let before = state;
    let hot = Inputs {
        temperature_degc: f64::NAN,
        ..inputs
    };
    let beyond = Pose::from_array(&[1e200, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
    for (p, dt, inputs) in [
        (bent, -1e-3, inputs),
        (bent, f64::NAN, inputs),
        (bent, f64::INFINITY, inputs),
        (bent, 1e-3, hot),
        (beyond, 1e-3, inputs),
    ] {
        assert_eq!(stepper.step(&mut state, &p, dt, &inputs), None);
        assert_eq!(state, before);
    }
    // Far outside the training data, but a pose: finite, and it recovers.
    let far = pose(&[0.05, 0.05, -0.05, 1.0, 1.0, 1.0]);
    let (h, k) = stepper.step(&mut state, &far, 1e-3, &inputs).unwrap();
    assert!(
        h.to_array()
            .iter()
            .chain(k.as_flattened())
            .all(|x| x.is_finite())
    );
}

/// The rest pose has moved by the share of the farthest pose, and stays there.
#[test]
fn a_set_moves_the_rest_pose() {
    let model = neck();
    let mut effects = Effects::none(LENGTH);
    effects.set_share = 0.02;
    let stepper = Stepper {
        model: &model,
        effects,
    };
    let inputs = effects.default_inputs();
    let far = pose(&[2e-3, 6e-3, 0.0, 0.1, 0.0, 0.3]).to_array();
    let rest = Pose::at_rest(LENGTH).to_array();
    let mut state = stepper.init(&Pose::at_rest(LENGTH)).unwrap();
    for share in [0.5, 1.0, 0.4, -0.3] {
        let p = core::array::from_fn(|j| rest[j] + share * (far[j] - rest[j]));
        stepper
            .step(&mut state, &Pose::from_array(&p).unwrap(), 0.1, &inputs)
            .unwrap();
    }
    let moved = core::array::from_fn(|j| rest[j] + 0.02 * (far[j] - rest[j]));
    let at_set = Pose::from_array(&moved).unwrap();
    let (h, k) = stepper.step(&mut state, &at_set, 0.1, &inputs).unwrap();
    let (unloaded, stiffness) = model.wrench_and_stiffness(&Pose::at_rest(LENGTH));
    assert!(difference(&h, &unloaded) < 1e-12);
    assert!(largest(&k) - largest(&stiffness) < 1e-9 * largest(&k));
}

#[test]
fn inputs_are_inside_their_ranges_or_not() {
    let mut effects = Effects::<f64>::none(LENGTH);
    effects.temperature_range_degc = Some([15.0, 30.0]);
    effects.age_range_s = Some([0.0, 60.0]);
    let inside = |temperature_degc, age_s| {
        effects.inputs_inside(&Inputs {
            temperature_degc,
            age_s,
        })
    };
    assert!(inside(15.0, 0.0) && inside(30.0, 60.0));
    assert!(!inside(14.9, 0.0) && !inside(20.0, 61.0) && !inside(f64::NAN, 1.0));
}

#[test]
fn a_state_is_plain_numbers_of_at_most_600_bytes() {
    assert_eq!(
        size_of::<State<f64>>(),
        8 * ecm_poly::stepper::STATE_NUMBERS
    );
    assert!(size_of::<State<f64>>() <= 600);
}

#[test]
fn slow_branches_fade_in_single_precision_as_well() {
    // An hour of steps of a millisecond would be long; ten seconds of tau = 1e4 s show it.
    struct Spring;
    impl ecm_poly::stepper::Elastic<f32> for Spring {
        fn wrench_and_stiffness(&self, _: &Pose<f32>) -> (Wrench<f32>, Mat6<f32>) {
            (Wrench::default(), [[0.0; 6]; 6])
        }
    }
    let mut effects = Effects::<f32>::none(0.1);
    effects.stiffness = diagonal(&[1e4; 6]);
    effects.branches[0] = Branch {
        share: 1.0,
        tau_s: 1e5,
        linear: true,
    };
    let stepper = Stepper {
        model: &Spring,
        effects,
    };
    let inputs = effects.default_inputs();
    let mut state = stepper.init(&Pose::at_rest(0.1)).unwrap();
    let moved = Pose::at_rest(0.11);
    let (sudden, _) = stepper.step(&mut state, &moved, 0.0, &inputs).unwrap();
    let mut last = sudden;
    for _ in 0..100_000 {
        (last, _) = stepper.step(&mut state, &moved, 1e-3, &inputs).unwrap();
    }
    let fallen = 1.0 - f64::from(last.force[0]) / f64::from(sudden.force[0]);
    assert!((fallen / 1e-3 - 1.0).abs() < 0.01, "{fallen}");
}

/// A spring of 100 N/m along x, with what a branch and friction add to its force and stiffness.
#[test]
fn a_single_coordinate_is_the_first_of_six() {
    struct Spring;
    impl ecm_poly::stepper::Elastic<f64> for Spring {
        fn wrench_and_stiffness(&self, pose: &Pose<f64>) -> (Wrench<f64>, Mat6<f64>) {
            let (mut wrench, mut stiffness) = ([0.0; 6], [[0.0; 6]; 6]);
            (wrench[0], stiffness[0][0]) = (100.0 * pose.to_array()[0], 100.0);
            (Wrench::from_array(&wrench), stiffness)
        }
    }
    let steps = |effects: Effects<f64>, way: &[(f64, f64)]| -> Vec<[f64; 2]> {
        let model = &Spring;
        let stepper = Stepper { model, effects };
        let mut state = stepper.init(&Pose::at_rest(0.0)).unwrap();
        let step = |(x, dt): &(f64, f64)| {
            let inputs = effects.default_inputs();
            let found = stepper.step(&mut state, &Pose::at_rest(*x), *dt, &inputs);
            let (h, k) = found.unwrap();
            assert_eq!(
                (&h.to_array()[1..], &k[0][1..]),
                (&[0.0; 5][..], &[0.0; 5][..])
            );
            [h.force[0], k[0][0]]
        };
        way.iter().map(step).collect()
    };
    let mut relaxes = Effects::none(0.0);
    relaxes.stiffness[0][0] = 100.0;
    relaxes.branches[0] = Branch {
        share: 0.5,
        tau_s: 1.0,
        linear: true,
    };
    assert_eq!(steps(relaxes, &[(0.1, 0.0)]), [[15.0, 150.0]]);
    let mut rubs = Effects::none(0.0);
    (rubs.friction[0][0], rubs.slip[0]) = (20.0, 0.05);
    let there_and_back = steps(rubs, &[(0.1, 0.1), (0.075, 0.1)]);
    assert_eq!(there_and_back, [[11.0, 100.0], [8.0, 120.0]]);
    // Nothing is added within a play: on the way there, and on the way back after the slip.
    rubs.play[0] = 0.025;
    let way = [(0.01, 0.1), (0.1, 0.1), (0.0625, 0.1), (0.015625, 0.1)];
    let found = steps(rubs, &way);
    assert_eq!(found[..3], [[1.0, 100.0], [10.5, 100.0], [6.25, 100.0]]);
    assert!((found[3][0] - (1.5625 + 20.0 * (0.015625 - 0.05 + 0.025))).abs() < 1e-12);
    assert_eq!(found[3][1], 120.0);
}

/// Two of three springs have one limit; what slips along x has no hold along y.
#[test]
fn springs_that_slip_as_one_pull_against_the_way() {
    struct Nothing;
    impl ecm_poly::stepper::Elastic<f64> for Nothing {
        fn wrench_and_stiffness(&self, _: &Pose<f64>) -> (Wrench<f64>, Mat6<f64>) {
            (Wrench::from_array(&[0.0; 6]), [[0.0; 6]; 6])
        }
    }
    let mut effects = Effects::none(0.0);
    effects.columns = Some([[-1e3; 6], [1e3; 6]]);
    effects.friction = diagonal(&[300.0, 400.0, 0.0, 0.0, 0.0, 0.0]);
    (effects.slip[0], effects.slip[1], effects.together) = (0.1, 0.1, true);
    let model = &Nothing;
    let stepper = Stepper { model, effects };
    let inputs = effects.default_inputs();
    let at = |x: f64, y: f64| Pose::from_array(&[x, y, 0.5, 0.0, 0.0, 0.0]).unwrap();
    let mut state = stepper.init(&at(0.0, 0.0)).unwrap();
    let (h, _) = stepper
        .step(&mut state, &at(0.3, 0.4), 0.1, &inputs)
        .unwrap();
    let force = h.to_array();
    assert!((force[0] - 18.0).abs() < 1e-12 && (force[1] - 32.0).abs() < 1e-12);
    // Where nothing moves they hold: both springs' own stiffness.
    let (_, k) = stepper
        .step(&mut state, &at(0.3, 0.4), 0.1, &inputs)
        .unwrap();
    assert_eq!((k[0][0], k[1][1], k[0][1]), (300.0, 400.0, 0.0));
    // Along the way nothing is added, across it the rest of what holds.
    let (_, k) = stepper
        .step(&mut state, &at(0.36, 0.48), 0.1, &inputs)
        .unwrap();
    assert!((k[0][0] * 0.6 + k[0][1] * 0.8).abs() < 1e-9);
    assert!((k[0][0] * 0.8 - k[0][1] * 0.6 - 300.0 * 0.8 / 2.0).abs() < 1e-9);
}

/// A clock that ticks twice at once gives a dt whose inverse overflows.
#[test]
fn a_dt_that_is_hardly_any_is_a_sudden_move() {
    let model = neck();
    let stepper = Stepper {
        model: &model,
        effects: effects(true),
    };
    let rest = Pose::at_rest(LENGTH);
    let bent = Pose::from_array(&[0.1, 0.005, 0.0, 0.0, 0.0, 0.1]).unwrap();
    let inputs = stepper.effects.default_inputs();
    let mut sudden = stepper.init(&rest).unwrap();
    let mut short = sudden;
    for pose in [&bent, &bent] {
        let expected = stepper.step(&mut sudden, pose, 0.0, &inputs);
        let found = stepper.step(&mut short, pose, 1e-320, &inputs);
        assert_eq!(found, expected);
    }
}

#[test]
fn a_pose_beyond_the_limits_is_refused_and_the_state_stays() {
    let (model, mut effects) = (neck(), effects(false));
    effects.limits = Some([0.03, 1.2]);
    let stepper = Stepper {
        model: &model,
        effects,
    };
    let inputs = effects.default_inputs();
    let mut state = stepper.init(&Pose::at_rest(LENGTH)).unwrap();
    let near = pose(&[2e-3, 0.01, 0.0, 0.1, 0.0, 0.3]);
    stepper.step(&mut state, &near, 0.1, &inputs).unwrap();
    let kept = state;
    for far in [
        pose(&[0.0, 0.04, 0.0, 0.0, 0.0, 0.0]),
        pose(&[0.0, 0.0, 0.0, 0.0, 0.0, 1.3]),
        Pose::from_array(&[1e9, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap(),
    ] {
        assert!(stepper.step(&mut state, &far, 0.1, &inputs).is_none());
        assert!(stepper.init(&far).is_none());
        assert_eq!(state, kept);
    }
    assert!(stepper.step(&mut state, &near, 0.1, &inputs).is_some());
}

#[test]
fn a_step_is_the_static_wrench_and_the_shares_of_its_branches() {
    let (model, mut effects) = (neck(), effects(false));
    effects.friction = [[0.0; 6]; 6];
    let stepper = Stepper {
        model: &model,
        effects,
    };
    let inputs = effects.default_inputs();
    let mut state = stepper.init(&Pose::at_rest(LENGTH)).unwrap();
    for q in [
        [2e-3, 0.01, 0.0, 0.1, 0.0, 0.3],
        [-3e-3, 0.0, 5e-3, 0.0, -0.3, 0.1],
    ] {
        let (h, _) = stepper.step(&mut state, &pose(&q), 0.5, &inputs).unwrap();
        let (mut sum, _) = stepper.settled(&pose(&q), &inputs).unwrap();
        for (branch, wrench) in effects.branches.iter().zip(stepper.branches(&state)) {
            for j in 0..3 {
                sum.force[j] += branch.share * wrench[j];
                sum.torque[j] += branch.share * wrench[3 + j];
            }
        }
        assert!(difference(&h, &sum) < 1e-12);
    }
}
