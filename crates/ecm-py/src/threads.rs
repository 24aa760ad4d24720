//! Work of many rows on the threads of the Rust core, also in a forked process.

use std::sync::OnceLock;

use pyo3::prelude::*;

use crate::errors::EcmError;

/// The process that may use rayon's own threads.
///
/// `fork` copies the list of these threads but none of the threads, so a forked process would wait
/// for ever for work that it hands to them.
static FIRST_PROCESS: OnceLock<u32> = OnceLock::new();

/// Releases the GIL and runs `work`, in a forked process on one new thread.
///
/// The bytes of a result do not depend on the number of threads.
///
/// # Errors
/// `EcmError` if a forked process cannot start a thread.
pub fn detached<T, W>(py: Python<'_>, work: W) -> PyResult<T>
where
    T: Send,
    W: FnOnce() -> T + Send,
{
    let process = std::process::id();
    if *FIRST_PROCESS.get_or_init(|| process) == process {
        return Ok(py.detach(work));
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .map_err(|e| EcmError::new_err(format!("no thread in this forked process: {e}")))?;
    Ok(py.detach(|| pool.install(work)))
}
