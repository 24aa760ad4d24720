//! Errors of the input of a design.

/// Wrong input of a design; each message names what was found, what is expected, and the next step.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DesignError {
    /// A table, a list or a region that cannot be used: place, what was found, what was expected.
    #[error("{0}")]
    Input(String),
    /// There is nothing to choose from.
    #[error(
        "there are no candidates: expected at least one row with at least one column; check the candidate table"
    )]
    Empty,
    /// The array's length does not fit its shape.
    #[error("{what} holds {found} numbers, expected {expected}; check its shape")]
    Shape {
        /// Which array.
        what: &'static str,
        /// Numbers found.
        found: usize,
        /// Numbers expected.
        expected: usize,
    },
    /// A number is NaN or infinite.
    #[error(
        "{what}: row {row}, column {column} is {value}, expected a finite number; correct or leave out this row"
    )]
    NotFinite {
        /// Which array.
        what: &'static str,
        /// Row, counted from 0.
        row: usize,
        /// Column, counted from 0.
        column: usize,
        /// The value found.
        value: f64,
    },
    /// A number whose squares overflow, or a column whose squares vanish.
    #[error(
        "{what}: row {row}, column {column} is {value:e}, expected {expected}; give this column in another unit or leave out this row"
    )]
    Size {
        /// Which array.
        what: &'static str,
        /// Row, counted from 0.
        row: usize,
        /// Column, counted from 0.
        column: usize,
        /// The value found.
        value: f64,
        /// The allowed sizes.
        expected: &'static str,
    },
    /// Rows that give no information, or too little or too much, in the units of the candidates.
    #[error(
        "{what}: the information of its rows is {found:e}, measured by that of the candidates, expected 1e-100 to 1e100; give its rows in the units of the candidates"
    )]
    Information {
        /// Which array.
        what: &'static str,
        /// Its size, infinite where it overflows.
        found: f64,
    },
    /// A search that would not fit into memory.
    #[error(
        "{starts} starts of n = {n} poses and {width} numbers a pose make {numbers} numbers, expected at most {most}; lower n or starts, or give fewer candidates"
    )]
    TooBig {
        /// Independent starts.
        starts: usize,
        /// Poses of each start: those to choose, or with those measured before.
        n: usize,
        /// Numbers kept for each pose of the design.
        width: usize,
        /// Numbers in all.
        numbers: usize,
        /// Most numbers.
        most: usize,
    },
    /// More design points than candidates.
    #[error(
        "n = {n}, but only {candidates} candidates can be chosen (each at most once); lower n, give more candidates or allow replicates"
    )]
    TooMany {
        /// Design size asked for.
        n: usize,
        /// Candidates that may be chosen.
        candidates: usize,
    },
    /// Fewer rows than coefficients.
    #[error(
        "n = {n} poses give {rows} rows for {terms} coefficients, which they cannot determine; ask for at least n = {needed} or take a smaller model"
    )]
    TooFew {
        /// Design size asked for.
        n: usize,
        /// Regressor rows of the design, with those already measured.
        rows: usize,
        /// Coefficients of the model.
        terms: usize,
        /// Smallest design size that can work.
        needed: usize,
    },
    /// A design needs a minimum size.
    #[error("n = {n}, expected at least {least} for {criterion}; raise n")]
    Small {
        /// Design size asked for.
        n: usize,
        /// Least size.
        least: usize,
        /// The criterion.
        criterion: &'static str,
    },
    /// The candidates do not determine the coefficients.
    #[error(
        "the {candidates} candidates cannot determine the model: term {column} (counted from 0) is a combination of the terms before it, so every design is singular; vary the poses more, take a smaller model or leave out constant columns"
    )]
    RankDeficient {
        /// Number of candidates.
        candidates: usize,
        /// First dependent column of the regressor.
        column: usize,
    },
    /// The rows of the poses depend on each other.
    #[error(
        "no design of n = {n} poses was found that determines the {terms} coefficients: the rows of so few poses depend on each other; raise n or take a smaller model"
    )]
    Singular {
        /// Design size asked for.
        n: usize,
        /// Coefficients of the model.
        terms: usize,
    },
    /// A candidate index outside the table.
    #[error("{what} names candidate {index}, expected 0 to {last}; check the list")]
    Index {
        /// Which list.
        what: &'static str,
        /// The index found.
        index: usize,
        /// The last candidate.
        last: usize,
    },
    /// More rows must be in the design than it has.
    #[error("{include} rows must be in the design but n = {n}; raise n or shorten the list")]
    IncludeTooLong {
        /// Rows that must be in.
        include: usize,
        /// Design size.
        n: usize,
    },
    /// A row both included and excluded, or included twice.
    #[error("candidate {index} is {what}; remove it from one list")]
    Contradiction {
        /// The candidate.
        index: usize,
        /// The contradiction.
        what: &'static str,
    },
    /// A setting outside its range.
    #[error("{name} = {value}, expected {expected}")]
    Setting {
        /// The setting's name.
        name: &'static str,
        /// The value found.
        value: String,
        /// The allowed range.
        expected: &'static str,
    },
    /// A name that is no criterion of a model's designs.
    #[error("criterion = {name:?}, expected one of {known}")]
    Criterion {
        /// The name found.
        name: String,
        /// The known names.
        known: String,
    },
    /// The worker threads could not be started.
    #[error("could not start {threads} worker threads: {reason}; ask for fewer")]
    Threads {
        /// Threads asked for.
        threads: usize,
        /// The system's reason.
        reason: String,
    },
}
