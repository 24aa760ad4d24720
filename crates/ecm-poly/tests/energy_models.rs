//! Energies: recovered coefficients, symmetric Hessian, stiffness by finite differences, invariances.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use ecm_poly::arithmetic::Plain;
use ecm_poly::energy::terms::terms;
use ecm_poly::energy::{EnergyTerms, Group};
use ecm_poly::{EnergyFit, EnergyModel, Pose, Symmetry};
use ecm_se3::stiffness::StiffnessKind;
use proptest::prelude::*;

const LENGTH: f64 = 0.1034;
const SCALE: [f64; 2] = [0.03, 0.8];
const SYMMETRIES: [Symmetry; 3] = [Symmetry::Alike, Symmetry::Revolution, Symmetry::General];

/// Poses of the neck's workspace.
fn pose() -> impl Strategy<Value = [f64; 6]> {
    let c = prop::array::uniform3(-0.02..0.02_f64);
    let theta = prop::array::uniform3(-0.8..0.8_f64);
    (c, theta).prop_map(|(c, t)| [LENGTH + c[0], c[1], c[2], t[0], t[1], t[2]])
}

/// Coefficients that fall with the degree and keep the rest pose stable.
fn model(symmetry: Symmetry, degree: usize, seed: f64) -> EnergyModel {
    let rows = terms(symmetry, degree).unwrap();
    let coefficients: Vec<f64> = rows
        .iter()
        .enumerate()
        .map(|(i, row)| {
            let power: i32 = row.iter().map(|&e| i32::from(e)).sum();
            let wave = ((i as f64 + 1.0) * 12.9898 + seed).sin();
            wave * 0.5_f64.powi(power) + f64::from(row.contains(&2) && power == 2)
        })
        .collect();
    EnergyModel::from_coefficients(LENGTH, degree, symmetry, SCALE, &coefficients).unwrap()
}

fn largest(m: &[[f64; 6]; 6]) -> f64 {
    m.iter().flatten().fold(0.0, |a: f64, x| a.max(x.abs()))
}

