//! Parameters that follow readings: found, bounded, held where nothing tells them, never non-finite.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use ecm_poly::adapt::{Adapter, Noise, Outcome, Parameter, Prior, Reading, State};
use ecm_poly::{EnergyModel, Pose};
use ecm_se3::{Real, Vec6};
use proptest::prelude::*;

const GRAVITY: [f64; 3] = [-9.81, 0.0, 0.0];
const SD: [f64; 6] = [0.3, 0.3, 0.3, 0.015, 0.015, 0.015];

fn prior(start: f64, sd: f64, walk: f64, jumps: f64) -> Prior<f64> {
    let (low, high) = (start - 5.0 * sd, start + 5.0 * sd);
    Prior {
        start,
        sd,
        low,
        high,
        walk,
        jumps,
    }
}

/// Modulus, payload and zero.
fn adapter() -> Adapter<f64, 11> {
    let parameters = core::array::from_fn(|i| Parameter::ALL[i]);
    let priors = core::array::from_fn(|i| match i {
        0 => prior(1.0, 0.1, 0.1, 0.0),
        1 => prior(0.0, 1.0, 0.01, 1.0),
        2..5 => prior(0.0, 0.1, 1e-3, 1.0),
        5..8 => prior(0.0, 2.0, 1.0, 1.0),
        _ => prior(0.0, 0.06, 0.03, 1.0),
    });
    Adapter {
        parameters,
        priors,
        noise: Noise {
            wrench: [0.3, 0.015],
            pose: [2e-5, 2e-4],
            time_s: 0.0,
            model: [0.02, 1e-3],
            reach: [0.02, 0.3],
            rim: 3.0,
            middle: bent(0.0, 0.0),
            per_half_range: [0.0, 0.0, 0.0, 5.0, 2.5, 2.5],
        },
        gravity: GRAVITY,
        interval_s: 0.1,
    }
}

fn neck() -> EnergyModel {
    EnergyModel::from_json(include_str!("corpus/energy4.json")).unwrap()
}

/// Numbers that look normal: sums of twelve even ones, from a linear congruence.
struct Noisy(u64);

impl Noisy {
    fn next(&mut self) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            sum += (self.0 >> 11) as f64 / (1u64 << 53) as f64;
        }
        sum
    }
}

/// Bent by `a` about z and `b` about y.
fn bent(a: f64, b: f64) -> Vec6<f64> {
    [
        0.1034 - 0.015 * (a * a + b * b),
        0.045 * a,
        -0.045 * b,
        0.0,
        b,
        a,
    ]
}

fn circle(time: f64) -> Vec6<f64> {
    bent(0.3 * (1.3 * time).cos(), 0.3 * (1.3 * time).sin())
}

/// Both tilts on their own, so that the force along the axis changes.
fn free(time: f64) -> Vec6<f64> {
    bent(0.35 * (1.3 * time).sin(), 0.3 * (0.7 * time + 1.0).sin())
}

struct Plant {
    scale: f64,
    mass: f64,
    zero: [f64; 6],
    noise: Noisy,
}

impl Plant {
    fn new() -> Self {
        Self {
            scale: 1.0,
            mass: 0.0,
            zero: [0.0; 6],
            noise: Noisy(7),
        }
    }

    fn read(&mut self, model: &EnergyModel, p: &Vec6<f64>) -> Reading<f64> {
        let exact = Pose::from_array(p).unwrap();
        let turn = exact.base_from_top();
        let h = model.wrench_and_stiffness(&exact).0.to_array();
        let wrench = core::array::from_fn(|a| {
            let (i, block) = (a % 3, a - a % 3);
            let zero: f64 = (0..3).map(|j| turn[i][j] * self.zero[block + j]).sum();
            let weight = if a < 3 { -GRAVITY[a] * self.mass } else { 0.0 };
            self.scale * h[a] + zero + weight + SD[a] * self.noise.next()
        });
        let seen =
            core::array::from_fn(|i| p[i] + if i < 3 { 2e-5 } else { 2e-4 } * self.noise.next());
        let pose = Pose::from_array(&seen).unwrap();
        let (h, k) = model.wrench_and_stiffness(&pose);
        Reading {
            pose,
            wrench,
            predicted: h.to_array(),
            stiffness: k,
            branches: [[0.0; 6]; 2],
        }
    }
}

