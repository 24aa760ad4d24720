//! The plan: the chosen rows as they stand in the candidates, in visiting order.

use std::io::Write;
use std::path::Path;

use rand::SeedableRng;
use rand::seq::SliceRandom;

use crate::failure::Failure;
use crate::table::{POSE, Table, WRENCH};

/// Columns that a plan adds to a table of poses, with the value of every row.
///
/// The paper's protocol: each pose is approached from the initial pose, in one run.
const ADDED: [(&str, &str); 5] = [
    ("kind", "pose"),
    ("approach", "initial"),
    ("dwell_s", ""),
    ("run", "0"),
    ("action", "measure"),
];

/// Writes the rows (from 0) of `table` to `out`, or to standard output.
///
/// A table of poses is visited in an order drawn with `seed`, so that a drift over time is no
/// trend over the workspace, and gets the columns of a plan; any other keeps its order.
pub fn write(table: &Table, rows: &[usize], seed: u64, out: Option<&Path>) -> Result<(), Failure> {
    let poses = table.header.iter().any(|h| POSE.contains(&h.as_str()));
    let mut order = rows.to_vec();
    if poses {
        order.shuffle(&mut rand_chacha::ChaCha8Rng::seed_from_u64(seed));
    }
    let text = render(table, &order, poses)
        .map_err(|e| Failure::System(format!("the plan cannot be written: {e}")))?;
    save(&text, out)
}

fn render(table: &Table, rows: &[usize], poses: bool) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let has = |name: &str| table.header.iter().any(|h| h == name);
    // What was measured and how the row was visited before says nothing about the plan.
    let replaced = |name: &str| {
        let measured = WRENCH.contains(&name.strip_prefix("sd_").unwrap_or(name))
            || ["time_s", "repeat"].contains(&name);
        poses && (measured || ADDED.iter().any(|(a, _)| *a == name))
    };
    let numbered = poses && !has("pose_id");
    let kept: Vec<usize> = (0..table.header.len())
        .filter(|&c| !replaced(&table.header[c]))
        .collect();
    let mut header: Vec<&str> = kept.iter().map(|&c| table.header[c].as_str()).collect();
    if numbered {
        header.push("pose_id");
    }
    if poses {
        header.extend(ADDED.iter().map(|(name, _)| *name));
    }
    writer.write_record(&header)?;
    for &row in rows {
        let cells = table.cells(row);
        for &c in &kept {
            writer.write_field(cells.get(c).unwrap_or_default())?;
        }
        if numbered {
            writer.write_field(row.to_string())?;
        }
        if poses {
            for (_, value) in ADDED {
                writer.write_field(value)?;
            }
        }
        writer.write_record(None::<&[u8]>)?;
    }
    writer
        .into_inner()
        .map_err(|e| csv::Error::from(std::io::Error::other(e.to_string())))
}

/// Writes a file by way of a temporary one, or standard output.
pub fn save(text: &[u8], out: Option<&Path>) -> Result<(), Failure> {
    let Some(path) = out.filter(|p| p.as_os_str() != "-") else {
        let mut stdout = std::io::stdout().lock();
        let done = stdout.write_all(text).and_then(|()| stdout.flush());
        // A reader that has seen enough (head) is no failure.
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