proptest! {
    #![proptest_config(common::config(60))]

    #[test]
    fn stiffness_is_the_derivative_of_the_wrench(p in pose(), seed in 0.0..9.0_f64) {
        for symmetry in SYMMETRIES { for degree in [4, 6] {
            let m = model(symmetry, degree, seed);
            let k = m.stiffness(&[p], StiffnessKind::Partial).unwrap()[0];
            let h = m.stiffness(&[p], StiffnessKind::Generalised).unwrap()[0];
            let wrench = m.predict(&[p]).unwrap()[0];
            for j in 0..6 {
                // Fourth-order differences: the stiffness to 1e-7 of its largest entry.
                let e = if j < 3 { 1e-4 } else { 1e-3 };
                let at = |s: f64| { let mut x = p; x[j] += s * e; m.predict(&[x]).unwrap()[0] };
                let (a, b, c, d) = (at(-2.0), at(-1.0), at(1.0), at(2.0));
                let size = (0..6).fold(0.0_f64, |s, i| s.max(k[i][j].abs()));
                for i in 0..6 {
                    let rate = (a[i] - 8.0 * b[i] + 8.0 * c[i] - d[i]) / (12.0 * e);
                    prop_assert!((rate - k[i][j]).abs() < 1e-7 * size, "{symmetry:?} {i}{j} {rate} {}", k[i][j]);
                }
                let lower = |s: f64| { let mut x = p; x[j] += s * e; m.energy(&[x]).unwrap()[0] };
                let slope = (lower(-2.0) - 8.0 * lower(-1.0) + 8.0 * lower(1.0) - lower(2.0)) / (12.0 * e);
                let g = ecm_se3::Wrench::from_array(&wrench).generalised(&ecm_se3::Pose::from_array(&p).unwrap());
                prop_assert!((slope - g[j]).abs() < 1e-7 * (1.0 + g[j].abs()), "{slope} {}", g[j]);
            }
            for i in 0..6 { for j in 0..6 {
                prop_assert!((h[i][j] - h[j][i]).abs() <= 1e-12 * largest(&h));
            } }
        } }
    }

    #[test]
    fn a_body_of_revolution_turns_with_its_load(p in pose(), angle in -3.0..3.0_f64, seed in 0.0..9.0_f64) {
        for symmetry in [Symmetry::Alike, Symmetry::Revolution] {
            let m = model(symmetry, 6, seed);
            let turn = |v: &[f64; 6]| {
                let (s, c) = angle.sin_cos();
                [v[0], c * v[1] - s * v[2], s * v[1] + c * v[2], v[3], c * v[4] - s * v[5], s * v[4] + c * v[5]]
            };
            let mirror = |v: &[f64; 6]| [v[0], v[1], -v[2], -v[3], -v[4], v[5]];
            let h = m.predict(&[p, turn(&p), mirror(&p)]).unwrap();
            let (turned, mirrored) = (turn(&h[0]), mirror(&h[0]));
            for i in 0..6 {
                let size = h[0].iter().fold(1.0_f64, |a, x| a.max(x.abs()));
                prop_assert!((h[1][i] - turned[i]).abs() < 1e-12 * size);
                prop_assert!((h[2][i] - mirrored[i]).abs() < 1e-12 * size);
            }
        }
    }

    #[test]
    fn a_fit_finds_its_own_coefficients(
        poses in prop::collection::vec(pose(), 60), seed in 0.0..9.0_f64, correlation in -0.6..0.6_f64,
    ) {
        for (symmetry, degree) in [(Symmetry::Alike, 4), (Symmetry::Alike, 5), (Symmetry::Revolution, 4), (Symmetry::General, 4)] {
            let truth = model(symmetry, degree, seed);
            let wrenches = truth.predict(&poses).unwrap();
            let mut sigma = [[0.0; 6]; 6];
            for i in 0..6 {
                let sd = |i: usize| if i < 3 { 0.3 } else { 0.01 };
                for j in 0..6 { sigma[i][j] = sd(i) * sd(j) * if i == j { 1.0 } else { correlation / 6.0 }; }
            }
            let covariance = vec![sigma; poses.len()];
            for covariance in [None, Some(covariance.as_slice())] {
                let fit = EnergyFit { length_m: LENGTH, degree, symmetry, groups: &[], covariance };
                let found = fit.run(&poses, &wrenches).unwrap();
                prop_assert_eq!(found.rank(), truth.exponents().len());
                let again = found.predict(&poses).unwrap();
                for (x, y) in again.as_flattened().iter().zip(wrenches.as_flattened()) {
                    prop_assert!((x - y).abs() < 1e-8 * (1.0 + y.abs()), "{} vs {}", x, y);
                }
                // Same energy, coefficients carried over to the fit's own scale.
                for (t, row) in truth.exponents().iter().enumerate() {
                    let degrees = symmetry.variable_degrees();
                    let ratio = [found.scale()[0] / SCALE[0], found.scale()[1] / SCALE[1]];
                    let (lengths, angles) = match symmetry {
                        Symmetry::General => (row[0] + row[1] + row[2], row[3] + row[4] + row[5]),
                        _ => (row[0] + 2 * row[1] + row[4] + row[5], 2 * row[2] + row[3] + row[4] + row[5]),
                    };
                    let total: u8 = row.iter().zip(degrees).map(|(e, d)| e * d).sum();
                    prop_assert_eq!(total, lengths + angles);
                    let expected = truth.coefficients()[t] * ratio[0].powi(i32::from(lengths)) * ratio[1].powi(i32::from(angles));
                    prop_assert!((found.coefficients()[t] - expected).abs() < 1e-6, "{} {}", found.coefficients()[t], expected);
                }
            }
        }
    }
}

#[test]
fn closed_loops_need_no_work() {
    // The trapezoidal rule over a smooth closed loop converges like its Fourier series: what is
    // left of the work is rounding.
    let broken = ["anisotropy", "face_tilt", "handedness"];
    let groups = Group::from_names(&broken, Symmetry::Revolution).unwrap();
    let count = EnergyTerms::new(Symmetry::Revolution, 6, &groups)
        .unwrap()
        .count();
    let weights: Vec<f64> = (0..count).map(|i| 0.1 * (i as f64).cos()).collect();
    let uneven =
        EnergyModel::with_groups(LENGTH, 6, Symmetry::Revolution, &groups, SCALE, &weights)
            .unwrap();
    let mut models = vec![uneven];
    models.extend(SYMMETRIES.map(|symmetry| model(symmetry, 6, 1.0)));
    let points = 400;
    for m in &models {
        let (mut work, mut turnover) = (0.0, 0.0);
        for i in 0..points {
            let t = std::f64::consts::TAU * f64::from(i) / f64::from(points);
            let p = [
                LENGTH + 0.01 * t.sin(),
                0.015 * t.cos(),
                0.012 * (2.0 * t).sin(),
                0.3 * t.cos(),
                0.6 * t.sin(),
                0.5 * (t + 0.7).cos(),
            ];
            let rate = [
                0.01 * t.cos(),
                -0.015 * t.sin(),
                0.024 * (2.0 * t).cos(),
                -0.3 * t.sin(),
                0.6 * t.cos(),
                -0.5 * (t + 0.7).sin(),
            ];
            let h = m.predict(&[p]).unwrap()[0];
            let g = ecm_se3::Wrench::from_array(&h).generalised(&Pose::from_array(&p).unwrap());
            let power: f64 = (0..6).map(|k| g[k] * rate[k]).sum();
            work += power;
            turnover += power.abs();
        }
        assert!(work.abs() < 1e-12 * turnover, "{work} of {turnover}");
    }
}