fn follow(
    adapter: &Adapter<f64, 11>,
    state: &mut State<f64, 11>,
    plant: &mut Plant,
    seconds: f64,
    way: fn(f64) -> Vec6<f64>,
) -> Vec<Outcome> {
    let model = neck();
    let steps = (seconds * 100.0) as usize;
    let seen = |i| plant.read(&model, &way(0.01 * i as f64));
    let readings: Vec<Reading<f64>> = (0..steps).map(seen).collect();
    readings
        .iter()
        .map(|reading| adapter.step(state, reading, 0.01))
        .collect()
}

fn sd(state: &State<f64, 11>, i: usize) -> f64 {
    state.covariance[i][i].sqrt()
}

#[test]
fn follows_the_modulus_while_it_moves_and_holds_it_at_rest() {
    let (adapter, mut plant) = (adapter(), Plant::new());
    plant.scale = 0.93;
    let mut state = adapter.init();
    follow(&adapter, &mut state, &mut plant, 20.0, free);
    let (scale, spread) = (state.values[0], sd(&state, 0));
    assert!(
        (scale - 0.93).abs() < 3.0 * spread && spread < 0.01,
        "{scale} {spread}"
    );
    let before = state.values[0];
    plant.scale = 0.5;
    // At rest the model's wrench is the noise of the pose alone, in hours of it as well.
    follow(&adapter, &mut state, &mut plant, 600.0, |_| bent(0.0, 0.0));
    assert!(
        (state.values[0] - before).abs() < 1e-3,
        "{} {before} {}",
        state.values[0],
        sd(&state, 0)
    );
}

#[test]
fn a_payload_is_told_from_the_zero_by_poses_that_turn_only() {
    let adapter = adapter();
    let ways: [fn(f64) -> Vec6<f64>; 2] = [free, |_| bent(0.1, 0.0)];
    for (turns, way) in [true, false].into_iter().zip(ways) {
        let (mut plant, mut state) = (Plant::new(), adapter.init());
        follow(&adapter, &mut state, &mut plant, 20.0, free);
        plant.mass = 0.5;
        let outcomes = follow(&adapter, &mut state, &mut plant, 2.0, way);
        assert!(outcomes.contains(&Outcome::Jumped));
        let (mass, spread) = (state.values[1], sd(&state, 1));
        assert!((mass - 0.5).abs() < 3.0 * spread, "{mass} {spread}");
        assert_eq!(spread < 0.05, turns, "{spread}");
    }
}

#[test]
fn a_circle_tells_the_modulus_from_nothing_and_says_so() {
    let adapter = adapter();
    let small: fn(f64) -> Vec6<f64> =
        |time| bent(0.01 * (1.3 * time).cos(), 0.01 * (1.3 * time).sin());
    for way in [circle, small] {
        let mut plant = Plant::new();
        plant.scale = 0.93;
        let mut state = adapter.init();
        // Ten minutes of noise of the pose are no information.
        for _ in 0..20 {
            follow(&adapter, &mut state, &mut plant, 30.0, way);
            let (scale, spread) = (state.values[0], sd(&state, 0));
            assert!((scale - 0.93).abs() < 3.0 * spread, "{scale} {spread}");
        }
        assert!(sd(&state, 0) > 0.03, "{}", sd(&state, 0));
    }
}

/// The same reading in single precision.
fn single(reading: &Reading<f64>) -> Reading<f32> {
    let six = |v: &Vec6<f64>| v.map(|x| x as f32);
    Reading {
        pose: Pose::from_array(&six(&reading.pose.to_array())).unwrap(),
        wrench: six(&reading.wrench),
        predicted: six(&reading.predicted),
        stiffness: reading.stiffness.each_ref().map(six),
        branches: reading.branches.each_ref().map(six),
    }
}

