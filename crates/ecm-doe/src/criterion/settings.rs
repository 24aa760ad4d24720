//! Settings and result of a design.

use crate::problem::{check_blocks, check_sizes};
use crate::{DesignError, Problem, Status};

/// Algorithm of the search for the best design.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Method {
    /// Fedorov's exchange of the best pair, from random starts (the paper's).
    Fedorov,
    /// Exchange of each row in turn for its best candidate, from random starts.
    RowWise,
    /// Starts drawn from the continuous optimum, then an iterated local search.
    #[default]
    Search,
}

/// Settings of [`d_optimal`](crate::d_optimal).
#[derive(Debug, Clone)]
pub struct DSettings {
    /// Design size: with the included poses, without the poses measured before.
    pub n: usize,
    /// Number of independent starts.
    pub starts: usize,
    /// Search: disturbances in each of the four chains; else swaps per start. 0: default.
    pub iterations: usize,
    /// Seed of the random generator.
    pub seed: u64,
    /// Worker threads, 0 for all; no influence on the result.
    pub threads: usize,
    /// Algorithm.
    pub method: Method,
    /// A pose may be chosen more than once.
    pub replicates: bool,
    /// Candidates that must be in the design.
    pub include: Vec<usize>,
    /// Candidates that must not be chosen.
    pub exclude: Vec<usize>,
    /// Regressor rows already measured, any number x k: they add information, but are not chosen again.
    pub measured: Vec<f64>,
    /// Prior information, k x k (Bayesian D: ridge = diag(lambda)).
    pub prior: Option<Vec<f64>>,
}

impl Default for DSettings {
    fn default() -> Self {
        Self {
            n: 0,
            starts: 10,
            iterations: 0,
            seed: 0,
            threads: 0,
            method: Method::Search,
            replicates: false,
            include: Vec::new(),
            exclude: Vec::new(),
            measured: Vec::new(),
            prior: None,
        }
    }
}

/// Chains of the iterated local search; a constant, so that threads do not change the result.
pub const CHAINS: usize = 4;

/// A design, its value and a certified bound.
#[derive(Debug, Clone)]
pub struct Design {
    /// Chosen candidates, sorted; repeated when replicates are allowed.
    pub indices: Vec<usize>,
    /// log det(M/n)/k, or the smallest distance.
    pub value: f64,
    /// Certified upper bound of `value` for every design of this kind.
    pub bound: f64,
    /// exp(value - bound), or value / bound.
    pub efficiency: f64,
    /// Number of swaps in all starts.
    pub exchanges: usize,
    /// Why the search ended.
    pub status: Status,
    /// Kiefer-Wolfowitz gap of the bound per coefficient (0 for distances).
    pub gap: f64,
}

/// Refuses a search without a start.
pub(crate) fn check_starts(starts: usize) -> Result<(), DesignError> {
    if starts > 0 {
        return Ok(());
    }
    Err(DesignError::Setting {
        name: "starts",
        value: "0".into(),
        expected: "at least 1",
    })
}

/// Applies lists and measured rows to a problem; returns the number of measured rows.
pub(crate) fn apply_settings(
    problem: &mut Problem,
    settings: &DSettings,
) -> Result<usize, DesignError> {
    let (n, k, b) = (settings.n, problem.terms, problem.block);
    check_starts(settings.starts)?;
    check_blocks("the measured rows", &settings.measured, k)?;
    check_sizes("the measured rows", &settings.measured, k, 0.0)?;
    apply_lists(
        &mut problem.available,
        n,
        &settings.include,
        &settings.exclude,
        settings.replicates,
    )?;
    let measured = settings.measured.len() / k;
    if n == 0 {
        return Err(DesignError::Small {
            n,
            least: 1,
            criterion: "D-optimality",
        });
    }
    if settings.prior.is_none() && n.saturating_mul(b).saturating_add(measured) < k {
        let needed = (k - measured).div_ceil(b);
        return Err(DesignError::TooFew {
            n,
            rows: n * b + measured,
            terms: k,
            needed,
        });
    }
    problem.fix_rows(&settings.measured)?;
    for &i in &settings.include {
        problem.fix(i);
    }
    Ok(measured)
}

/// Marks the candidates that may be chosen; included poses (without replicates) and excluded poses
/// may not.
pub(crate) fn apply_lists(
    available: &mut [bool],
    n: usize,
    include: &[usize],
    exclude: &[usize],
    replicates: bool,
) -> Result<(), DesignError> {
    let last = available.len().saturating_sub(1);
    for (what, list) in [("the include list", include), ("the exclude list", exclude)] {
        if let Some(&index) = list.iter().find(|&&i| i > last) {
            return Err(DesignError::Index { what, index, last });
        }
    }
    let mut included = vec![false; available.len()];
    for &index in include {
        if included[index] && !replicates {
            return Err(DesignError::Contradiction {
                index,
                what: "included twice",
            });
        }
        included[index] = true;
    }
    for &index in exclude {
        if included[index] {
            return Err(DesignError::Contradiction {
                index,
                what: "both included and excluded",
            });
        }
        available[index] = false;
    }
    if include.len() > n {
        return Err(DesignError::IncludeTooLong {
            include: include.len(),
            n,
        });
    }
    let candidates = available.iter().filter(|a| **a).count();
    if !replicates {
        for &i in include {
            available[i] = false;
        }
    }
    if (n > candidates && !replicates) || candidates == 0 {
        return Err(DesignError::TooMany { n, candidates });
    }
    Ok(())
}
