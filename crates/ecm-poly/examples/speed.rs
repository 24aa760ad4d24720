//! Nanoseconds a call of the models' evaluation, one thread: `cargo run --release --example speed`;
//! with `-- --fit` the parts of a fit, in turns.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use std::hint::black_box;
use std::time::Instant;

use ecm_poly::arithmetic::{Arithmetic, Plain, Task, dispatch};
use ecm_poly::cubic::Cubic;
use ecm_poly::dense::ThinSvd;
use ecm_poly::energy::{EnergyPlan, EnergyTerms};
use ecm_poly::{EnergyModel, Method, PolynomialModel, Symmetry};
use ecm_se3::stiffness::StiffnessKind;
use ecm_se3::{Pose, Real};

const CALLS: usize = 1 << 14;

/// Smallest time a call of seven rounds over many poses.
fn time(name: &str, mut round: impl FnMut()) {
    let mut best = f64::INFINITY;
    for _ in 0..7 {
        let begin = Instant::now();
        round();
        best = best.min(begin.elapsed().as_secs_f64() / CALLS as f64);
    }
    println!("{name:44} {:8.1} ns", best * 1e9);
}

struct CubicTask<'a, R> {
    cubic: &'a Cubic<R>,
    points: &'a [[R; 6]],
    stiffness: bool,
}

impl<R: Real> CubicTask<'_, R> {
    #[inline(always)]
    fn go<A: Arithmetic<R>>(self) {
        for p in self.points {
            if self.stiffness {
                black_box(self.cubic.value_and_columns::<A>(p));
            } else {
                black_box(self.cubic.value::<A>(p));
            }
        }
    }
}

impl Task for CubicTask<'_, f64> {
    type Output = ();
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) {
        self.go::<A>();
    }
}

impl Task for CubicTask<'_, f32> {
    type Output = ();
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) {
        self.go::<A>();
    }
}

/// The plan of an energy, the evaluation of an exported model.
struct PlanTask<'a> {
    plan: EnergyPlan<'a, f64, 512>,
    poses: &'a [Pose<f64>],
    stiffness: bool,
}

impl Task for PlanTask<'_> {
    type Output = ();
    #[inline(always)]
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) {
        for pose in self.poses {
            if self.stiffness {
                black_box(
                    self.plan
                        .wrench_and_stiffness::<A>(pose, StiffnessKind::Partial),
                );
            } else {
                black_box(self.plan.wrench::<A>(pose));
            }
        }
    }
}

/// Nanoseconds a row of 1000 rows in one call, as Python calls them.
fn bulk() {
    const ROWS: usize = 1000;
    let unit = [1.0; 6];
    let coefficients: Vec<f64> = (0..84 * 6).map(|i| (i as f64).sin()).collect();
    let cubic = PolynomialModel::from_coefficients(3, &unit.map(|x: f64| -x), &unit, &coefficients)
        .unwrap();
    let points: Vec<[f64; 6]> = (0..ROWS)
        .map(|i| std::array::from_fn(|k| ((i * 7 + k * 3) as f64 * 0.37).sin()))
        .collect();
    let poses: Vec<[f64; 6]> = points
        .iter()
        .map(|p| std::array::from_fn(|k| p[k] * [0.01, 0.02, 0.02, 0.4, 0.4, 0.4][k]))
        .map(|p: [f64; 6]| [p[0] + 0.1034, p[1], p[2], p[3], p[4], p[5]])
        .collect();
    let measure = |name: &str, call: &dyn Fn()| {
        let mut best = f64::INFINITY;
        for _ in 0..200 {
            let begin = Instant::now();
            call();
            best = best.min(begin.elapsed().as_secs_f64() / ROWS as f64);
        }
        println!("{:44} {:8.1} ns", format!("bulk, {name}"), best * 1e9);
    };
    let flat = points.as_flattened();
    measure("cubic h", &|| drop(black_box(cubic.predict(flat))));
    measure("cubic K", &|| drop(black_box(cubic.jacobian(flat))));
    for degree in [6, 7] {
        let model = energy(Symmetry::Alike, degree);
        measure(&format!("energy{degree} h"), &|| {
            drop(black_box(model.predict(&poses)));
        });
        measure(&format!("energy{degree} K"), &|| {
            drop(black_box(model.stiffness(&poses, StiffnessKind::Partial)));
        });
    }
}

