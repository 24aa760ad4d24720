//! `ecm-design`: chooses informative poses from a CSV table of candidates.

mod args;
mod failure;
mod job;
mod plan;
mod progress;
mod protocol;
mod rows;
mod table;

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{CommandFactory, Parser};
use ecm_doe::{CRITERIA, Control, Design, Status};

use crate::args::{Args, MAXIMIN};
use crate::failure::Failure;
use crate::job::Job;

fn main() -> ExitCode {
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(error) => {
            let _ = error.print();
            return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2));
        }
    };
    match run(&args) {
        Ok(code) => ExitCode::from(code),
        Err(failure) => {
            let _ = writeln!(std::io::stderr(), "{}", failure.message());
            ExitCode::from(failure.code())
        }
    }
}

fn run(args: &Args) -> Result<u8, Failure> {
    if args.man {
        let mut page = Vec::new();
        let done = clap_mangen::Man::new(Args::command()).render(&mut page);
        done.map_err(|e| Failure::System(e.to_string()))?;
        return plan::save(&page, None).map(|()| 0);
    }
    if let Some(shell) = args.completions {
        let mut script = Vec::new();
        clap_complete::generate(shell, &mut Args::command(), "ecm-design", &mut script);
        return plan::save(&script, None).map(|()| 0);
    }
    let path = args.candidates.as_deref().unwrap_or(Path::new("-"));
    if !(args.time_limit >= 0.0 && args.time_limit.is_finite()) {
        let found = args.time_limit;
        return Err(Failure::Input(format!(
            "--time-limit: {found}, expected seconds, 0 for none"
        )));
    }
    if args.effects.is_some() {
        return Err(Failure::Input(
            "--effects: which effects a plan tells apart depends on the stiffness and the rig, which this binary does not know; use `ecm design --preset diagnosable --effects IDS`".into(),
        ));
    }
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed))
        .map_err(|e| Failure::System(format!("Ctrl-C cannot be caught: {e}")))?;
    let job = Job::read(args, path, &|| stop.load(Ordering::Relaxed))?;
    let bar = progress::Bar::new(args);
    let report = |done: usize, total: usize, best: f64| bar.show(done, total, best);
    let control = Control::new()
        .with_cancel(&stop)
        .with_time_limit(args.time_limit)
        .with_progress(&report);
    let design = job.run(args, path, &control);
    bar.clear();
    let design = design?;
    plan::write(
        &job.table,
        &job.rows(&design),
        &plan::Protocol {
            seed: args.seed,
            preset: args.preset,
            length_m: args.length.or_else(|| job::length_beside(path).ok()),
        },
        args.out.as_deref(),
    )?;
    if let Some(file) = &args.json {
        let mut text = serde_json::to_vec_pretty(&summary(args, &job, &design))
            .map_err(|e| Failure::System(e.to_string()))?;
        text.push(b'\n');
        plan::save(&text, Some(file))?;
    }
    let mut words = Vec::new();
    if design.status == Status::Interrupted {
        words.push(format!(
            "interrupted: kept the best of {} exchanges",
            design.exchanges
        ));
    }
    if !args.quiet {
        words.extend(notes(args, &job, &design));
    }
    for line in words {
        let _ = writeln!(std::io::stderr(), "{line}");
    }
    Ok(if design.status == Status::Interrupted {
        130
    } else {
        0
    })
}

/// Summary of the design for the user.
fn notes(args: &Args, job: &Job, design: &Design) -> Vec<String> {
    let mut lines = Vec::new();
    if job.skipped() > 0 {
        lines.push(format!(
            "{} rows with bad cells were left out",
            job.skipped()
        ));
    }
    if job.repeated > 0 {
        lines.push(format!(
            "{} rows repeat the coordinates of an earlier one and were set aside",
            job.repeated
        ));
    }
    let share = 100.0 * design.efficiency;
    let chosen = format!(
        "{} of {} candidates",
        design.indices.len(),
        job.candidates()
    );
    let meaning = CRITERIA.iter().find(|c| c.name == args.criterion);
    let meaning = meaning.map_or("", |c| c.meaning);
    let (value, bound) = (design.value, design.bound);
    lines.push(match args.criterion.as_str() {
        "d" => format!(
            "{chosen}: {share:.2} % of what is possible ({meaning}; log det(M/n)/k = {value:.6}, certified bound {bound:.6} for {})",
            if args.replicates { "poses that may repeat" } else { "subsets" }
        ),
        "di" => format!(
            "{chosen}: at least {share:.2} % of what is possible (D- and I-efficiency in the shares {} and {})",
            args.share, 1.0 - args.share
        ),
        MAXIMIN => format!(
            "{chosen}: {meaning} {value:.5}, at least {share:.1} % of what is possible (upper bound {bound:.5}, {})",
            distance_in_words(args)
        ),
        name => format!(
            "{chosen}: {}{share:.2} % of what is possible ({meaning} {value:.6} noise variances, certified lower bound {bound:.6})",
            if ["i", "a"].contains(&name) { "" } else { "at least " }
        ),
    });
    if args.time_limit > 0.0 {
        lines.push(
            "with a time limit another run may give another design; --iterations is reproducible"
                .into(),
        );
    }
    lines
}

fn summary(args: &Args, job: &Job, design: &Design) -> serde_json::Value {
    let rows: Vec<usize> = job.rows(design).iter().map(|r| r + 1).collect();
    serde_json::json!({
        "schema": 1,
        "version": env!("CARGO_PKG_VERSION"),
        "criterion": args.criterion,
        "model": (args.criterion != MAXIMIN).then_some(&args.model),
        "distance": (args.criterion == MAXIMIN).then(|| distance_in_words(args)),
        "columns": job.coordinates(),
        "candidates": job.candidates(),
        "skipped_rows": job.skipped(),
        "repeated_rows": job.repeated,
        "n": design.indices.len(),
        "rows": rows,
        "value": design.value,
        "bound": design.bound,
        "bound_kind": match (args.criterion.as_str(), args.replicates) {
            (MAXIMIN, _) => "clique cover",
            (_, true) => "free weights",
            (_, false) => "weights at most 1/n",
        },
        "kiefer_wolfowitz_gap": design.gap,
        "efficiency": design.efficiency,
        "exchanges": design.exchanges,
        "status": design.status,
        "seed": args.seed,
        "reproducible": args.time_limit == 0.0 && design.status != Status::Interrupted,
    })
}

/// Name of the distance between two poses.
fn distance_in_words(args: &Args) -> String {
    args.metres_per_radian.map_or_else(
        || "coordinates scaled to [-1, 1]".into(),
        |length| format!("a radian counts as {length} m"),
    )
}