#[test]
fn coefficient_covariance_is_that_of_repeated_noise() {
    // Many noisy copies of one small data set: the sample spread must match the stated one.
    let truth = model(Symmetry::Alike, 4, 2.0);
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut uniform = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let poses: Vec<[f64; 6]> = (0..30)
        .map(|_| {
            std::array::from_fn(|i| {
                let u = 2.0 * uniform() - 1.0;
                if i < 3 {
                    0.02 * u + if i == 0 { LENGTH } else { 0.0 }
                } else {
                    0.8 * u
                }
            })
        })
        .collect();
    let exact = truth.predict(&poses).unwrap();
    let sd = [0.3, 0.3, 0.3, 0.01, 0.01, 0.01];
    let mut sigma = [[0.0; 6]; 6];
    for i in 0..6 {
        sigma[i][i] = sd[i] * sd[i];
    }
    let covariance = vec![sigma; poses.len()];
    let fit = EnergyFit {
        length_m: LENGTH,
        degree: 4,
        symmetry: Symmetry::Alike,
        groups: &[],
        covariance: Some(&covariance),
    };
    let draws = 400;
    let mut sums = [0.0; 22];
    let mut stated = [0.0; 22];
    let base = fit.run(&poses, &exact).unwrap();
    let mut variance = 0.0;
    for _ in 0..draws {
        let noisy: Vec<[f64; 6]> = exact
            .iter()
            .map(|h| {
                std::array::from_fn(|i| {
                    let normal: f64 = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
                    h[i] + sd[i] * normal
                })
            })
            .collect();
        let m = fit.run(&poses, &noisy).unwrap();
        variance += m.residual_variance() / f64::from(draws);
        for t in 0..22 {
            sums[t] += (m.coefficients()[t] - base.coefficients()[t]).powi(2) / f64::from(draws);
            stated[t] = m.covariance()[t * 22 + t];
        }
    }
    assert!((variance - 1.0).abs() < 0.03, "{variance}");
    for t in 0..22 {
        assert!(
            (sums[t] / stated[t] - 1.0).abs() < 0.35,
            "term {t}: {} {}",
            sums[t],
            stated[t]
        );
    }
}

#[test]
fn too_few_rows_and_bad_covariance_are_refused_with_their_place() {
    let poses = vec![[LENGTH, 0.0, 0.0, 0.0, 0.0, 0.1]; 4];
    let wrenches = vec![[0.0; 6]; 4];
    let fit = EnergyFit {
        length_m: LENGTH,
        degree: 6,
        symmetry: Symmetry::Alike,
        groups: &[],
        covariance: None,
    };
    let message = fit.run(&poses, &wrenches).unwrap_err().to_string();
    assert!(message.contains("24 equations for 65"), "{message}");
    let mut broken = vec![[[0.0; 6]; 6]; 4];
    for m in &mut broken {
        for i in 0..6 {
            m[i][i] = 1.0;
        }
    }
    broken[2][5][5] = 0.0;
    let fit = EnergyFit {
        degree: 4,
        covariance: Some(&broken),
        ..fit
    };
    let message = fit.run(&poses, &wrenches).unwrap_err().to_string();
    assert!(message.contains("row 2"), "{message}");
    let mut missing = wrenches.clone();
    missing[3][1] = f64::NAN;
    let message = fit.run(&poses, &missing).unwrap_err().to_string();
    assert!(message.contains("row 3, column 1"), "{message}");
}

