//! The error of evaluation without std: a slice of the wrong length.

use core::fmt;

/// A slice of the wrong length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShapeError {
    /// Which slice.
    pub name: &'static str,
    /// Its length.
    pub found: usize,
    /// The expected length.
    pub expected: usize,
}

impl ShapeError {
    /// `Ok` where `found` is `expected`.
    #[inline(always)]
    pub(crate) fn check(name: &'static str, found: usize, expected: usize) -> Result<(), Self> {
        if found == expected {
            Ok(())
        } else {
            Err(Self {
                name,
                found,
                expected,
            })
        }
    }
}

impl fmt::Display for ShapeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} has {} numbers, expected {}",
            self.name, self.found, self.expected
        )
    }
}

impl core::error::Error for ShapeError {}
