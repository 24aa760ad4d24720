//! Errors of model data and model files.

use alloc::string::String;
use alloc::vec::Vec;

use ecm_se3::{Pose, PoseError, Vec6};

use crate::shape::ShapeError;

/// Wrong input to a fit, an evaluation or a model file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// An array of another shape than the call needs.
    #[error("{name} has {found} {unit}, expected {expected}")]
    Shape {
        /// The array.
        name: &'static str,
        /// Unit of the count, such as rows.
        unit: &'static str,
        /// Number found.
        found: usize,
        /// Number expected.
        expected: usize,
    },
    /// A table of evaluation of the wrong length.
    #[error(transparent)]
    Table(#[from] ShapeError),
    /// A number that is NaN or infinite.
    #[error(
        "{name}: row {row}, column {column} is {value}, expected a finite number; leave the row out"
    )]
    NotFinite {
        /// The array.
        name: &'static str,
        /// Row, counted from 0.
        row: usize,
        /// Column, counted from 0.
        column: usize,
        /// NaN or an infinity.
        value: f64,
    },
    /// A rotation by more than half a turn.
    #[error("{name}: row {row}: {source}")]
    Rotation {
        /// The array.
        name: &'static str,
        /// Row, counted from 0.
        row: usize,
        /// What is wrong with it.
        source: PoseError,
    },
    /// A number whose products overflow.
    #[error(
        "{name}: row {row}, column {column} is {value:e}, expected sizes of at most 1e100; give this column in another unit or leave the row out"
    )]
    TooLarge {
        /// The array.
        name: &'static str,
        /// Row, counted from 0.
        row: usize,
        /// Column, counted from 0.
        column: usize,
        /// The value found.
        value: f64,
    },
    /// A setting out of its range.
    #[error("{name} is {found}, expected {expected}")]
    Setting {
        /// The setting.
        name: &'static str,
        /// Its value.
        found: String,
        /// Its range.
        expected: &'static str,
    },
    /// Fewer equations than coefficients.
    #[error("{equations} equation{} for {coefficients} coefficients: give more rows, or take a lower degree",
        if *equations == 1 { "" } else { "s" })]
    TooFewRows {
        /// Rows times components.
        equations: usize,
        /// Unknowns.
        coefficients: usize,
    },
    /// A covariance that is not symmetric positive definite.
    #[error(
        "covariance of row {row} is not symmetric positive definite; its diagonal holds the squared standard deviations and must be above zero"
    )]
    Covariance {
        /// Row, counted from 0.
        row: usize,
    },
    /// The singular value decomposition did not converge.
    #[error(
        "the singular values of the {rows} x {columns} regressor did not converge; look for rows many orders of magnitude apart"
    )]
    Decomposition {
        /// Rows of the regressor.
        rows: usize,
        /// Columns of the regressor.
        columns: usize,
    },
    /// Text that is not JSON.
    #[error(
        "model file is not JSON near key \"{key}\": {message}; fetch the file again or fit the model again"
    )]
    Json {
        /// The last key before the error.
        key: String,
        /// Message of the parser.
        message: String,
    },
    /// A key of a model file that is missing, unknown or out of range.
    #[error("model file: key \"{key}\" is {found}, expected {expected}")]
    Key {
        /// The key, with its place where it is inside another.
        key: String,
        /// Value found.
        found: String,
        /// Value expected.
        expected: String,
    },
    /// A model file whose checksum does not match its content.
    #[error(
        "model file: key \"sha256\" is {found}, but the content sums to {expected}: the file was changed or damaged after it was sealed; fetch it again or fit the model again"
    )]
    Sum {
        /// Checksum in the file.
        found: String,
        /// Checksum of the content.
        expected: String,
    },
}

/// The poses of rows (x, y, z, θx, θy, θz), m and rad; the error names the first row that is none.
pub fn checked_poses(name: &'static str, rows: &[Vec6<f64>]) -> Result<Vec<Pose<f64>>, ModelError> {
    let mut poses = Vec::with_capacity(rows.len());
    for (row, p) in rows.iter().enumerate() {
        poses.push(Pose::from_array(p).map_err(|source| match source {
            PoseError::NotFinite { component, value } => ModelError::NotFinite {
                name,
                row,
                column: component,
                value,
            },
            _ => ModelError::Rotation { name, row, source },
        })?);
    }
    Ok(poses)
}

/// `Ok` where `found` is `expected`.
pub fn check_count(
    name: &'static str,
    unit: &'static str,
    found: usize,
    expected: usize,
) -> Result<(), ModelError> {
    if found == expected {
        Ok(())
    } else {
        Err(ModelError::Shape {
            name,
            unit,
            found,
            expected,
        })
    }
}

/// `Ok` where every number of a row-major array is finite.
#[allow(clippy::eq_op)] // x - x is NaN where x is not finite.
pub fn check_finite(name: &'static str, values: &[f64], columns: usize) -> Result<(), ModelError> {
    // x - x is +0 for finite numbers only; without a branch this runs in vector registers, and
    // every prediction passes here.
    if values.iter().fold(0, |bits, x| bits | (x - x).to_bits()) == 0 {
        return Ok(());
    }
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(place) => Err(ModelError::NotFinite {
            name,
            row: place / columns.max(1),
            column: place % columns.max(1),
            value: values[place],
        }),
    }
}

/// `Ok` where every number of a row-major array is finite and at most 1e100 in size, so that squares
/// stay finite.
pub fn check_sizes(name: &'static str, values: &[f64], columns: usize) -> Result<(), ModelError> {
    check_finite(name, values, columns)?;
    match values.iter().position(|x| x.abs() > 1e100) {
        None => Ok(()),
        Some(place) => Err(ModelError::TooLarge {
            name,
            row: place / columns.max(1),
            column: place % columns.max(1),
            value: values[place],
        }),
    }
}