#[test]
fn prediction_covariance_is_that_of_the_coefficients() {
    let truth = model(Symmetry::Alike, 4, 2.0);
    let poses: Vec<[f64; 6]> = (0..40)
        .map(|i| {
            std::array::from_fn(|k| {
                let wave = ((i * 6 + k) as f64 * 1.7).sin();
                if k < 3 {
                    0.02 * wave + if k == 0 { LENGTH } else { 0.0 }
                } else {
                    0.8 * wave
                }
            })
        })
        .collect();
    let wrenches: Vec<[f64; 6]> = truth
        .predict(&poses)
        .unwrap()
        .iter()
        .enumerate()
        .map(|(i, h)| std::array::from_fn(|k| h[k] + 0.1 * ((i * 6 + k) as f64 * 7.3).sin()))
        .collect();
    let fit = EnergyFit {
        length_m: LENGTH,
        degree: 4,
        symmetry: Symmetry::Alike,
        groups: &[],
        covariance: None,
    };
    let found = fit.run(&poses, &wrenches).unwrap();
    let covariance = found.prediction_covariance(&poses[..3]).unwrap();
    // Against one coefficient at a time, moved by hand.
    for (p, c) in poses[..3].iter().zip(&covariance) {
        let columns: Vec<[f64; 6]> = (0..22)
            .map(|t| {
                let mut unit = vec![0.0; 22];
                unit[t] = 1.0;
                let one = EnergyModel::from_coefficients(
                    LENGTH,
                    4,
                    Symmetry::Alike,
                    found.scale(),
                    &unit,
                )
                .unwrap();
                one.predict(&[*p]).unwrap()[0]
            })
            .collect();
        for i in 0..6 {
            for j in 0..6 {
                let mut sum = 0.0;
                for a in 0..22 {
                    for b in 0..22 {
                        sum += columns[a][i] * found.covariance()[22 * a + b] * columns[b][j];
                    }
                }
                assert!((sum - c[i][j]).abs() < 1e-9 * (c[i][i] * c[j][j]).sqrt());
            }
        }
    }
}

#[test]
fn groups_add_their_wrench_and_stay_an_energy() {
    let names = ["anisotropy", "face_tilt", "handedness", "unlike_ends"];
    let groups = Group::from_names(&names, Symmetry::Alike).unwrap();
    let count = EnergyTerms::new(Symmetry::Alike, 6, &groups)
        .unwrap()
        .count();
    let weights: Vec<f64> = (0..count)
        .map(|i| ((i as f64 + 1.0) * 12.9898).sin())
        .collect();
    let model =
        EnergyModel::with_groups(LENGTH, 6, Symmetry::Alike, &groups, [0.03, 0.9], &weights)
            .unwrap();
    let poses = [
        [0.1, 0.004, -0.003, 0.2, 0.1, -0.3],
        [0.105, -0.01, 0.02, -0.1, 0.3, 0.2],
    ];
    let wrenches = model.predict(&poses).unwrap();
    let phi = model.regressor(&poses).unwrap();
    for (row, h) in phi.chunks_exact(count).zip(wrenches.as_flattened()) {
        let sum: f64 = row.iter().zip(&weights).map(|(a, b)| a * b).sum();
        assert!((sum - h).abs() <= 1e-10 * h.abs().max(1.0), "{sum} {h}");
    }
    let energies = model.energy(&poses).unwrap();
    let hessians = model.stiffness(&poses, StiffnessKind::Generalised).unwrap();
    for h in &hessians {
        for i in 0..6 {
            for j in 0..i {
                assert!((h[i][j] - h[j][i]).abs() <= 1e-12 * largest(h));
            }
        }
    }
    // f = dU/dx.
    for (pose, (h, u)) in poses.iter().zip(wrenches.iter().zip(&energies)) {
        let mut moved = *pose;
        moved[1] += 1e-7;
        let slope = (model.energy(&[moved]).unwrap()[0] - u) / 1e-7;
        assert!(
            (slope - h[1]).abs() < 1e-3 * h[1].abs().max(1.0),
            "{slope} {}",
            h[1]
        );
    }
    // The plan holds the whole energy, not its symmetric part alone.
    let tables = model.tables::<f64>().unwrap();
    assert_eq!(tables.symmetry(), Symmetry::General);
    let plan = tables.plan::<1024>().unwrap();
    for (p, (u, h)) in poses.iter().zip(energies.iter().zip(&wrenches)) {
        let pose = Pose::from_array(p).unwrap();
        let other = plan.energy::<Plain>(&pose);
        assert!((other - u).abs() < 1e-12 * u.abs().max(1.0));
        for (a, b) in plan.wrench::<Plain>(&pose).to_array().iter().zip(h) {
            assert!((a - b).abs() < 1e-10 * b.abs().max(1.0), "{a} {b}");
        }
    }
    assert!(Group::from_names(&["anisotropy"], Symmetry::General).is_err());
    assert!(Group::from_names(&["crooked"], Symmetry::Alike).is_err());
}

