//! From candidates and options to a design.

use std::collections::HashMap;
use std::path::Path;

use ecm_doe::regressor::{Model, Regressor, column_ranges, normalise, prediction_region};
use ecm_doe::{
    Candidates, Control, Criterion, DSettings, Design, DesignError, MaximinSettings, Method,
    SpacingMethod, maximin,
};

use crate::args::{Args, MAXIMIN, Search};
use crate::failure::Failure;
use crate::rows;
use crate::table::{Columns, POSE, Table};

/// The candidates as numbers.
pub struct Job {
    /// The candidates' table.
    pub table: Table,
    columns: Columns,
    measured: Vec<f64>,
    include: Vec<usize>,
    exclude: Vec<usize>,
    /// Candidates with the coordinates of an earlier one.
    pub repeated: usize,
}

impl Job {
    /// Reads the tables and lists of `args`.
    pub fn read(args: &Args, path: &Path, interrupted: &dyn Fn() -> bool) -> Result<Self, Failure> {
        let table = Table::read(path, interrupted)?;
        let at = table.coordinates(&args.columns)?;
        let columns = table.numbers(at, args.skip_bad_rows, interrupted)?;
        let mut position = vec![usize::MAX; table.len()];
        for (p, &row) in columns.rows.iter().enumerate() {
            position[row] = p;
        }
        let mut include = Vec::new();
        if let Some(text) = &args.include {
            for row in rows::list("--include", text, table.len())? {
                if position[row] == usize::MAX {
                    return Err(Failure::Input(format!(
                        "--include: row {} has a bad cell; correct it",
                        row + 1
                    )));
                }
                if include.contains(&position[row]) {
                    return Err(Failure::Input(format!(
                        "--include: row {} occurs twice; name it once",
                        row + 1
                    )));
                }
                include.push(position[row]);
            }
        }
        let mut out = vec![false; columns.rows.len()];
        for text in &args.exclude {
            for row in rows::list_or_region("--exclude", text, &table, &columns)? {
                if position[row] != usize::MAX {
                    out[position[row]] = true;
                }
            }
        }
        if let Some(&p) = include.iter().find(|&&p| out[p]) {
            let row = columns.rows[p] + 1;
            return Err(Failure::Input(format!(
                "row {row} is both included and excluded; remove it from one list"
            )));
        }
        let repeated = if args.replicates {
            0
        } else {
            set_aside_repeats(&columns, &include, &mut out)
        };
        let exclude = (0..out.len()).filter(|&p| out[p]).collect();
        let measured = match &args.augment {
            None => Vec::new(),
            Some(path) => read_measured(path, &table, &columns, args.skip_bad_rows, interrupted)?,
        };
        Ok(Self {
            table,
            columns,
            measured,
            include,
            exclude,
            repeated,
        })
    }

    /// Number of candidates.
    pub fn candidates(&self) -> usize {
        self.columns.rows.len()
    }

    /// Rows left out because of bad cells.
    pub fn skipped(&self) -> usize {
        self.columns.skipped
    }

    /// Table rows (from 0) of a design.
    pub fn rows(&self, design: &Design) -> Vec<usize> {
        design
            .indices
            .iter()
            .map(|&p| self.columns.rows[p])
            .collect()
    }

    /// Names of the coordinate columns.
    pub fn coordinates(&self) -> Vec<&str> {
        self.columns
            .at
            .iter()
            .map(|&c| self.table.header[c].as_str())
            .collect()
    }

    /// Searches the design.
    pub fn run(&self, args: &Args, path: &Path, control: &Control<'_>) -> Result<Design, Failure> {
        let n = args.n.unwrap_or(0).saturating_add(self.include.len());
        if args.criterion == MAXIMIN {
            self.run_maximin(args, n, control)
        } else {
            self.run_model(args, path, n, control)
        }
    }

    fn run_maximin(&self, args: &Args, n: usize, control: &Control<'_>) -> Result<Design, Failure> {
        if args.replicates {
            return Err(Failure::Input(
                "--replicates: a pose chosen twice has distance 0; leave it out for maximin".into(),
            ));
        }
        let width = self.columns.at.len();
        let (measured, points) = match args.metres_per_radian {
            Some(length) => {
                let scale = self.metres(length)?;
                (
                    scaled(&self.measured, &scale),
                    scaled(&self.columns.values, &scale),
                )
            }
            None => {
                let (lower, upper) = column_ranges(&self.columns.values, width);
                (
                    normalise(&self.measured, &lower, &upper)?,
                    normalise(&self.columns.values, &lower, &upper)?,
                )
            }
        };
        let settings = MaximinSettings {
            n,
            starts: args.starts,
            iterations: args.iterations,
            seed: args.seed,
            threads: args.threads,
            method: match args.search {
                Search::Best => SpacingMethod::Search,
                Search::Paper => SpacingMethod::Exchange,
            },
            include: self.include.clone(),
            exclude: self.exclude.clone(),
            measured,
        };
        Ok(maximin(&points, width, &settings, control)?)
    }