type Way<'a> = &'a dyn Fn(f64) -> Vec6<f64>;

#[test]
fn what_is_known_of_the_modulus_does_not_hold_it() {
    let pressed = |mut pose: Vec6<f64>| {
        pose[0] -= 5e-3;
        pose
    };
    let model = neck();
    // The way at its speed, and whether it tells nothing of the modulus.
    let ways: [(Way<'_>, f64, bool); 6] = [
        (&free, 1.0, false),
        (&free, 4.0, false),
        (&|time| pressed(free(time)), 2.0, false),
        (&circle, 1.0, true),
        (&circle, 4.0, true),
        (&|time| pressed(circle(time)), 1.0, true),
    ];
    for (way, speed, held) in ways {
        for rate in [20, 100, 500] {
            let mut plant = Plant::new();
            plant.scale = 0.93;
            let dt = 1.0 / f64::from(rate);
            let read = |i| plant.read(&model, &way(speed * dt * f64::from(i)));
            let readings: Vec<Reading<f64>> = (0..20 * rate).map(read).collect();
            let mut found = Vec::new();
            for sd in [0.05, 0.1, 0.2, 0.22, 0.5, 1.0] {
                let mut adapter = adapter();
                adapter.priors[0] = prior(1.0, sd, 0.1, 0.0);
                let narrow = adapter.narrowed::<f32>();
                let (mut state, mut other) = (adapter.init(), narrow.init());
                let mut seconds = Vec::new();
                for (i, reading) in readings.iter().enumerate() {
                    adapter.step(&mut state, reading, dt);
                    narrow.step(&mut other, &single(reading), dt as f32);
                    if (i + 1).is_multiple_of(rate as usize) {
                        seconds.push(adapter.is_held(&state, 0));
                    }
                }
                assert_eq!(adapter.is_held(&state, 0), held, "{speed} {rate} {sd}");
                assert_eq!(narrow.is_held(&other, 0), held, "{speed} {rate} {sd}");
                found.push(seconds);
            }
            assert!(found.iter().all(|one| *one == found[0]), "{found:?}");
        }
    }
}

/// Modulus, one share and the zero along x, with the branch that `branch` makes of h at a time.
fn with_share(branch: fn(f64, &Vec6<f64>) -> Vec6<f64>) -> [bool; 2] {
    let whole = adapter();
    let mut adapter = Adapter {
        parameters: [Parameter::Modulus, Parameter::ZeroFx, Parameter::ShareFirst],
        priors: [whole.priors[0], whole.priors[5], prior(0.0, 0.1, 0.02, 0.0)],
        noise: whole.noise,
        gravity: whole.gravity,
        interval_s: whole.interval_s,
    };
    adapter.priors[2].start = 0.1;
    let (mut plant, model) = (Plant::new(), neck());
    let mut state = adapter.init();
    for i in 0..2000 {
        let time = 0.01 * f64::from(i);
        let mut reading = plant.read(&model, &free(time));
        reading.branches[0] = branch(time, &reading.predicted);
        adapter.step(&mut state, &reading, 0.01);
    }
    // A place that no parameter has is held by nothing.
    assert!(!adapter.is_held(&state, 3) && !adapter.is_held(&state, usize::MAX));
    [0, 2].map(|i| adapter.is_held(&state, i))
}

#[test]
fn a_share_that_looks_like_the_modulus_holds_both_and_one_that_is_not_told_only_itself() {
    assert_eq!(with_share(|_, h| h.map(|x| 0.3 * x)), [true, true]);
    assert_eq!(with_share(|_, _| [0.0; 6]), [false, true]);
    let own = |time: f64, h: &Vec6<f64>| h.map(|x| 0.3 * x * (3.1 * time).cos());
    assert_eq!(with_share(own), [false, false]);
}

#[test]
fn a_pose_noise_that_is_stated_too_small_draws_nothing() {
    let (mut adapter, mut plant) = (adapter(), Plant::new());
    adapter.noise.pose = [1.5e-5, 1.5e-4];
    plant.scale = 0.93;
    let mut state = adapter.init();
    for _ in 0..10 {
        follow(&adapter, &mut state, &mut plant, 30.0, circle);
    }
    let (scale, spread) = (state.values[0], sd(&state, 0));
    assert!((scale - 0.93).abs() < 3.0 * spread, "{scale} {spread}");
}

#[test]
fn one_reading_in_an_interval_holds_the_modulus() {
    let (adapter, mut plant, model) = (adapter(), Plant::new(), neck());
    plant.scale = 0.93;
    let mut state = adapter.init();
    for i in 0..300 {
        let reading = plant.read(&model, &free(0.1 * f64::from(i)));
        adapter.step(&mut state, &reading, 0.1);
    }
    assert_eq!(state.values[0], 1.0);
}

#[test]
fn a_single_outlier_is_left_out() {
    let (adapter, mut plant, model) = (adapter(), Plant::new(), neck());
    let mut state = adapter.init();
    follow(&adapter, &mut state, &mut plant, 20.0, circle);
    let before = state.values;
    let mut reading = plant.read(&model, &circle(20.0));
    reading.wrench[1] += 1e4;
    assert_eq!(adapter.step(&mut state, &reading, 0.1), Outcome::LeftOut);
    assert_eq!(state.values, before);
    assert_ne!(
        follow(&adapter, &mut state, &mut plant, 0.2, circle)[19],
        Outcome::LeftOut
    );
}

#[test]
fn what_no_parameter_explains_asks_for_a_diagnosis_and_holds() {
    let (adapter, mut plant, model) = (adapter(), Plant::new(), neck());
    let mut state = adapter.init();
    follow(&adapter, &mut state, &mut plant, 20.0, circle);
    let mut steps = 0;
    let mut read = |state: &mut State<f64, 11>, i: i32| {
        let mut reading = plant.read(&model, &circle(0.1 * f64::from(i)));
        // A friction that no parameter has: its sign changes with each block.
        reading.wrench[1] += if i % 2 == 0 { 30.0 } else { -30.0 };
        adapter.step(state, &reading, 0.1)
    };
    while read(&mut state, steps) != Outcome::Diagnose {
        steps += 1;
        assert!(steps < 100);
    }
    let held = state;
    assert_eq!(read(&mut state, 1), Outcome::Diagnose);
    assert_eq!(state, held);
    state.resume(&adapter);
    assert_eq!(state.values, held.values);
    assert_eq!(state.covariance, adapter.init().covariance);
    assert_eq!(state.held, 0);
}

/// Circles, and every half minute a few seconds twisted to 1.2 times the range.
fn beyond_the_rim(time: f64) -> Vec6<f64> {
    let mut pose = circle(time);
    let since = time % 30.0 - 25.0;
    if since > 0.0 {
        pose[3] = 0.24 * (core::f64::consts::PI * since / 5.0).sin();
    }
    pose
}

#[test]
fn a_model_that_errs_most_beyond_its_rim_asks_for_no_diagnosis_and_draws_nothing() {
    let model = neck();
    // 1.2 N and 40 mN m where it is twisted most, as the polynomial grows; 0.02 N and 1 mN m are stated.
    let grown = |p: &Vec6<f64>| (p[3] / 0.24).powi(6);
    for (rim, right) in [(20.0, true), (1.0, false)] {
        let (mut adapter, mut plant) = (adapter(), Plant::new());
        adapter.noise.rim = rim;
        let mut state = adapter.init();
        let mut alarm = false;
        for i in 0..20_000 {
            let pose = beyond_the_rim(0.01 * f64::from(i));
            let mut reading = plant.read(&model, &pose);
            reading.wrench[0] += 1.2 * grown(&pose);
            reading.wrench[3] += 0.04 * grown(&pose);
            alarm |= adapter.step(&mut state, &reading, 0.01) == Outcome::Diagnose;
        }
        assert_eq!(alarm, !right, "{rim}");
        if right {
            let torque = (state.values[8] / sd(&state, 8)).abs();
            assert!(torque < 3.0, "{torque}");
        }
    }
}

#[test]
fn standing_for_hours_keeps_the_covariance_and_what_nothing_tells() {
    let (adapter, model) = (adapter(), neck());
    let (mut plant, mut state) = (Plant::new(), adapter.init());
    plant.zero = [1.0, 0.5, 0.0, 0.02, 0.0, 0.0];
    let p = bent(0.1, 0.05);
    let mut early = state;
    for i in 0..36_000 {
        let reading = plant.read(&model, &p);
        assert_ne!(adapter.step(&mut state, &reading, 1.0), Outcome::Diagnose);
        for j in 0..11 {
            let share = sd(&state, j) / adapter.priors[j].sd;
            assert!(share <= 1.1, "{j}: {share} at {i}");
        }
        if i == 600 {
            early = state;
        }
    }
    // Ten hours later what the mean reading tells is as it was, and the split is no other.
    for j in 0..11 {
        let wandered = (state.values[j] - early.values[j]).abs();
        assert!(wandered < 0.5 * adapter.priors[j].sd, "{j}: {wandered}");
    }
}

/// Variance of the mass after a minute in which nothing is told, from none at all.
fn walked<R: Real>(adapter: &Adapter<R, 11>) -> f64 {
    let mut state = adapter.init();
    state.covariance = [[R::ZERO; 11]; 11];
    let reading = Reading {
        pose: Pose::from_array(&[
            R::from_f64(0.1),
            R::ZERO,
            R::ZERO,
            R::ZERO,
            R::ZERO,
            R::ZERO,
        ])
        .unwrap(),
        wrench: [R::ZERO; 6],
        predicted: [R::ZERO; 6],
        stiffness: [[R::ZERO; 6]; 6],
        branches: [[R::ZERO; 6]; 2],
    };
    for _ in 0..3000 {
        adapter.step(&mut state, &reading, R::from_f64(0.02));
    }
    state.covariance[1][1].to_f64()
}

#[test]
fn slow_walks_are_not_lost_in_single_precision() {
    let (double, single) = (walked(&adapter()), walked(&adapter().narrowed::<f32>()));
    assert!(double > 1e-7, "{double}");
    assert!((single / double - 1.0).abs() < 0.01, "{single} {double}");
}

#[test]
fn a_saved_state_goes_on_with_the_same_bits() {
    let (adapter, mut plant, model) = (adapter(), Plant::new(), neck());
    let mut state = adapter.init();
    follow(&adapter, &mut state, &mut plant, 3.05, circle);
    let mut saved = state;
    for i in 0..500 {
        let reading = plant.read(&model, &circle(0.01 * f64::from(i)));
        assert_eq!(
            adapter.step(&mut state, &reading, 0.01),
            adapter.step(&mut saved, &reading, 0.01)
        );
        assert_eq!(state, saved);
    }
}

#[test]
fn bounds_hold() {
    let (mut adapter, mut plant) = (adapter(), Plant::new());
    adapter.priors[0].low = 0.95;
    plant.scale = 0.9;
    let mut state = adapter.init();
    follow(&adapter, &mut state, &mut plant, 10.0, free);
    // 0.9 without the bound; it may move away from the bound again.
    assert!(
        (0.95..0.96).contains(&state.values[0]),
        "{}",
        state.values[0]
    );
}

#[test]
fn settings_name_what_is_wrong() {
    let read = |text: &str| {
        Adapter::<f64, 1>::from_document(
            serde_json::from_str::<serde_json::Value>(text)
                .unwrap()
                .as_object()
                .unwrap(),
        )
    };
    let text = r#"{"parameters": {"modulus": {"start": 1, "sd": 0.1, "low": 0.5, "high": 2, "walk": 0.1, "jumps": 0}},
        "noise": {"wrench": [0.3, 0.015], "pose": [4e-5, 4e-4], "time_s": 0, "model": [0.02, 1e-3], "reach": [0.01, 0.2],
            "rim": 3, "middle": [0.1, 0, 0, 0, 0, 0], "per_half_range": [0, 0, 0, 5, 2.5, 2.5]},
        "gravity": [-9.81, 0, 0], "interval_s": 0.1}"#;
    assert!(read(text).is_ok());
    for (from, to, named) in [
        ("modulus", "module", "module"),
        ("\"low\": 0.5", "\"low\": 1.5", "modulus"),
        ("0.3, 0.015", "0.0, 0.015", "noise"),
        ("\"rim\": 3", "\"rim\": 0.5", "rim"),
        ("0, 0, 0, 5, 2.5", "0, 0, 0, -5, 2.5", "per_half_range"),
        ("\"interval_s\": 0.1", "\"interval_s\": 0", "interval_s"),
        ("-9.81, 0, 0", "-9.81, 0", "gravity"),
    ] {
        let error = read(&text.replace(from, to)).unwrap_err().to_string();
        assert!(error.contains(named), "{error}");
    }
}

