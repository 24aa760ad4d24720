//! The criteria by name: the one list that the binary, the bindings and Python read.

use super::alphabetic::{a_optimal, compound_optimal, d_optimal, i_optimal};
use super::minimax::g_optimal;
use super::settings::{DSettings, Design};
use crate::{Control, DesignError};

/// All criteria, each with what a design's sentence says of it.
pub const CRITERIA: &[Criterion] = &[
    Criterion::new("d", "D-efficiency", |c, s, control| {
        d_optimal(c.regressor, c.block, c.terms, s, control)
    }),
    Criterion::new("i", "average variance of h and K", |c, s, control| {
        i_optimal(c.regressor, c.block, c.terms, c.region, s, control)
    })
    .averaged(),
    Criterion::new("a", "summed coefficient variance", |c, s, control| {
        a_optimal(c.regressor, c.block, c.terms, s, control)
    }),
    Criterion::new("g", "largest prediction variance", |c, s, control| {
        g_optimal(c.regressor, c.block, c.terms, s, control)
    }),
    Criterion::new("di", "D- and I-efficiency together", |c, s, control| {
        compound_optimal(c.regressor, c.block, c.terms, c.share, c.region, s, control)
    })
    .averaged(),
    Criterion::of_distances("maximin", "smallest distance"),
];

/// Candidates of a model, and what some criteria need besides.
#[derive(Debug, Clone, Copy)]
pub struct Candidates<'a> {
    /// (N * block) x terms, row-major.
    pub regressor: &'a [f64],
    /// Rows of a pose.
    pub block: usize,
    /// Coefficients.
    pub terms: usize,
    /// Share of the determinant in a compound criterion, 0 to 1.
    pub share: f64,
    /// Rows over which an averaged criterion takes the mean; the candidates' own if `None`.
    pub region: Option<&'a [f64]>,
}

type Search = fn(&Candidates<'_>, &DSettings, &Control<'_>) -> Result<Design, DesignError>;

/// A criterion of designs.
#[derive(Debug, Clone, Copy)]
pub struct Criterion {
    /// Its short name.
    pub name: &'static str,
    /// What its value is.
    pub meaning: &'static str,
    /// Whether it averages over a region.
    pub averaged: bool,
    /// The search of a model's design; `None` for distances of points, see [`crate::maximin`].
    search: Option<Search>,
}

impl Criterion {
    const fn new(name: &'static str, meaning: &'static str, search: Search) -> Self {
        Self {
            name,
            meaning,
            averaged: false,
            search: Some(search),
        }
    }

    const fn of_distances(name: &'static str, meaning: &'static str) -> Self {
        Self {
            name,
            meaning,
            averaged: false,
            search: None,
        }
    }

    const fn averaged(mut self) -> Self {
        self.averaged = true;
        self
    }

    /// The criterion of a model's designs of this name.
    ///
    /// # Errors
    /// Another name.
    ///
    /// ```
    /// use ecm_doe::{Candidates, Control, Criterion, DSettings};
    /// # fn main() -> Result<(), ecm_doe::DesignError> {
    /// let regressor = [1.0, -1.0, 1.0, 0.0, 1.0, 1.0];
    /// let candidates = Candidates { regressor: &regressor, block: 1, terms: 2, share: 0.5, region: None };
    /// let settings = DSettings { n: 2, ..DSettings::default() };
    /// let design = Criterion::of_model("a")?.search(&candidates, &settings, &Control::new())?;
    /// assert_eq!(design.indices, [0, 2]);
    /// # Ok(()) }
    /// ```
    pub fn of_model(name: &str) -> Result<&'static Self, DesignError> {
        let known = CRITERIA
            .iter()
            .find(|c| c.name == name && c.search.is_some());
        known.ok_or_else(|| unknown(name))
    }

    /// The design of a model.
    ///
    /// # Errors
    /// A criterion of distances, and those of the search, for instance [`crate::d_optimal`].
    pub fn search(
        &self,
        candidates: &Candidates<'_>,
        settings: &DSettings,
        control: &Control<'_>,
    ) -> Result<Design, DesignError> {
        let search = self.search.ok_or_else(|| unknown(self.name))?;
        search(candidates, settings, control)
    }
}

/// No criterion of models has this name.
fn unknown(name: &str) -> DesignError {
    let models = CRITERIA.iter().filter(|c| c.search.is_some());
    let names: Vec<&str> = models.map(|c| c.name).collect();
    DesignError::Criterion {
        name: name.into(),
        known: names.join(", "),
    }
}
