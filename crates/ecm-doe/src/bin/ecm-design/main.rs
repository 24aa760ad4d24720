//! `ecm-design`: chooses informative poses from a CSV table of candidates.

/// Returns with bad input.
macro_rules! bad {
    ($($text:tt)*) => { return Err($crate::Failure(2, format!($($text)*))) };
}

macro_rules! say {
    ($($text:tt)*) => { let _ = writeln!(std::io::stderr(), $($text)*); };
}

mod args;
mod job;

use std::io::{ErrorKind, Write};
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::{CommandFactory, Parser};
use ecm_doe::{CRITERIA, Control, Design, DesignError, Status, plan};
use indicatif::{ProgressBar, ProgressStyle};

use crate::args::Args;
use crate::job::Job;

/// Why there is no design: exit code, as that of the command `ecm`, and message.
pub struct Failure(u8, String);

impl From<DesignError> for Failure {
    fn from(error: DesignError) -> Self {
        let of_system = matches!(error, DesignError::Threads { .. });
        Self(if of_system { 1 } else { 2 }, error.to_string())
    }
}

impl From<ecm_poly::ModelError> for Failure {
    fn from(error: ecm_poly::ModelError) -> Self {
        Self(2, error.to_string())
    }
}

fn main() -> ExitCode {
    let done = match Args::try_parse() {
        Ok(args) => run(&args),
        Err(error) => {
            let _ = error.print();
            Ok(u8::try_from(error.exit_code()).unwrap_or(2))
        }
    };
    ExitCode::from(done.unwrap_or_else(|Failure(code, text)| {
        say!("error: {text}");
        code
    }))
}

fn run(args: &Args) -> Result<u8, Failure> {
    if args.man {
        let mut page = Vec::new();
        let done = clap_mangen::Man::new(Args::command()).render(&mut page);
        return done.or(Ok(())).and_then(|()| save(&page, None)).map(|()| 0);
    }
    if let Some(shell) = args.completions {
        let mut script = Vec::new();
        clap_complete::generate(shell, &mut Args::command(), "ecm-design", &mut script);
        return save(&script, None).map(|()| 0);
    }
    let limit = args.time_limit;
    if !(limit >= 0.0 && limit.is_finite()) {
        bad!("--time-limit: {limit}, expected seconds, 0 for none");
    }
    if args.effects.is_some() {
        bad!(
            "--effects: which effects a plan tells apart depends on the stiffness and the rig, which this binary does not know; use `ecm design --preset diagnosable --effects IDS`"
        );
    }
    let job = Job::read(args, args.candidates.as_deref().unwrap_or(Path::new("-")))?;
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    let caught = ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed));
    caught.map_err(|e| Failure(1, format!("Ctrl-C cannot be caught: {e}")))?;
    let bar = match args.quiet {
        true => ProgressBar::hidden(),
        false => ProgressBar::new(1000),
    };
    let style = "{bar:30} {percent:>3} %  {eta} left  {msg}";
    bar.set_style(ProgressStyle::with_template(style).unwrap_or(ProgressStyle::default_bar()));
    bar.enable_steady_tick(Duration::from_millis(200));
    let began = Instant::now();
    let report = |done: usize, total: usize, best: f64| {
        let of_time = if limit > 0.0 {
            began.elapsed().as_secs_f64() / limit
        } else {
            0.0
        };
        let share = (done as f64 / total.max(1) as f64).max(of_time);
        bar.set_position((share.min(1.0) * 1000.0) as u64);
        bar.set_message(format!("best {best:.5}"));
    };
    let control = Control::new().with_cancel(&stop).with_progress(&report);
    let design = job.run(args, &control.with_time_limit(limit));
    bar.finish_and_clear();
    let (design, length_m) = (design?, job.length_m.clone().ok());
    let rows: Vec<usize> = design
        .indices
        .iter()
        .map(|&p| job.columns.rows[p])
        .collect();
    let text = plan(&job.table, &rows, args.protocol(), length_m, args.seed)?;
    save(&text, args.out.as_deref())?;
    if args.json.is_some() {
        let text = format!("{:#}\n", summary(args, &job, &design, &rows));
        save(text.as_bytes(), args.json.as_deref())?;
    }
    let interrupted = design.status == Status::Interrupted;
    if interrupted {
        say!(
            "interrupted: kept the best of {} exchanges",
            design.exchanges
        );
    }
    if !args.quiet {
        notes(args, &job, &design);
    }
    Ok(if interrupted { 130 } else { 0 })
}