    /// Metres of a unit of each coordinate, a radian being `length`.
    fn metres(&self, length: f64) -> Result<Vec<f64>, Failure> {
        if !(length > 0.0 && length.is_finite()) {
            return Err(Failure::Input(format!(
                "--metres-per-radian: {length}, expected a positive number"
            )));
        }
        let unit = |name: &&str| match POSE.iter().position(|p| p == name) {
            Some(place) if place < 3 => Ok(1.0),
            Some(_) => Ok(length),
            None => Err(Failure::Input(format!(
                "{}: --metres-per-radian: column {name} is no pose column, expected {}; leave the option out",
                self.table.name,
                POSE.join(", ")
            ))),
        };
        self.coordinates().iter().map(unit).collect()
    }

    fn run_model(
        &self,
        args: &Args,
        path: &Path,
        n: usize,
        control: &Control<'_>,
    ) -> Result<Design, Failure> {
        let Some(model) = Model::from_name(&args.model) else {
            return Err(Failure::Input(format!(
                "--model: {:?} has no regressor, expected linear, quadratic, cubic, poly:D (D up to 20), energyD, energyD-revolution or energyD-general (D = 4, 5, 6)",
                args.model
            )));
        };
        let width = self.columns.at.len();
        let mut all = self.columns.values.clone();
        all.extend_from_slice(&self.measured);
        let regressor = self.regressor(model, &all, args, path)?;
        let criterion = Criterion::of_model(&args.criterion)?;
        let region = if criterion.averaged {
            let (lower, upper) = column_ranges(&self.columns.values, width);
            let rows_of = |points: &[f64]| self.regressor(model, points, args, path);
            let points = &self.columns.values;
            Some(prediction_region(points, &lower, &upper, rows_of)?)
        } else {
            None
        };
        let Regressor {
            mut rows,
            block,
            terms,
        } = regressor;
        let measured = rows.split_off(self.columns.values.len() / width * block * terms);
        let settings = DSettings {
            n,
            starts: args.starts,
            iterations: args.iterations,
            seed: args.seed,
            threads: args.threads,
            method: match args.search {
                Search::Best => Method::Search,
                Search::Paper => Method::Fedorov,
            },
            replicates: args.replicates,
            include: self.include.clone(),
            exclude: self.exclude.clone(),
            measured,
            prior: prior(args, model, terms)?,
        };
        let candidates = Candidates {
            regressor: &rows,
            block,
            terms,
            share: args.share,
            region: region.as_deref(),
        };
        criterion
            .search(&candidates, &settings, control)
            .map_err(|e| self.explain(e, args))
    }

    fn regressor(
        &self,
        model: Model,
        all: &[f64],
        args: &Args,
        path: &Path,
    ) -> Result<Regressor, Failure> {
        let input =
            |e: ecm_poly::ModelError| Failure::Input(format!("--model {}: {e}", args.model));
        match model {
            Model::Polynomial { degree } => {
                let (lower, upper) = column_ranges(&self.columns.values, self.columns.at.len());
                if let Some(c) = (0..lower.len()).find(|&c| upper[c] <= lower[c] && degree > 0) {
                    let name = &self.table.header[self.columns.at[c]];
                    return Err(Failure::Input(format!(
                        "{}: column {name} is {} in every row, expected it to vary; leave it out with --columns",
                        self.table.name, lower[c]
                    )));
                }
                Model::polynomial(all, degree, &lower, &upper).map_err(input)
            }
            Model::Energy { degree, symmetry } => {
                if self.coordinates() != POSE {
                    return Err(Failure::Input(format!(
                        "{}: --model {} needs the six pose columns {}, found {}; give a polynomial model for other coordinates",
                        self.table.name,
                        args.model,
                        POSE.join(", "),
                        self.coordinates().join(", ")
                    )));
                }
                let length_m = match args.length {
                    Some(given) => given,
                    None => length_beside(path)?,
                };
                let poses: Vec<[f64; 6]> = all
                    .chunks_exact(6)
                    .map(|r| std::array::from_fn(|c| r[c]))
                    .collect();
                Model::energy(&poses, degree, symmetry, length_m).map_err(input)
            }
            _ => Err(Failure::Input(format!(
                "--model {}: no design can be searched for it, expected a polynomial or an energy",
                args.model
            ))),
        }
    }

