//! The plan: the chosen rows, with the text of the candidates, in visiting order.

use ecm_poly::model_file::map::{POSE, WRENCH};
use rand::SeedableRng;
use rand::seq::SliceRandom;

use crate::visits::{DWELLS_S, Kind, Visit, diagnosable_visits, nearest_to_rest, rest_x_m};
use crate::{DesignError, Table};

/// Columns that a plan adds to a table of poses.
const ADDED: [&str; 5] = ["kind", "approach", "dwell_s", "run", "action"];

/// How the poses of a plan are visited.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Protocol {
    /// Each once, from the initial pose; the rig chooses the rest.
    Plain,
    /// Each once, from the initial pose, after a rest of two seconds (the paper's).
    Paper,
    /// As [`diagnosable_visits`] says, twice as many visits as poses.
    Diagnosable,
}

/// The plan of the rows (from 0) of `table`, as CSV.
///
/// A table of poses is visited in an order drawn with `seed`, so that drift over time does not become a
/// trend over the workspace, and gets the columns of a plan; any other keeps its order. Checks are at the
/// rest pose, `length_m` along the axis; without a length at the median of the candidates.
///
/// # Errors
/// A protocol for a table without pose columns, bad cells in the poses.
pub fn plan(
    table: &Table,
    rows: &[usize],
    protocol: Protocol,
    length_m: Option<f64>,
    seed: u64,
) -> Result<Vec<u8>, DesignError> {
    let mut text = Vec::new();
    let writer = csv::Writer::from_writer(&mut text);
    let poses = table.header.iter().any(|h| POSE.contains(&h.as_str()));
    let written = if poses {
        let (visits, rest_x_m) = visits(table, rows, protocol, seed)?;
        write_plan(writer, table, &visits, length_m.unwrap_or(rest_x_m))
    } else if protocol == Protocol::Plain {
        write_rows(writer, table, rows)
    } else {
        return no_poses(table, "");
    };
    written.map_err(|e| DesignError::Input(format!("the plan cannot be written: {e}")))?;
    Ok(text)
}

fn no_poses<T>(table: &Table, which: &str) -> Result<T, DesignError> {
    let (file, names) = (&table.name, POSE.join(", "));
    Err(DesignError::Input(format!(
        "{file}: --preset{which} needs pose columns ({names}); leave it out for other coordinates"
    )))
}

/// The visits, with rows of the table as places, and the rest position of the platform.
fn visits(
    table: &Table,
    rows: &[usize],
    protocol: Protocol,
    seed: u64,
) -> Result<(Vec<Visit>, f64), DesignError> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut order = |count: usize| {
        let mut order: Vec<usize> = (0..count).collect();
        order.shuffle(&mut rng);
        order
    };
    let (m, kind, from) = (rows.len(), Kind::Pose, None);
    if protocol != Protocol::Diagnosable {
        let dwell_s = (protocol == Protocol::Paper).then_some(DWELLS_S[0]);
        let of = |i: usize| Visit {
            kind,
            pose: rows[i],
            from,
            dwell_s,
        };
        return Ok((order(m).into_iter().map(of).collect(), 0.0));
    }
    let at: Vec<usize> = POSE.iter().filter_map(|p| table.find(p)).collect();
    if at.len() < 6 {
        return no_poses(table, " diagnosable");
    }
    let columns = table.numbers(at, true)?;
    let (poses, _) = columns.values.as_chunks::<6>();
    let place = |row: &usize| columns.rows.binary_search(row).ok();
    let chosen: Vec<[f64; 6]> = rows.iter().filter_map(place).map(|p| poses[p]).collect();
    let orders = [m, m, 2 * m, 2 * m].map(&mut order);
    let mut visits = diagnosable_visits(&chosen, &DWELLS_S, orders.each_ref().map(|o| &o[..]))?;
    let x_m = rest_x_m(poses);
    let nearest = nearest_to_rest(poses, x_m).map_or(0, |p| columns.rows[p]);
    for visit in &mut visits {
        visit.pose = if visit.kind == kind {
            rows[visit.pose]
        } else {
            nearest
        };
        visit.from = visit.from.map(|i| rows[i]);
    }
    Ok((visits, x_m))
}

type Writer<'a> = csv::Writer<&'a mut Vec<u8>>;

fn write_rows(mut writer: Writer<'_>, table: &Table, rows: &[usize]) -> Result<(), csv::Error> {
    writer.write_record(&table.header)?;
    for &row in rows {
        writer.write_record(&table.cells(row))?;
    }
    Ok(writer.flush()?)
}

fn write_plan(
    mut writer: Writer<'_>,
    table: &Table,
    visits: &[Visit],
    rest_x_m: f64,
) -> Result<(), csv::Error> {
    let own_id = table.find("pose_id");
    // Results and visits of an earlier campaign do not belong to the plan.
    let copied = |c: &usize| {
        let name = table.header[*c].as_str();
        let measured = WRENCH.contains(&name.strip_prefix("sd_").unwrap_or(name));
        !(measured || ["time_s", "repeat"].contains(&name) || ADDED.contains(&name))
    };
    let copied: Vec<usize> = (0..table.header.len()).filter(copied).collect();
    let id = |row: usize| match own_id {
        Some(c) => String::from_utf8_lossy(&table.cells(row)[c]).into_owned(),
        None => row.to_string(),
    };
    let new_id = own_id.is_none().then_some("pose_id");
    let names = copied.iter().map(|&c| table.header[c].as_str());
    writer.write_record(names.chain(new_id).chain(ADDED))?;
    for visit in visits {
        let cells = table.cells(visit.pose);
        let check = visit.kind != Kind::Pose;
        for &c in &copied {
            match POSE.iter().position(|p| *p == table.header[c]) {
                Some(0) if check => writer.write_field(rest_x_m.to_string())?,
                Some(_) if check => writer.write_field("0")?,
                None if check && Some(c) == own_id => writer.write_field("-1")?,
                _ => writer.write_field(&cells[c])?,
            }
        }
        if new_id.is_some() {
            writer.write_field(if check { "-1".into() } else { id(visit.pose) })?;
        }
        let (kind, action) = visit.kind.words();
        let approach = match visit.from {
            _ if check => String::new(),
            from => from.map_or("initial".into(), id),
        };
        let dwell_s = visit.dwell_s.map_or(String::new(), |s| format!("{s:?}"));
        writer.write_record([kind, &approach, &dwell_s, "0", action])?;
    }
    Ok(writer.flush()?)
}