/// A fit's decomposition, its Gram product, and what a fit no longer does: the product as a plain
/// loop at 923 columns (energy6-general), and a cubic's condition number without normalisation.
fn decomposition() {
    const COLUMNS: usize = 923;
    let sines =
        |count: usize| -> Vec<f64> { (0..count).map(|i| ((i * i % 7919) as f64).sin()).collect() };
    let matrix = sines(1200 * COLUMNS);
    let (points, values) = (sines(1000 * 6), sines(1000 * 6));
    let factors = ThinSvd::new(&matrix, COLUMNS).unwrap();
    let parts: [(&str, &dyn Fn()); 5] = [
        ("923 columns, SVD", &|| {
            drop(black_box(ThinSvd::new(&matrix, COLUMNS)))
        }),
        ("923 columns, Gram product", &|| {
            drop(black_box(factors.gram(|_, s| s.powi(-2))))
        }),
        ("923 columns, Gram product, plain loop", &|| {
            drop(black_box(plain_gram(&factors)))
        }),
        ("cubic, 1000 rows, fit", &|| {
            let method = Method::LeastSquares;
            drop(black_box(PolynomialModel::fit(
                &points, 6, &values, 6, 3, method, None,
            )));
        }),
        ("cubic, 1000 rows, its raw condition number", &|| {
            let _ = black_box(PolynomialModel::condition_number_raw(&points, 6, 3));
        }),
    ];
    let mut best = [f64::INFINITY; 5];
    for _ in 0..5 {
        for ((_, part), least) in parts.iter().zip(&mut best) {
            let begin = Instant::now();
            part();
            *least = least.min(begin.elapsed().as_secs_f64());
        }
    }
    for ((name, _), seconds) in parts.iter().zip(best) {
        println!("{name:44} {:8.4} s", seconds);
    }
}

/// V σ⁻² Vᵀ entry by entry, as the sum is written.
fn plain_gram(factors: &ThinSvd) -> Vec<f64> {
    let (v, sigma) = (factors.right_vectors(), &factors.singular_values);
    let n = sigma.len();
    let mut gram = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let terms = sigma.iter().enumerate();
            let sum = terms
                .map(|(r, s)| v[n * i + r] * v[n * j + r] / (s * s))
                .sum();
            gram[i * n + j] = sum;
            gram[j * n + i] = sum;
        }
    }
    gram
}

fn main() {
    if std::env::args().any(|a| a == "--fit") {
        decomposition();
        return;
    }
    bulk();
    if std::env::args().any(|a| a == "--bulk") {
        return;
    }
    let points: Vec<[f64; 6]> = (0..CALLS)
        .map(|i| {
            std::array::from_fn(|k| {
                ((i * 7 + k * 3) as f64 * 0.37).sin() * if k < 3 { 0.02 } else { 0.8 }
            })
        })
        .collect();
    let poses: Vec<Pose<f64>> = points
        .iter()
        .map(|p| Pose::from_array(p).unwrap())
        .collect();
    let single: Vec<[f32; 6]> = points.iter().map(|p| p.map(|x| x as f32)).collect();
    let coefficients: Vec<f64> = (0..84 * 6).map(|i| (i as f64).sin()).collect();
    let range = [0.03, 0.03, 0.03, 1.0, 1.0, 1.0];
    let cubic = Cubic::new(&range.map(|x: f64| -x), &range, &coefficients).unwrap();
    let range32 = range.map(|x| x as f32);
    let coefficients32: Vec<f32> = coefficients.iter().map(|&x| x as f32).collect();
    let cubic32 = Cubic::new(&range32.map(|x| -x), &range32, &coefficients32).unwrap();
    for stiffness in [false, true] {
        let what = if stiffness { "h and K" } else { "h" };
        time(&format!("cubic, {what}"), || {
            dispatch(CubicTask {
                cubic: &cubic,
                points: &points,
                stiffness,
            });
        });
        time(&format!("cubic in f32, {what}"), || {
            dispatch(CubicTask {
                cubic: &cubic32,
                points: &single,
                stiffness,
            });
        });
        time(
            &format!("cubic as compiled for any machine, {what}"),
            || {
                CubicTask {
                    cubic: &cubic,
                    points: &points,
                    stiffness,
                }
                .go::<Plain>();
            },
        );
        for (symmetry, degree) in [
            (Symmetry::Alike, 4),
            (Symmetry::Alike, 6),
            (Symmetry::Alike, 7),
            (Symmetry::Revolution, 6),
            (Symmetry::Revolution, 7),
            (Symmetry::General, 4),
        ] {
            let model = energy(symmetry, degree);
            let tables = model.tables().unwrap();
            let plan = tables.plan().unwrap();
            let name = format!("energy{degree} {}", symmetry.name());
            time(&format!("{name}, plan, {what}"), || {
                dispatch(PlanTask {
                    plan,
                    poses: &poses,
                    stiffness,
                });
            });
            if stiffness {
                time(&format!("{name}, one pose, {what}"), || {
                    for pose in &poses {
                        black_box(model.wrench_and_stiffness(pose));
                    }
                });
            }
        }
    }
}

/// An energy with coefficients of any size.
fn energy(symmetry: Symmetry, degree: usize) -> EnergyModel {
    let count = EnergyTerms::new(symmetry, degree, &[]).unwrap().count();
    let weights: Vec<f64> = (0..count).map(|i| (i as f64).cos()).collect();
    EnergyModel::from_coefficients(0.1034, degree, symmetry, [0.03, 0.8], &weights).unwrap()
}
