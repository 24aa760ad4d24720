//! From candidates and options to a design.

use std::path::Path;

use ecm_doe::regressor::{Model, Regressor, column_ranges, normalise, prediction_region};
use ecm_doe::{
    Candidates, Columns, Control, Criterion, DSettings, Design, DesignError, MaximinSettings,
    Method, SpacingMethod, Table, maximin, repeated_rows, row_list, rows_inside,
};
use ecm_poly::model_file::map::POSE;

use crate::Failure;
use crate::args::Args;

/// The candidates as numbers, and what may or must be chosen.
pub struct Job {
    pub table: Table,
    pub columns: Columns,
    /// Candidates with the coordinates of an earlier one.
    pub repeated: usize,
    /// The option's, or that of `[mechanism]` in the TOML beside the table; or why there is none.
    pub length_m: Result<f64, String>,
    measured: Vec<f64>,
    include: Vec<usize>,
    exclude: Vec<usize>,
}

impl Job {
    /// Reads the tables and lists of `args`.
    pub fn read(args: &Args, path: &Path) -> Result<Self, Failure> {
        let table = Table::read(path)?;
        let columns = table.numbers(table.coordinates(&args.columns)?, args.skip_bad_rows)?;
        let (rows, points) = (&columns.rows, &columns.values);
        let named = |option: &str, text: &str| {
            let rows = row_list(text, table.len());
            rows.map_err(|e| Failure(2, format!("{option}: {e}")))
        };
        let mut include = Vec::new();
        let listed = args.include.iter().map(|text| named("--include", text));
        for row in listed.collect::<Result<Vec<_>, _>>()?.concat() {
            match rows.binary_search(&row) {
                Ok(place) => include.push(place),
                Err(_) => bad!("--include: row {} has a bad cell; correct it", row + 1),
            }
        }
        let mut exclude = Vec::new();
        for text in &args.exclude {
            if text.contains(['<', '>', '=']) {
                let inside = rows_inside(text, &columns.names, points);
                exclude.extend(inside.map_err(|e| Failure(2, format!("--exclude: {e}")))?);
            } else {
                let listed = named("--exclude", text)?;
                exclude.extend(listed.iter().flat_map(|row| rows.binary_search(row)));
            }
        }
        if let Some(&p) = include.iter().find(|p| exclude.contains(p)) {
            bad!(
                "row {} is both included and excluded; remove it from one list",
                rows[p] + 1
            );
        }
        let mut repeated = Vec::new();
        if !args.replicates {
            repeated = repeated_rows(points, columns.names.len(), &include, &exclude);
            exclude.extend(&repeated);
        }
        exclude.sort_unstable();
        exclude.dedup();
        let mut measured = Vec::new();
        if let Some(path) = &args.augment {
            let other = Table::read(path)?;
            let at = other.coordinates(&columns.names)?;
            measured = other.numbers(at, args.skip_bad_rows)?.values;
        }
        let repeated = repeated.len();
        let length_m = args.length.map_or_else(|| length_beside(path), Ok);
        Ok(Self {
            table,
            columns,
            repeated,
            length_m,
            measured,
            include,
            exclude,
        })
    }

    /// Rows left out because of bad cells.
    pub fn skipped(&self) -> usize {
        self.table.len() - self.columns.rows.len()
    }