fn hostile() -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => -50.0..50.0f64,
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY)],
        1 => prop_oneof![Just(0.0), Just(1e300), Just(-1e308), Just(1e-310), Just(1e30), Just(3e38)],
    ]
}

type Row = (Vec<f64>, f64, [f64; 2]);

fn rows() -> impl Strategy<Value = Vec<Row>> {
    let values = proptest::collection::vec(hostile(), 30);
    let dt = prop_oneof![
        6 => Just(0.1), 1 => Just(1e-3), 1 => Just(3600.0), 1 => hostile()
    ];
    let turn = proptest::array::uniform2(-0.5..0.5f64);
    proptest::collection::vec((values, dt, turn), 1..40)
}

fn survives<R: Real>(adapter: &Adapter<R, 11>, rows: &[Row]) {
    let mut state = adapter.init();
    for (values, dt, [a, b]) in rows {
        let six = |from: usize| core::array::from_fn(|j| R::from_f64(values[from + j]));
        let reading = Reading {
            pose: Pose::checked(&bent(*a, *b).map(R::from_f64)).unwrap(),
            wrench: six(0),
            predicted: six(6),
            stiffness: core::array::from_fn(|i| {
                core::array::from_fn(|j| {
                    R::from_f64(values[12 + (i * 6 + j) % 6] * if i == j { 100.0 } else { 1.0 })
                })
            }),
            branches: [six(18), six(24)],
        };
        let before = state;
        if adapter.step(&mut state, &reading, R::from_f64(*dt)) == Outcome::Refused {
            assert!(before == state);
        }
        let sums = state.block.iter().flat_map(|b| {
            let rows = [&b.pose, &b.wrench, &b.predicted].into_iter();
            rows.chain(&b.branches).flatten()
        });
        let numbers = state
            .values
            .iter()
            .chain(state.covariance.as_flattened())
            .chain(state.model.cross.as_flattened().as_flattened())
            .chain(state.excitation.as_flattened())
            .chain(state.information.as_flattened())
            .chain([&state.of_noise])
            .chain(sums);
        assert!(
            numbers
                .chain(&state.last)
                .chain(&state.window)
                .all(|x| x.is_finite()),
            "{state:?}"
        );
        for (i, prior) in adapter.priors.iter().enumerate() {
            assert!(state.values[i] >= prior.low && state.values[i] <= prior.high);
            // A jump opens it beyond that of the start.
            assert!(state.covariance[i][i] <= prior.sd * prior.sd * R::from_f64(20.0));
            assert!(state.covariance[i][i] >= R::ZERO);
        }
    }
}

proptest! {
    #![proptest_config(common::config(300))]

    #[test]
    fn no_number_makes_the_state_non_finite(rows in rows()) {
        survives(&adapter(), &rows);
        survives(&adapter().narrowed::<f32>(), &rows);
    }
}