#[test]
fn general_takes_no_groups() {
    // Its monomials hold all that a group could add: each coefficient would be there twice.
    let groups = [Group::Anisotropy];
    let count = terms(Symmetry::General, 4).unwrap().len();
    for more in [0, 28] {
        let weights = vec![0.1; count + more];
        let model =
            EnergyModel::with_groups(LENGTH, 4, Symmetry::General, &groups, SCALE, &weights);
        let message = model.unwrap_err().to_string();
        assert!(
            message.contains("\"anisotropy\" with symmetry general"),
            "{message}"
        );
    }
    let fit = EnergyFit {
        length_m: LENGTH,
        degree: 4,
        symmetry: Symmetry::General,
        groups: &groups,
        covariance: None,
    };
    let poses = vec![[LENGTH, 0.0, 0.0, 0.0, 0.0, 0.1]; 60];
    assert!(fit.run(&poses, &vec![[0.0; 6]; 60]).is_err());
}

#[test]
fn poses_beyond_half_a_turn_are_refused_with_their_row() {
    let m = model(Symmetry::Alike, 4, 1.0);
    let rest = [LENGTH, 0.0, 0.0, 0.0, 0.0, 0.0];
    let far = [LENGTH, 0.0, 0.0, 0.0, 3.0, 1.0];
    let poses = [rest, rest, far];
    let partial = StiffnessKind::Partial;
    let fit = EnergyFit {
        length_m: LENGTH,
        degree: 1,
        symmetry: Symmetry::Alike,
        groups: &[],
        covariance: None,
    };
    let messages = [
        m.predict(&poses).unwrap_err(),
        m.energy(&poses).unwrap_err(),
        m.stiffness(&poses, partial).unwrap_err(),
        m.regressor(&poses).unwrap_err(),
        m.prediction_covariance(&poses).unwrap_err(),
        fit.run(&poses, &[[0.0; 6]; 3]).unwrap_err(),
    ];
    for message in messages.map(|error| error.to_string()) {
        assert!(
            message.contains("row 2") && message.contains("longer than pi"),
            "{message}"
        );
    }
    let half = [LENGTH, 0.0, 0.0, 0.0, std::f64::consts::PI, 0.0];
    assert!(m.predict(&[half]).is_ok());
}

#[test]
fn one_pose_is_as_many() {
    let groups = Group::from_names(&["anisotropy", "face_tilt"], Symmetry::Alike).unwrap();
    for degree in [3, 6, 7] {
        let count = EnergyTerms::new(Symmetry::Alike, degree, &groups)
            .unwrap()
            .count();
        let weights: Vec<f64> = (0..count).map(|i| (i as f64).cos()).collect();
        let m = EnergyModel::with_groups(LENGTH, degree, Symmetry::Alike, &groups, SCALE, &weights)
            .unwrap();
        let p = [0.1, 0.004, -0.003, 0.2, 0.1, -0.3];
        let (h, k) = m.wrench_and_stiffness(&Pose::from_array(&p).unwrap());
        assert_eq!(h.to_array(), m.predict(&[p]).unwrap()[0]);
        assert_eq!(k, m.stiffness(&[p], StiffnessKind::Partial).unwrap()[0]);
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let m = model(Symmetry::Revolution, 6, 1.0);
    let poses: Vec<[f64; 6]> = (0..3000)
        .map(|i| {
            let wave = |k: usize| ((6 * i + k) as f64 * 0.37).sin();
            [
                LENGTH + 0.01 * wave(0),
                0.02 * wave(1),
                0.02 * wave(2),
                wave(3),
                wave(4),
                wave(5),
            ]
        })
        .collect();
    let of_threads = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(n)
            .build()
            .unwrap();
        pool.install(|| {
            let k = m.stiffness(&poses, StiffnessKind::Partial).unwrap();
            (m.predict(&poses).unwrap(), k, m.energy(&poses).unwrap())
        })
    };
    let one = of_threads(1);
    assert_eq!(one, of_threads(3));
    for (p, h) in poses.iter().zip(&one.0).step_by(499) {
        assert_eq!(*h, m.predict(&[*p]).unwrap()[0]);
    }
}
