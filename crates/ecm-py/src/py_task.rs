//! Runs long Rust work for Python: with progress, Ctrl-C and errors.
//!
//! The work runs on its own thread with the GIL released. The calling thread wakes every 50 ms to
//! let Python handle Ctrl-C and to call the progress callback. An exception from either sets the
//! cancel flag and is raised again when the work has ended. A panic of the work becomes an
//! `EcmError`; no panic reaches Python.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use pyo3::prelude::*;

use crate::errors::EcmError;

/// Most worker threads that are started.
const MOST_THREADS: usize = 1024;

const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Progress counter and cancel flag that the work and the calling thread share.
#[derive(Default)]
pub struct TaskState {
    /// Set when the work is to end as soon as possible.
    pub cancel: AtomicBool,
    /// Cases done so far.
    pub done: AtomicUsize,
    /// Cases in all, 0 while unknown.
    pub total: AtomicUsize,
}

/// Runs `work` on `threads` threads (0: all cores) and returns its value.
pub fn run_task<T, W>(
    py: Python<'_>,
    threads: usize,
    progress: Option<Py<PyAny>>,
    work: W,
) -> PyResult<T>
where
    T: Send,
    W: FnOnce(&TaskState) -> T + Send,
{
    run_task_polling(py, threads, progress, &|_| Ok(()), work)
}

/// As [`run_task`]; `poll` is called every 50 ms and once when the work has ended, even when it
/// was cancelled, so that finished results are not lost.
pub fn run_task_polling<T, W>(
    py: Python<'_>,
    threads: usize,
    progress: Option<Py<PyAny>>,
    poll: &dyn Fn(Python<'_>) -> PyResult<()>,
    work: W,
) -> PyResult<T>
where
    T: Send,
    W: FnOnce(&TaskState) -> T + Send,
{
    if threads > MOST_THREADS {
        return Err(EcmError::new_err(format!(
            "threads = {threads}, expected at most {MOST_THREADS}, 0 for all cores"
        )));
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| EcmError::new_err(format!("no thread pool of {threads} threads: {e}")))?;
    let state = TaskState::default();
    let mut raised: Option<PyErr> = None;
    let outcome = std::thread::scope(|scope| {
        let worker = scope.spawn(|| pool.install(|| work(&state)));
        let mut last = usize::MAX;
        loop {
            let finished = worker.is_finished();
            let done = state.done.load(Ordering::Relaxed);
            let polled = poll(py);
            if raised.is_none() {
                let checked =
                    polled
                        .and_then(|()| py.check_signals())
                        .and_then(|()| match &progress {
                            Some(callback) if done != last => {
                                let total = state.total.load(Ordering::Relaxed);
                                callback.call1(py, (done, total)).map(|_| ())
                            }
                            _ => Ok(()),
                        });
                last = done;
                if let Err(error) = checked {
                    raised = Some(error);
                    state.cancel.store(true, Ordering::Relaxed);
                }
            }
            if finished {
                break;
            }
            // Short work must not wait for a full poll interval.
            py.detach(|| {
                let start = std::time::Instant::now();
                let mut pause = Duration::from_micros(20);
                while !worker.is_finished() && start.elapsed() < POLL_INTERVAL {
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
