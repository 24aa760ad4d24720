//! The visits of a campaign: order, side of approach and dwell time of each pose.

use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use crate::args::Preset;
use crate::failure::Failure;
use crate::table::{POSE, Table};

/// Dwell times before a reading in a diagnosable campaign, s; their difference shows relaxation.
const DWELLS_S: [&str; 3] = ["2.0", "8.0", "30.0"];
const HOME_EVERY: usize = 10;
const UNLOAD_EVERY: usize = 40;

/// One row of the plan.
pub struct Visit {
    /// Row of the table; for a check, the candidate nearest to the rest pose.
    pub row: usize,
    /// `pose`, `home` or `unloaded`.
    pub kind: &'static str,
    /// Row from which the pose is approached; `None`: the initial pose.
    pub from: Option<usize>,
    /// Dwell time, s; empty: the choice of the rig.
    pub dwell_s: &'static str,
    /// Action of the rig.
    pub action: &'static str,
}

impl Visit {
    fn new(row: usize, dwell_s: &'static str) -> Self {
        Self {
            row,
            kind: "pose",
            from: None,
            dwell_s,
            action: "measure",
        }
    }
}

/// `rows` in visiting order.
pub fn visits(
    table: &Table,
    rows: &[usize],
    preset: Option<Preset>,
    rng: &mut ChaCha8Rng,
) -> Result<Vec<Visit>, Failure> {
    let dwell = match preset {
        None => "",
        Some(Preset::Paper) => DWELLS_S[0],
        Some(Preset::Diagnosable) => return diagnosable(table, rows, rng),
    };
    let mut order = rows.to_vec();
    order.shuffle(rng);
    Ok(order
        .into_iter()
        .map(|row| Visit::new(row, dwell))
        .collect())
}

/// Each pose from the initial pose and from a pose beyond it, so that the side of approach differs.
/// Dwell times are independent of both. A home check after every tenth visit; the sensor is unloaded
/// at the beginning, at the end and after every fortieth visit.
fn diagnosable(table: &Table, rows: &[usize], rng: &mut ChaCha8Rng) -> Result<Vec<Visit>, Failure> {
    let poses = poses(table)?;
    let rest = rest_pose(&poses);
    let outer = outer_poses(&poses, rows, &rest);
    let (m, n) = (rows.len(), 2 * rows.len());
    let mut legs: Vec<(usize, Option<usize>)> = rows.iter().map(|&row| (row, None)).collect();
    let mut order: Vec<usize> = (0..m).collect();
    order.shuffle(rng);
    let sides = order
        .iter()
        .filter_map(|&i| Some((rows[i], Some(outer[i]?))));
    legs.extend(sides.take(3 * m / 4));
    order.shuffle(rng);
    let repeats = order.iter().cycle().take(n - legs.len());
    legs.extend(repeats.map(|&i| (rows[i], None)).collect::<Vec<_>>());
    legs.shuffle(rng);
    let mut dwells: Vec<&str> = DWELLS_S.iter().copied().cycle().take(n).collect();
    dwells.shuffle(rng);
    let nearest = nearest_to_rest(&poses, &rest);
    let check = |kind, action| Visit {
        kind,
        action,
        ..Visit::new(nearest, DWELLS_S[0])
    };
    let mut visits = vec![check("unloaded", "unload")];
    for (i, ((row, from), dwell_s)) in legs.into_iter().zip(dwells).enumerate() {
        if i > 0 && i % UNLOAD_EVERY == 0 {
            visits.push(check("unloaded", "unload"));
        }
        if i % HOME_EVERY == 0 {
            visits.push(check("home", "home"));
        }
        visits.push(Visit {
            from,
            ..Visit::new(row, dwell_s)
        });
    }
    visits.push(check("home", "home"));
    visits.push(check("unloaded", "unload"));
    Ok(visits)
}

/// All candidates' poses.
fn poses(table: &Table) -> Result<Vec<[f64; 6]>, Failure> {
    let wanted: Vec<String> = POSE.iter().map(|&name| name.to_owned()).collect();
    let missing = POSE.iter().any(|p| !table.header.iter().any(|h| h == p));
    if missing {
        return Err(Failure::Input(format!(
            "{}: --preset diagnosable needs the six pose columns {}; leave it out for other coordinates",
            table.name,
            POSE.join(", ")
        )));
    }
    let at = table.coordinates(&wanted)?;
    let columns = table.numbers(at, true, &|| false)?;
    let mut all = vec![[f64::NAN; 6]; table.len()];
    for (values, &row) in columns.values.chunks_exact(6).zip(&columns.rows) {
        all[row] = std::array::from_fn(|c| values[c]);
    }
    Ok(all)
}

/// Median x of the candidates, as the rest position where the length is not known.
pub fn median_rest_x_m(table: &Table) -> Result<f64, Failure> {
    poses(table).map(|poses| rest_pose(&poses)[0])
}

/// Rest pose, estimated from the candidates.
fn rest_pose(poses: &[[f64; 6]]) -> [f64; 6] {
    let mut x: Vec<f64> = poses
        .iter()
        .map(|p| p[0])
        .filter(|v| v.is_finite())
        .collect();
    x.sort_by(f64::total_cmp);
    let middle = x.len() / 2;
    let median = match x.len() {
        0 => 0.0,
        count if count % 2 == 1 => x[middle],
        _ => 0.5 * (x[middle - 1] + x[middle]),
    };
    [median, 0.0, 0.0, 0.0, 0.0, 0.0]
}

/// For each pose the nearest chosen one from which it is approached from outside.
///
/// The side of approach is a = sign((p - p_from) M (p - p0)), M = diag(1, 1, 1, L^2, L^2, L^2);
/// the rest pose gives +1, so a pose with a clearly negative product gives the other side.
fn outer_poses(poses: &[[f64; 6]], rows: &[usize], rest: &[f64; 6]) -> Vec<Option<usize>> {
    let scaled: Vec<[f64; 6]> = rows
        .iter()
        .map(|&row| {
            std::array::from_fn(|c| {
                let unit = if c < 3 { 1.0 } else { rest[0] };
                unit * (poses[row][c] - rest[c])
            })
        })
        .collect();
    let product = |a: &[f64; 6], b: &[f64; 6]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    scaled
        .iter()
        .map(|own| {
            let length = product(own, own);
            let outside = scaled.iter().enumerate().filter_map(|(j, other)| {
                let cross = product(own, other);
                let distance = length + product(other, other) - 2.0 * cross;
                (length - cross <= -0.1 * length).then_some((distance, j))
            });
            outside
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .map(|(_, j)| rows[j])
        })
        .collect()
}

/// The candidate nearest to the rest pose, each coordinate over its range.
fn nearest_to_rest(poses: &[[f64; 6]], rest: &[f64; 6]) -> usize {
    let width: [f64; 6] = std::array::from_fn(|c| {
        let values = poses.iter().map(|p| p[c]).filter(|v| v.is_finite());
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(v), h.max(v))
        });
        if high > low { high - low } else { 1.0 }
    });
    let away =
        |p: &[f64; 6]| -> f64 { (0..6).map(|c| ((p[c] - rest[c]) / width[c]).powi(2)).sum() };
    let known = (0..poses.len()).filter(|&i| poses[i].iter().all(|v| v.is_finite()));
    known
        .min_by(|&a, &b| away(&poses[a]).total_cmp(&away(&poses[b])))
        .unwrap_or(0)
}
