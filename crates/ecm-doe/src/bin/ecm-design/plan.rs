//! The plan: the chosen rows, with the text of the candidates, in visiting order.

use std::io::Write;
use std::path::Path;

use rand::SeedableRng;

use crate::args::Preset;
use crate::failure::Failure;
use crate::protocol::{Visit, median_rest_x_m, visits};
use crate::table::{POSE, Table, WRENCH};

/// Columns that a plan adds to a table of poses.
const ADDED: [&str; 5] = ["kind", "approach", "dwell_s", "run", "action"];

/// Settings of a plan.
pub struct Protocol {
    /// Seed of the visiting order.
    pub seed: u64,
    /// Kind of visits; `None`: each pose once.
    pub preset: Option<Preset>,
    /// Rest position x of the platform for the checks of a preset; `None`: median of the candidates.
    pub length_m: Option<f64>,
}

/// Writes the rows (from 0) of `table` to `out`, or to standard output.
///
/// A table of poses is visited in an order drawn with `seed`, so that drift over time does not
/// become a trend over the workspace, and gets the columns of a plan; any other keeps its order.
pub fn write(
    table: &Table,
    rows: &[usize],
    protocol: &Protocol,
    out: Option<&Path>,
) -> Result<(), Failure> {
    let poses = table.header.iter().any(|h| POSE.contains(&h.as_str()));
    let unwritten = |e: csv::Error| Failure::System(format!("the plan cannot be written: {e}"));
    if !poses {
        if protocol.preset.is_some() {
            return Err(Failure::Input(format!(
                "{}: --preset needs pose columns ({}); leave it out for other coordinates",
                table.name,
                POSE.join(", ")
            )));
        }
        return save(&render_rows(table, rows).map_err(unwritten)?, out);
    }
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(protocol.seed);
    let visits = visits(table, rows, protocol.preset, &mut rng)?;
    let checks = visits.iter().any(|v| v.kind != "pose");
    let rest_x_m = match protocol.length_m {
        Some(length) => length,
        None if checks => median_rest_x_m(table)?,
        None => 0.0,
    };
    save(&render(table, &visits, rest_x_m).map_err(unwritten)?, out)
}

fn render_rows(table: &Table, rows: &[usize]) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(&table.header)?;
    for &row in rows {
        writer.write_record(&table.cells(row))?;
    }
    finish(writer)
}

fn render(table: &Table, visits: &[Visit], rest_x_m: f64) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let own_id = table.header.iter().position(|h| h == "pose_id");
    // Results and visits of an earlier campaign do not belong to the plan.
    let replaced = |name: &str| {
        WRENCH.contains(&name.strip_prefix("sd_").unwrap_or(name))
            || ["time_s", "repeat", "pose_id"].contains(&name)
            || ADDED.contains(&name)
    };
    let copied: Vec<usize> = (0..table.header.len())
        .filter(|&c| !replaced(&table.header[c]) || Some(c) == own_id)
        .collect();
    let id = |row: usize| match own_id {
        Some(c) => {
            String::from_utf8_lossy(table.cells(row).get(c).unwrap_or_default()).into_owned()
        }
        None => row.to_string(),
    };
    let mut header: Vec<&str> = copied.iter().map(|&c| table.header[c].as_str()).collect();
    if own_id.is_none() {
        header.push("pose_id");
    }
    header.extend(ADDED);
    writer.write_record(&header)?;
    let rest = |name: &str| match POSE.iter().position(|p| *p == name)? {
        0 => Some(rest_x_m.to_string()),
        _ => Some("0".to_owned()),
    };
    for visit in visits {
        let cells = table.cells(visit.row);
        let check = visit.kind != "pose";
        for &c in &copied {
            match rest(&table.header[c]).filter(|_| check) {
                Some(value) => writer.write_field(value)?,
                None if check && Some(c) == own_id => writer.write_field("-1")?,
                None => writer.write_field(cells.get(c).unwrap_or_default())?,
            }
        }
        if own_id.is_none() {
            writer.write_field(if check {
                "-1".to_owned()
            } else {
                id(visit.row)
            })?;
        }
        let approach = match visit.from {
            _ if check => String::new(),
            None => "initial".to_owned(),
            Some(row) => id(row),
        };
        let added = [visit.kind, &approach, visit.dwell_s, "0", visit.action];
        for value in added {
            writer.write_field(value)?;
        }
        writer.write_record(None::<&[u8]>)?;
    }
    finish(writer)
}

fn finish(writer: csv::Writer<Vec<u8>>) -> Result<Vec<u8>, csv::Error> {
    writer
        .into_inner()
        .map_err(|e| csv::Error::from(std::io::Error::other(e.to_string())))
}

/// Writes a file atomically through a temporary file, or standard output.
pub fn save(text: &[u8], out: Option<&Path>) -> Result<(), Failure> {
    let Some(path) = out.filter(|p| p.as_os_str() != "-") else {
        let mut stdout = std::io::stdout().lock();
        let done = stdout.write_all(text).and_then(|()| stdout.flush());
        // A closed pipe (for example `head`) is not a failure.
        return match done {
            Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
                Err(Failure::System(format!("standard output: {e}")))
            }
            _ => Ok(()),
        };
    };
    let mut name = path.as_os_str().to_owned();
    name.push(".part");
    let part = std::path::PathBuf::from(name);
    let write = || {
        let mut file = std::fs::File::create(&part)?;
        file.write_all(text)?;
        file.sync_all()?;
        std::fs::rename(&part, path)
    };
    write().map_err(|e| {
        let _ = std::fs::remove_file(&part);
        Failure::System(format!(
            "{}: cannot be written ({e}); choose another place with --out",
            path.display()
        ))
    })
}
