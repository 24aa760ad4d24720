//! Visits of a campaign that separates the effects of time: sides of approach, rests, checks.

use crate::DesignError;

/// Rests before a reading (s); relaxation shows in their difference.
pub const DWELLS_S: [f64; 3] = [2.0, 8.0, 30.0];
const HOME_EVERY: usize = 10;
const UNLOAD_EVERY: usize = 40;

/// What a visit is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// A reading at a pose.
    Pose,
    /// A reading at the rest pose.
    Home,
    /// A reading of the unloaded sensor.
    Unloaded,
}

impl Kind {
    /// The words of a plan's columns `kind` and `action`.
    pub fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Pose => ("pose", "measure"),
            Self::Home => ("home", "home"),
            Self::Unloaded => ("unloaded", "unload"),
        }
    }
}

/// One row of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Visit {
    /// What it is for.
    pub kind: Kind,
    /// Place of its pose; without meaning for a check.
    pub pose: usize,
    /// Place of the pose from which it is approached; `None`: the initial pose.
    pub from: Option<usize>,
    /// Rest before the reading (s); `None`: the rig chooses.
    pub dwell_s: Option<f64>,
}

impl Visit {
    fn check(kind: Kind) -> Self {
        let (pose, from, dwell_s) = (0, None, Some(DWELLS_S[0]));
        Self {
            kind,
            pose,
            from,
            dwell_s,
        }
    }
}

/// The visits of m poses (m, rad), as many as the two last orders have numbers.
///
/// Each pose is visited from the initial pose, three quarters of the other visits come from a pose beyond
/// theirs, so that the side of approach differs, and the rest repeat poses from the initial pose. Rests are
/// independent of pose and side. A home check stands before every tenth visit; the sensor is read unloaded at
/// the beginning, at the end, and before every fortieth visit.
///
/// # Arguments
/// - `orders`: permutations of the m poses for the sides, of them for the repeats, of the visits, and of
///   their rests
///
/// # Errors
/// Orders of other lengths, of numbers out of their range, and fewer visits than poses.
///
/// ```
/// let poses: Vec<[f64; 6]> = (1..5).map(|i| [0.1, 1e-3 * f64::from(i), 0.0, 0.0, 0.0, 0.0]).collect();
/// let (four, eight): (Vec<usize>, Vec<usize>) = ((0..4).collect(), (0..8).collect());
/// let plan = ecm_doe::diagnosable_visits(&poses, &ecm_doe::DWELLS_S, [&four, &four, &eight, &eight])?;
/// assert_eq!(plan.len(), 8 + 4);
/// assert_eq!((plan[6].pose, plan[6].from), (0, Some(1)));
/// # Ok::<(), ecm_doe::DesignError>(())
/// ```
pub fn diagnosable_visits(
    poses: &[[f64; 6]],
    dwells_s: &[f64],
    orders: [&[usize]; 4],
) -> Result<Vec<Visit>, DesignError> {
    let (m, n) = (poses.len(), orders[2].len());
    for (order, expected) in orders.into_iter().zip([m, m, n.max(m), n.max(m)]) {
        let found = order.iter().filter(|&&i| i < expected).count();
        if found != expected || order.len() != expected || m == 0 || dwells_s.is_empty() {
            return Err(DesignError::Shape {
                what: "an order of the visits",
                found: order.len(),
                expected,
            });
        }
    }
    let beyond = outer_poses(poses);
    let [sides, repeats, of_visits, of_dwells] = orders;
    let mut legs: Vec<(usize, Option<usize>)> = (0..m).map(|i| (i, None)).collect();
    let approached = sides.iter().filter(|&&i| beyond[i].is_some());
    legs.extend(approached.map(|&i| (i, beyond[i])).take(3 * (n - m) / 4));
    let more = n - legs.len();
    legs.extend(repeats.iter().cycle().take(more).map(|&i| (i, None)));
    let mut visits = vec![Visit::check(Kind::Unloaded)];
    for i in 0..n {
        if i > 0 && i % UNLOAD_EVERY == 0 {
            visits.push(Visit::check(Kind::Unloaded));
        }
        if i % HOME_EVERY == 0 {
            visits.push(Visit::check(Kind::Home));
        }
        let (pose, from) = legs[of_visits[i]];
        visits.push(Visit {
            kind: Kind::Pose,
            pose,
            from,
            dwell_s: Some(dwells_s[of_dwells[i] % dwells_s.len()]),
        });
    }
    visits.extend([Kind::Home, Kind::Unloaded].map(Visit::check));
    Ok(visits)
}

/// For each pose the nearest one from which it is approached from outside.
///
/// The side of approach is sign((p - p_from) M (p - p0)), M = diag(1, 1, 1, L², L², L²); the rest pose p0
/// gives +1, so a pose with a clearly negative product gives the other side.
pub fn outer_poses(poses: &[[f64; 6]]) -> Vec<Option<usize>> {
    let rest = [rest_x_m(poses), 0.0, 0.0, 0.0, 0.0, 0.0];
    let unit = |c: usize| if c < 3 { 1.0 } else { rest[0] };
    let away = |p: &[f64; 6]| core::array::from_fn(|c| unit(c) * (p[c] - rest[c]));
    let scaled: Vec<[f64; 6]> = poses.iter().map(away).collect();
    let product = |a: &[f64; 6], b: &[f64; 6]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let nearest = |own: &[f64; 6]| {
        let length = product(own, own);
        let outside = scaled.iter().enumerate().filter_map(|(j, other)| {
            let cross = product(own, other);
            let distance = length + product(other, other) - 2.0 * cross;
            (length - cross <= -0.1 * length).then_some((distance, j))
        });
        let first = outside.min_by(|a, b| a.0.total_cmp(&b.0));
        first.map(|(_, j)| j)
    };
    scaled.iter().map(nearest).collect()
}

/// Position of the platform at rest, on the axis: the median x of the poses, which scatter around it.
pub fn rest_x_m(poses: &[[f64; 6]]) -> f64 {
    let mut x: Vec<f64> = poses.iter().map(|p| p[0]).collect();
    x.sort_by(f64::total_cmp);
    match x.len() {
        0 => 0.0,
        count => 0.5 * (x[(count - 1) / 2] + x[count / 2]),
    }
}

/// Place of the pose nearest to the rest pose (x, 0, 0, 0, 0, 0), each coordinate over its range.
pub fn nearest_to_rest(poses: &[[f64; 6]], x_m: f64) -> Option<usize> {
    let (lower, upper) = crate::regressor::column_ranges(poses.as_flattened(), 6);
    let away = |p: &[f64; 6]| -> f64 {
        let rest = |c: usize| if c == 0 { x_m } else { 0.0 };
        let width = |c: usize| match upper[c] - lower[c] {
            width if width > 0.0 => width,
            _ => 1.0,
        };
        (0..6).map(|c| ((p[c] - rest(c)) / width(c)).powi(2)).sum()
    };
    (0..poses.len()).min_by(|&a, &b| away(&poses[a]).total_cmp(&away(&poses[b])))
}
