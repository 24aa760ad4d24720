//! Time limit, cancel flag, progress and status of a search.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Status {
    /// The design is provably the best, or no exchange improves it.
    Converged,
    /// Iterations or time are used up; the design is the best so far.
    Budget,
    /// Stopped by the caller; the design is the best so far.
    Interrupted,
}

impl Status {
    /// `converged`, `budget` or `interrupted`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Budget => "budget",
            Self::Interrupted => "interrupted",
        }
    }
}

/// Called with (done, total) units of work and the best value so far.
pub type ProgressFn<'a> = &'a (dyn Fn(usize, usize, f64) + Sync);

/// Control of a running search: cancel flag, progress and time limit.
///
/// The result depends on the speed of the machine only with a time limit.
#[derive(Clone, Copy)]
pub struct Control<'a> {
    cancel: Option<&'a AtomicBool>,
    progress: Option<ProgressFn<'a>>,
    deadline: Option<Instant>,
}

impl Default for Control<'_> {
    fn default() -> Self {
        Self::new()
    }
}

impl<'a> Control<'a> {
    /// No cancel flag, no progress, no time limit.
    pub fn new() -> Self {
        Self {
            cancel: None,
            progress: None,
            deadline: None,
        }
    }

    /// Stops soon after `flag` becomes true.
    #[must_use]
    pub fn with_cancel(mut self, flag: &'a AtomicBool) -> Self {
        self.cancel = Some(flag);
        self
    }

    /// Calls `report(done, total, best value)` from time to time.
    #[must_use]
    pub fn with_progress(mut self, report: ProgressFn<'a>) -> Self {
        self.progress = Some(report);
        self
    }

    /// Stops after `seconds`, counted from now; 0 means no limit.
    #[must_use]
    pub fn with_time_limit(mut self, seconds: f64) -> Self {
        if seconds > 0.0 && seconds.is_finite() {
            self.deadline = Some(Instant::now() + Duration::from_secs_f64(seconds.min(1e8)));
        }
        self
    }

    /// Whether the caller has cancelled.
    pub fn cancelled(&self) -> bool {
        self.cancel.is_some_and(|flag| flag.load(Ordering::Relaxed))
    }

    /// Whether the caller has cancelled or the time is up.
    pub fn stop(&self) -> bool {
        self.cancelled() || self.deadline.is_some_and(|end| Instant::now() >= end)
    }

    /// The same without the time limit, for work that must be completed.
    #[must_use]
    pub(crate) fn without_deadline(mut self) -> Self {
        self.deadline = None;
        self
    }

    /// Whether a time limit is set.
    pub fn timed(&self) -> bool {
        self.deadline.is_some()
    }

    pub(crate) fn report(&self, done: usize, total: usize, best: f64) {
        if let Some(report) = self.progress {
            report(done, total, best);
        }
    }
}

/// Most worker threads.
const MOST_THREADS: usize = 1024;

/// Runs `work` on `threads` worker threads (0: the current pool).
pub(crate) fn on_threads<R: Send>(
    threads: usize,
    work: impl FnOnce() -> R + Send,
) -> Result<R, crate::DesignError> {
    if threads == 0 {
        return Ok(work());
    }
    if threads > MOST_THREADS {
        return Err(crate::DesignError::Setting {
            name: "threads",
            value: threads.to_string(),
            expected: "at most 1024, 0 for all",
        });
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| crate::DesignError::Threads {
            threads,
            reason: e.to_string(),
        })?;
    Ok(pool.install(work))
}