/// Writes a file as a whole, through a temporary file beside it, or standard output.
fn save(text: &[u8], out: Option<&Path>) -> Result<(), Failure> {
    let Some(path) = out.filter(|p| p.as_os_str() != "-") else {
        let mut stdout = std::io::stdout().lock();
        let done = stdout.write_all(text).and_then(|()| stdout.flush());
        // A closed pipe (for example `head`) is not a failure.
        return match done {
            Err(e) if e.kind() != ErrorKind::BrokenPipe => {
                Err(Failure(1, format!("standard output: {e}")))
            }
            _ => Ok(()),
        };
    };
    let name = path.display();
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    let written = std::fs::write(&part, text).and_then(|()| std::fs::rename(&part, path));
    written.map_err(|e| {
        let _ = std::fs::remove_file(&part);
        let text = format!("{name}: cannot be written ({e}); choose another place with --out");
        Failure(1, text)
    })
}

/// Says what was chosen and how good it is.
fn notes(args: &Args, job: &Job, design: &Design) {
    let (skipped, repeated) = (job.skipped(), job.repeated);
    if skipped > 0 {
        say!("{skipped} rows with bad cells were left out");
    }
    if repeated > 0 {
        say!("{repeated} rows repeat the coordinates of an earlier one and were set aside");
    }
    let (count, all) = (design.indices.len(), job.columns.rows.len());
    let chosen = format!("{count} of {all} candidates");
    let meaning = CRITERIA.iter().find(|c| c.name == args.criterion);
    let meaning = meaning.map_or("", |c| c.meaning);
    let (value, bound, share) = (design.value, design.bound, 100.0 * design.efficiency);
    let (of_d, of_i, distance) = (args.share, 1.0 - args.share, args.distance());
    let kind = ["subsets", "poses that may repeat"][usize::from(args.replicates)];
    let line = match args.criterion.as_str() {
        "d" => format!(
            "{chosen}: {share:.2} % of what is possible ({meaning}; log det(M/n)/k = {value:.6}, certified bound {bound:.6} for {kind})"
        ),
        "di" => format!(
            "{chosen}: at least {share:.2} % of what is possible (D- and I-efficiency in the shares {of_d} and {of_i})"
        ),
        "maximin" => format!(
            "{chosen}: {meaning} {value:.5}, at least {share:.1} % of what is possible (upper bound {bound:.5}, {distance})"
        ),
        name => format!(
            "{chosen}: {}{share:.2} % of what is possible ({meaning} {value:.6} noise variances, certified lower bound {bound:.6})",
            if name == "g" { "at least " } else { "" }
        ),
    };
    say!("{line}");
    if args.time_limit > 0.0 {
        say!("with a time limit another run may give another design; --iterations is reproducible");
    }
}

fn summary(args: &Args, job: &Job, design: &Design, rows: &[usize]) -> serde_json::Value {
    let maximin = args.is_maximin();
    let weights = ["weights at most 1/n", "free weights"][usize::from(args.replicates)];
    serde_json::json!({
        "schema": 1,
        "version": env!("CARGO_PKG_VERSION"),
        "criterion": args.criterion,
        "model": (!maximin).then_some(&args.model),
        "distance": maximin.then(|| args.distance()),
        "columns": job.columns.names,
        "candidates": job.columns.rows.len(),
        "skipped_rows": job.skipped(),
        "repeated_rows": job.repeated,
        "n": design.indices.len(),
        "rows": rows.iter().map(|row| row + 1).collect::<Vec<_>>(),
        "value": design.value,
        "bound": design.bound,
        "bound_kind": if maximin { "clique cover" } else { weights },
        "kiefer_wolfowitz_gap": design.gap,
        "efficiency": design.efficiency,
        "exchanges": design.exchanges,
        "status": design.status,
        "seed": args.seed,
        "reproducible": args.time_limit == 0.0 && design.status != Status::Interrupted,
    })
}
