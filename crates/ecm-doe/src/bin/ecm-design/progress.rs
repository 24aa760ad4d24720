//! The progress bar: share done, time left, best so far.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::args::{Args, MAXIMIN};

/// Length of the bar in steps.
const STEPS: u64 = 1000;

/// A bar on standard error, invisible when that is no terminal or with `--quiet`.
pub struct Bar {
    bar: ProgressBar,
    began: Instant,
    limit: f64,
    unit: &'static str,
    best: Mutex<f64>,
}

impl Bar {
    /// A bar for the search of `args`.
    pub fn new(args: &Args) -> Self {
        let target = if args.quiet {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr()
        };
        let bar = ProgressBar::with_draw_target(Some(STEPS), target);
        if let Ok(style) =
            ProgressStyle::with_template("{bar:30} {percent:>3} %  {eta} left  {msg}")
        {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(200));
        let unit = match args.criterion.as_str() {
            MAXIMIN => "distance",
            _ => "efficiency",
        };
        Self {
            bar,
            began: Instant::now(),
            limit: args.time_limit,
            unit,
            best: Mutex::new(0.0),
        }
    }

    /// Shows `done` of `total`, or the share of the time limit if that is further.
    pub fn show(&self, done: usize, total: usize, best: f64) {
        let mut share = done as f64 / total.max(1) as f64;
        if self.limit > 0.0 {
            share = share.max(self.began.elapsed().as_secs_f64() / self.limit);
        }
        self.bar
            .set_position((share.min(1.0) * STEPS as f64) as u64);
        if let Ok(mut top) = self.best.lock() {
            *top = top.max(best);
            self.bar
                .set_message(format!("best {} {:.5}", self.unit, *top));
        }
    }

    /// Removes the bar.
    pub fn clear(&self) {
        self.bar.finish_and_clear();
    }
}
