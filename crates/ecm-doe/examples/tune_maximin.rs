//! Distance and time of the maximin search over some seeds.
#![allow(clippy::unwrap_used, clippy::print_stdout)]
#[path = "../tests/common/mod.rs"]
mod common;
use ecm_doe::{Control, MaximinSettings, SpacingMethod, maximin};
fn main() {
    let a: Vec<usize> = std::env::args()
        .skip(1)
        .map(|v| v.parse().unwrap())
        .collect();
    let rows = common::uniform(0, 1700, 6);
    let mut e = Vec::new();
    let mut t = Vec::new();
    let mut b = Vec::new();
    for seed in 0..a[2] as u64 {
        let clock = std::time::Instant::now();
        let s = MaximinSettings {
            n: 200,
            starts: a[0],
            iterations: a[1],
            method: if a[1] == 0 {
                SpacingMethod::Exchange
            } else {
                SpacingMethod::Search
            },
            threads: 2,
            seed,
            ..Default::default()
        };
        let d = maximin(&rows, 6, &s, &Control::new()).unwrap();
        e.push(d.value);
        t.push(clock.elapsed().as_secs_f64());
        b.push(d.bound);
    }
    e.sort_by(f64::total_cmp);
    t.sort_by(f64::total_cmp);
    println!(
        "starts {} it {}: min {:.5} med {:.5} max {:.5} bound {:.4} time med {:.3}",
        a[0],
        a[1],
        e[0],
        e[e.len() / 2],
        e[e.len() - 1],
        b[0],
        t[t.len() / 2]
    );
}
