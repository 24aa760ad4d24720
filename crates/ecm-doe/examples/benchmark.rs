//! The reference figures of the designs: efficiency, distance and time over 20 seeds.
//!
//! `cargo run --release -p ecm-doe --example benchmark [seeds] [words]`: only the rows whose name
//! begins with the words.
//!
//! 1700 candidates uniform in [-1, 1]^6 (numpy's default_rng(0)), 84 cubic terms, n = 200, two
//! threads. Times depend on the machine and its load: read them beside each other. Processor
//! seconds (both threads, Linux) depend less on what else runs.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

#[path = "../tests/common/mod.rs"]
mod common;

use std::time::Instant;

use ecm_doe::regressor::Model;
use ecm_doe::{
    Control, DSettings, Design, MaximinSettings, Method, SpacingMethod, d_optimal, maximin,
};

fn main() {
    let seeds: u64 = std::env::args()
        .nth(1)
        .and_then(|a| a.parse().ok())
        .unwrap_or(20);
    let points = common::uniform(0, 1700, 6);
    let rows = cubic(&points);
    println!(
        "{:<42} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "", "least", "median", "largest", "bound", "seconds", "cpu s"
    );
    let d = |name: &str, threads, method, starts, iterations, limit| {
        row(
            name,
            seeds,
            |d| d.efficiency,
            |seed| {
                let settings = DSettings {
                    n: 200,
                    starts,
                    iterations,
                    seed,
                    threads,
                    method,
                    ..DSettings::default()
                };
                let control = Control::new().with_time_limit(limit);
                d_optimal(&rows, 1, 84, &settings, &control).unwrap()
            },
        );
    };
    d(
        "D row-wise, one start, one thread",
        1,
        Method::RowWise,
        1,
        0,
        0.0,
    );
    d(
        "D Fedorov (the paper's), one start",
        1,
        Method::Fedorov,
        1,
        0,
        0.0,
    );
    d("D search, half a second", 2, Method::Search, 10, 0, 0.5);
    d(
        "D search, 300 disturbances",
        2,
        Method::Search,
        10,
        300,
        0.0,
    );
    d("D search, default budget", 2, Method::Search, 10, 0, 0.0);
    let spread = |name: &str, method, starts, iterations, limit| {
        row(
            name,
            seeds,
            |d| d.value,
            |seed| {
                let settings = MaximinSettings {
                    n: 200,
                    starts,
                    iterations,
                    seed,
                    threads: 2,
                    method,
                    ..MaximinSettings::default()
                };
                let control = Control::new().with_time_limit(limit);
                maximin(&points, 6, &settings, &control).unwrap()
            },
        );
    };
    spread(
        "maximin exchange (the paper's), 10 starts",
        SpacingMethod::Exchange,
        10,
        0,
        0.0,
    );
    spread(
        "maximin search, half a second",
        SpacingMethod::Search,
        10,
        0,
        0.5,
    );
    spread(
        "maximin search, 50 thousand swaps",
        SpacingMethod::Search,
        10,
        50,
        0.0,
    );
    spread(
        "maximin search, default budget",
        SpacingMethod::Search,
        10,
        0,
        0.0,
    );
    let many = cubic(&common::uniform(1, 100_000, 6));
    row(
        "D search, 100000 candidates, n = 500",
        1,
        |d| d.efficiency,
        |seed| {
            let settings = DSettings {
                n: 500,
                iterations: 100,
                seed,
                threads: 2,
                ..DSettings::default()
            };
            d_optimal(&many, 1, 84, &settings, &Control::new()).unwrap()
        },
    );
}

fn cubic(points: &[f64]) -> Vec<f64> {
    Model::polynomial(points, 3, &[-1.0; 6], &[1.0; 6])
        .unwrap()
        .rows
}

/// Least, median and largest figure, the bound and the median time of some seeds.
fn row(name: &str, seeds: u64, figure: impl Fn(&Design) -> f64, run: impl Fn(u64) -> Design) {
    let wanted = std::env::args().nth(2).unwrap_or_default();
    if !name.starts_with(&wanted) {
        return;
    }
    let (mut values, mut times, mut work, mut bound) = (Vec::new(), Vec::new(), Vec::new(), 0.0);
    for seed in 0..seeds {
        let (clock, before) = (Instant::now(), processor_seconds());
        let design = run(seed);
        work.push(processor_seconds() - before);
        times.push(clock.elapsed().as_secs_f64());
        values.push(figure(&design));
        bound = design.bound;
    }
    values.sort_by(f64::total_cmp);
    times.sort_by(f64::total_cmp);
    work.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    println!(
        "{name:<42} {:>9.5} {:>9.5} {:>9.5} {bound:>9.5} {:>9.3} {:>9.3}",
        values[0],
        values[middle],
        values[values.len() - 1],
        times[middle],
        work[middle]
    );
}

/// User time of this process so far, NaN where /proc does not tell.
fn processor_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split(' ').collect();
    fields
        .get(12)
        .and_then(|t| t.parse::<f64>().ok())
        .map_or(f64::NAN, |ticks| ticks / 100.0)
}
