//! The one door between Python and long Rust work.
//!
//! The work runs on a thread of its own with the GIL released; this thread wakes
//! every 50 ms to let Python see Ctrl-C and to call the progress callback. An
//! exception from either raises the cancel flag, and is re-raised when the work has
//! ended. A panic of the work becomes an `EcmError`; none crosses into Python.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use pyo3::prelude::*;

use crate::errors::EcmError;

const POLL: Duration = Duration::from_millis(50);

/// What long work sees of the outside: where to count and when to stop.
#[derive(Default)]
pub struct Work {
    /// Raised when the work is to end as soon as it can.
    pub cancel: AtomicBool,
    /// Cases done so far.
    pub done: AtomicUsize,
    /// Cases in all, 0 while unknown.
    pub total: AtomicUsize,
}

/// Runs `work` on `threads` threads (0: all cores) and returns its value.
pub fn long_work<T, W>(
    py: Python<'_>,
    threads: usize,
    progress: Option<Py<PyAny>>,
    work: W,
) -> PyResult<T>
where
    T: Send,
    W: FnOnce(&Work) -> T + Send,
{
    long_work_telling(py, threads, progress, &|_| Ok(()), work)
}

/// As [`long_work`]; `tell` is called at every wake and once when the work has ended, even
/// when it was cancelled, so that what was finished by then is not lost.
pub fn long_work_telling<T, W>(
    py: Python<'_>,
    threads: usize,
    progress: Option<Py<PyAny>>,
    tell: &dyn Fn(Python<'_>) -> PyResult<()>,
    work: W,
) -> PyResult<T>
where
    T: Send,
    W: FnOnce(&Work) -> T + Send,
{
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| EcmError::new_err(format!("no thread pool of {threads} threads: {e}")))?;
    let state = Work::default();
    let mut raised: Option<PyErr> = None;
    let outcome = std::thread::scope(|scope| {
        let worker = scope.spawn(|| pool.install(|| work(&state)));
        let mut last = usize::MAX;
        loop {
            let finished = worker.is_finished();
            let done = state.done.load(Ordering::Relaxed);
            let told = tell(py);
            if raised.is_none() {
                let seen = told
                    .and_then(|()| py.check_signals())
                    .and_then(|()| match &progress {
                        Some(callback) if done != last => {
                            let total = state.total.load(Ordering::Relaxed);
                            callback.call1(py, (done, total)).map(|_| ())
                        }
                        _ => Ok(()),
                    });
                last = done;
                if let Err(error) = seen {
                    raised = Some(error);
                    state.cancel.store(true, Ordering::Relaxed);
                }
            }
            if finished {
                break;
            }
            // Short work must not wait for a whole poll interval.
            py.detach(|| {
                let start = std::time::Instant::now();
                let mut pause = Duration::from_micros(20);
                while !worker.is_finished() && start.elapsed() < POLL {
                    std::thread::sleep(pause);
                    pause = (pause * 2).min(Duration::from_millis(5));
                }
            });
        }
        worker.join()
    });
    if let Some(error) = raised {
        return Err(error);
    }
    outcome.map_err(|_| {
        EcmError::new_err("internal error in the Rust core: please report it with the input")
    })
}
