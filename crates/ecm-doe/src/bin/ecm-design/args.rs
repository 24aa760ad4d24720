//! The command line.

use std::path::PathBuf;

use clap::Parser;
use clap::builder::{PossibleValue, PossibleValuesParser};
use ecm_doe::{CRITERIA, Criterion, Protocol};

/// The criteria of the library, with what they mean.
fn criteria() -> PossibleValuesParser {
    let value = |c: &Criterion| PossibleValue::new(c.name).help(c.meaning);
    PossibleValuesParser::new(CRITERIA.iter().map(value))
}

/// `--help` on one screen; the man page has every option in full.
const HELP: &str = "\
Chooses N candidate poses of a CSV table and says how close to the best that is

Usage: ecm-design CANDIDATES --n N [OPTIONS]     (CANDIDATES - : standard input)

  --n N                 poses to choose, besides those of --include
  --criterion NAME      d, i, a, g, di, maximin (default: d; di with --share S)
  --model NAME          cubic (default), linear, quadratic, poly:D, energyD with
                        D 4..6 (energyD-revolution, energyD-general; --length M)
  --columns A,B         coordinates (default: pose columns, or all numeric ones)
  --preset NAME         protocol: paper, diagnosable (default: the poses alone)
  --include 1,5-9       must be in; rows count from 1
  --exclude ROWS|REGION must not, e.g. 7 or 'x_m<0.09&y_m>0'; may be repeated
  --augment FILE        poses already measured
  --replicates          a pose may be chosen again       --ridge LAMBDA  a prior
  --metres-per-radian L maximin: distance in metres (default: ranges to [-1, 1])
  --search best|paper   the paper's exchange instead of the best search
  --starts N  --iterations N  --time-limit S     budget (about 10 s by default)
  --seed N  --threads N  threads (0: all) do not change the result
  --out FILE  --json FILE  --quiet  --skip-bad-rows
  --man  --completions SHELL  -V  -h              (ecm-design --man | man -l -)

Exit codes: 0 done, 1 failed, 2 bad input, 130 interrupted (best so far kept)
";

impl Args {
    /// Whether the criterion is that of distances.
    pub fn is_maximin(&self) -> bool {
        self.criterion == "maximin"
    }

    /// The protocol of the preset.
    pub fn protocol(&self) -> Protocol {
        match self.preset.as_deref() {
            None => Protocol::Plain,
            Some("paper") => Protocol::Paper,
            Some(_) => Protocol::Diagnosable,
        }
    }

    /// Name of the distance between two poses.
    pub fn distance(&self) -> String {
        let metres = self.metres_per_radian;
        let metres = metres.map(|length| format!("a radian counts as {length} m"));
        metres.unwrap_or("coordinates scaled to [-1, 1]".into())
    }
}

/// Chooses N of the candidate poses in a CSV table and says how close to the best that is.
#[derive(Debug, Parser)]
#[command(name = "ecm-design", version, override_help = HELP)]
#[command(
    after_help = "Exit codes: 0 done, 1 failed, 2 bad input, 130 interrupted (best so far kept)"
)]
pub struct Args {
    /// CSV table with one candidate per row; `-` reads standard input
    #[arg(required_unless_present_any = ["man", "completions"])]
    pub candidates: Option<PathBuf>,
    /// Number of poses to choose (with --include: besides those)
    #[arg(long, required_unless_present_any = ["man", "completions"])]
    pub n: Option<usize>,
    /// Determinant, average variance of predictions or coefficients, largest variance, smallest distance
    #[arg(long, value_parser = criteria(), default_value = "d")]
    pub criterion: String,
    /// linear, quadratic, cubic, poly:D, energyD, energyD-revolution, energyD-general (D 4..6)
    #[arg(long, default_value = "cubic")]
    pub model: String,
    /// Share of D in the criterion di
    #[arg(long, default_value_t = 0.5)]
    pub share: f64,
    /// maximin: count a radian as so many metres [default: every coordinate scaled to [-1, 1]]
    #[arg(long, value_name = "METRES")]
    pub metres_per_radian: Option<f64>,
    /// Protocol of the plan: the paper's, or two sides of approach, three dwells, home checks and
    /// unloaded readings between [default: each pose once]
    #[arg(long, value_parser = ["paper", "diagnosable"])]
    pub preset: Option<String>,
    /// Effects to be told apart: they need the nominal stiffness that `ecm design` has
    #[arg(long, value_name = "IDS", hide = true)]
    pub effects: Option<String>,
    /// Coordinate columns, comma-separated [default: the pose columns, or all numeric ones]
    #[arg(long, value_delimiter = ',')]
    pub columns: Vec<String>,
    /// Where to write the plan [default: standard output]
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Rows that must be in, e.g. `1,5-9` (the first data row is 1)
    #[arg(long, value_name = "ROWS")]
    pub include: Option<String>,
    /// Rows not to choose, or a region like `x_m<0.09&y_m>0`; may be given again
    #[arg(long, value_name = "ROWS|REGION")]
    pub exclude: Vec<String>,
    /// CSV table of poses already measured: they count but are not chosen again
    #[arg(long, value_name = "FILE")]
    pub augment: Option<PathBuf>,
    /// A pose may be chosen more than once (not for maximin)
    #[arg(long)]
    pub replicates: bool,
    /// Undeformed length for energy models [default: length_m in the table's .toml]
    #[arg(long, value_name = "METRES")]
    pub length: Option<f64>,
    /// The best found within the budget, or the paper's exchange from random starts
    #[arg(long, value_parser = ["best", "paper"], default_value = "best")]
    pub search: String,
    /// Independent starts
    #[arg(long, default_value_t = 10)]
    pub starts: usize,
    /// Search budget: disturbances (models), thousands of swaps (maximin); 0: 10 s or 20 s at paper size
    #[arg(long, default_value_t = 0)]
    pub iterations: usize,
    /// Stop after so many seconds; then the result depends on the machine
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    pub time_limit: f64,
    /// Seed of the random generator
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Threads, 0 for all; without influence on the result
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
    /// Prior information on every coefficient but the constant, in noise variances (Bayesian D, I, A)
    #[arg(long, value_name = "LAMBDA", default_value_t = 0.0)]
    pub ridge: f64,
    /// Leave out rows with bad cells instead of refusing the table
    #[arg(long)]
    pub skip_bad_rows: bool,
    /// Write the summary as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// No progress and no summary
    #[arg(long)]
    pub quiet: bool,
    /// Print the man page
    #[arg(long)]
    pub man: bool,
    /// Print shell completions
    #[arg(long, value_name = "SHELL")]
    pub completions: Option<clap_complete::Shell>,
}