    /// Searches the design.
    pub fn run(&self, args: &Args, control: &Control<'_>) -> Result<Design, Failure> {
        let n = args.n.unwrap_or(0).saturating_add(self.include.len());
        let (points, width) = (&self.columns.values, self.columns.names.len());
        let (lower, upper) = column_ranges(points, width);
        let paper = args.search == "paper";
        if args.is_maximin() {
            if args.replicates {
                bad!("--replicates: a pose chosen twice has distance 0; leave it out for maximin");
            }
            let scaled = |values: &[f64]| match args.metres_per_radian {
                Some(length) => self.in_metres(values, length),
                None => Ok(normalise(values, &lower, &upper)?),
            };
            let settings = MaximinSettings {
                n,
                starts: args.starts,
                iterations: args.iterations,
                seed: args.seed,
                threads: args.threads,
                method: [SpacingMethod::Search, SpacingMethod::Exchange][usize::from(paper)],
                include: self.include.clone(),
                exclude: self.exclude.clone(),
                measured: scaled(&self.measured)?,
            };
            return Ok(maximin(&scaled(points)?, width, &settings, control)?);
        }
        let (name, file) = (&args.model, &self.table.name);
        let Some(model) = Model::from_name(name) else {
            bad!(
                "--model: {name:?} has no regressor, expected linear, quadratic, cubic, poly:D (D up to 20), energyD, energyD-revolution or energyD-general (D = 4, 5, 6)"
            );
        };
        let length_m = self.length(model, args, [&lower, &upper])?;
        let rows_of = |points: &[f64]| {
            let rows = model.regressor(points, (&lower, &upper), length_m);
            rows.map_err(|e| Failure(2, format!("--model {name}: {e}")))
        };
        let all = rows_of(&[&points[..], &self.measured].concat())?;
        let ridge = args.ridge;
        if !(ridge >= 0.0 && ridge.is_finite()) {
            bad!("--ridge: {ridge}, expected a positive number, 0 for none");
        }
        let prior = (ridge > 0.0).then(|| all.ridge(ridge));
        let Regressor { rows, block, terms } = all;
        let (rows, measured) = rows.split_at(self.columns.rows.len() * block * terms);
        let criterion = Criterion::of_model(&args.criterion)?;
        let region = criterion
            .averaged
            .then(|| prediction_region(points, &lower, &upper, rows_of));
        let region = region.transpose()?;
        let settings = DSettings {
            n,
            starts: args.starts,
            iterations: args.iterations,
            seed: args.seed,
            threads: args.threads,
            method: [Method::Search, Method::Fedorov][usize::from(paper)],
            replicates: args.replicates,
            include: self.include.clone(),
            exclude: self.exclude.clone(),
            measured: measured.to_vec(),
            prior,
        };
        let (share, region) = (args.share, region.as_deref());
        let candidates = Candidates {
            regressor: rows,
            block,
            terms,
            share,
            region,
        };
        match criterion.search(&candidates, &settings, control) {
            Err(DesignError::TooMany { n, candidates }) => {
                let (asked, all, repeat) =
                    (n - self.include.len(), self.table.len(), self.repeated);
                let out = self.exclude.len() + self.skipped() - repeat;
                bad!(
                    "{file}: n = {asked}, but only {candidates} of {all} rows can be chosen ({repeat} repeat an earlier row, {out} are excluded or skipped); lower --n, give more candidates or allow --replicates"
                );
            }
            Err(e @ DesignError::RankDeficient { .. }) => bad!("{file}: --model {name}: {e}"),
            other => Ok(other?),
        }
    }

    /// Coordinates in metres, a radian being `length`.
    fn in_metres(&self, values: &[f64], length: f64) -> Result<Vec<f64>, Failure> {
        if !(length > 0.0 && length.is_finite()) {
            bad!("--metres-per-radian: {length}, expected a positive number");
        }
        let (names, file, known) = (&self.columns.names, &self.table.name, POSE.join(", "));
        if let Some(name) = names.iter().find(|name| !POSE.contains(&name.as_str())) {
            bad!(
                "{file}: --metres-per-radian: column {name} is no pose column, expected {known}; leave the option out"
            );
        }
        let unit = |name: &String| if name.ends_with("_rad") { length } else { 1.0 };
        let scaled = values.iter().zip(names.iter().map(unit).cycle());
        Ok(scaled.map(|(v, unit)| v * unit).collect())
    }

    /// Refuses columns that the model cannot have; the length of an energy's mechanism (m).
    fn length(&self, model: Model, args: &Args, ends: [&[f64]; 2]) -> Result<f64, Failure> {
        let (file, names, [lower, upper]) = (&self.table.name, &self.columns.names, ends);
        if let Model::Polynomial { degree } = model {
            if let Some(c) = (0..lower.len()).find(|&c| upper[c] <= lower[c] && degree > 0) {
                let (name, found) = (&names[c], lower[c]);
                bad!(
                    "{file}: column {name} is {found} in every row, expected it to vary; leave it out with --columns"
                );
            }
            return Ok(f64::NAN);
        }
        if *names != POSE {
            let (model, wanted, found) = (&args.model, POSE.join(", "), names.join(", "));
            bad!(
                "{file}: --model {model} needs the six pose columns {wanted}, found {found}; give a polynomial model for other coordinates"
            );
        }
        self.length_m.clone().map_err(|text| Failure(2, text))
    }
}

/// `length_m` of `[mechanism]` in the TOML beside the table.
fn length_beside(path: &Path) -> Result<f64, String> {
    let meta = path.with_extension("toml");
    let said = |what: String| {
        let name = meta.display();
        format!(
            "{name}: {what}; energy models need the undeformed length: give --length METRES or length_m under [mechanism]"
        )
    };
    let text = std::fs::read_to_string(&meta).map_err(|e| said(format!("cannot be read ({e})")))?;
    let document: toml::Table = text.parse().map_err(|e| said(format!("{e}")))?;
    let value = document.get("mechanism").and_then(|m| m.get("length_m"));
    let number = value.and_then(|v| v.as_float().or(v.as_integer().map(|i| i as f64)));
    number.ok_or_else(|| said("no number length_m under [mechanism]".into()))
}