    /// Errors of the library with the file and with rows counted from 1.
    fn explain(&self, error: DesignError, args: &Args) -> Failure {
        match error {
            DesignError::TooMany { n, candidates } => Failure::Input(format!(
                "{}: n = {}, but only {candidates} of {} rows can be chosen ({} repeat an earlier row, {} are excluded or skipped); lower --n, give more candidates or allow --replicates",
                self.table.name,
                n - self.include.len(),
                self.table.len(),
                self.repeated,
                self.exclude.len() - self.repeated + self.skipped(),
            )),
            DesignError::RankDeficient { .. } => Failure::Input(format!(
                "{}: --model {}: {error}",
                self.table.name, args.model
            )),
            other => other.into(),
        }
    }
}

/// Multiplies each row by `scale`.
fn scaled(values: &[f64], scale: &[f64]) -> Vec<f64> {
    let rows = values.chunks_exact(scale.len());
    rows.flat_map(|row| row.iter().zip(scale).map(|(v, s)| v * s))
        .collect()
}

/// lambda I; a polynomial's constant, the first term, stays free.
fn prior(args: &Args, model: Model, terms: usize) -> Result<Option<Vec<f64>>, Failure> {
    if args.ridge == 0.0 {
        return Ok(None);
    }
    if !(args.ridge > 0.0 && args.ridge.is_finite()) {
        let found = args.ridge;
        return Err(Failure::Input(format!(
            "--ridge: {found}, expected a positive number, 0 for none"
        )));
    }
    let first = usize::from(matches!(model, Model::Polynomial { .. }));
    let mut prior = vec![0.0; terms * terms];
    for i in first..terms {
        prior[i * terms + i] = args.ridge;
    }
    Ok(Some(prior))
}

/// Excludes rows that repeat the coordinates of another, but never included rows; returns their number.
fn set_aside_repeats(columns: &Columns, include: &[usize], out: &mut [bool]) -> usize {
    let width = columns.at.len();
    // + 0.0 makes -0 and 0 the same pose.
    let key = |p: usize| -> Vec<u64> {
        columns.values[p * width..(p + 1) * width]
            .iter()
            .map(|v| (v + 0.0).to_bits())
            .collect()
    };
    let mut seen: HashMap<Vec<u64>, ()> = include.iter().map(|&p| (key(p), ())).collect();
    let mut count = 0;
    for p in 0..out.len() {
        if out[p] || include.contains(&p) {
            continue;
        }
        if seen.insert(key(p), ()).is_some() {
            out[p] = true;
            count += 1;
        }
    }
    count
}

/// The coordinates of poses measured before.
fn read_measured(
    path: &Path,
    table: &Table,
    columns: &Columns,
    skip: bool,
    interrupted: &dyn Fn() -> bool,
) -> Result<Vec<f64>, Failure> {
    let other = Table::read(path, interrupted)?;
    let names: Vec<String> = columns
        .at
        .iter()
        .map(|&c| table.header[c].clone())
        .collect();
    let at = other.coordinates(&names)?;
    Ok(other.numbers(at, skip, interrupted)?.values)
}

/// `length_m` of `[mechanism]` in the TOML beside the table.
pub fn length_beside(path: &Path) -> Result<f64, Failure> {
    let meta = path.with_extension("toml");
    let wanted = "energy models need the undeformed length: give --length METRES or length_m under [mechanism]";
    let name = meta.display();
    let text = std::fs::read_to_string(&meta)
        .map_err(|e| Failure::Input(format!("{name}: cannot be read ({e}); {wanted}")))?;
    let document: toml::Table = text.parse().map_err(|e: toml::de::Error| {
        Failure::Input(format!("{name}: {}", e.to_string().trim()))
    })?;
    let value = document.get("mechanism").and_then(|m| m.get("length_m"));
    let number = value.and_then(|v| v.as_float().or_else(|| v.as_integer().map(|i| i as f64)));
    number.ok_or_else(|| {
        Failure::Input(format!(
            "{name}: no number length_m under [mechanism]; {wanted}"
        ))
    })
}
