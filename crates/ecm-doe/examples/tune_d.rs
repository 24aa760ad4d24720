//! Efficiency and time of the D search over some seeds.
#![allow(clippy::unwrap_used, clippy::print_stdout)]
#[path = "../tests/common/mod.rs"]
mod common;
use ecm_doe::regressor::Model;
use ecm_doe::{Control, DSettings, Method, d_optimal};
fn main() {
    let a: Vec<usize> = std::env::args()
        .skip(1)
        .map(|v| v.parse().unwrap())
        .collect();
    let rows = Model::polynomial(&common::uniform(0, 1700, 6), 3, &[-1.0; 6], &[1.0; 6])
        .unwrap()
        .rows;
    let mut e = Vec::new();
    let mut t = Vec::new();
    for seed in 0..a[2] as u64 {
        let clock = std::time::Instant::now();
        let s = DSettings {
            n: 200,
            starts: a[0],
            iterations: a[1],
            method: Method::Search,
            threads: 2,
            seed,
            ..DSettings::default()
        };
        let d = d_optimal(&rows, 1, 84, &s, &Control::new()).unwrap();
        e.push(d.efficiency);
        t.push(clock.elapsed().as_secs_f64());
    }
    e.sort_by(f64::total_cmp);
    t.sort_by(f64::total_cmp);
    println!(
        "starts {} it {}: eff min {:.5} med {:.5} max {:.5} time med {:.3}",
        a[0],
        a[1],
        e[0],
        e[e.len() / 2],
        e[e.len() - 1],
        t[t.len() / 2]
    );
}
