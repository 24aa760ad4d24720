//! Which rows of a table are meant: lists, regions, repeats.

use std::collections::HashSet;

use crate::DesignError;

/// Rows (from 0) of a list like `1,5-9`, which counts data rows from 1, of a table of `count` rows.
///
/// # Errors
/// A part that is no row, a row that occurs twice.
///
/// ```
/// assert_eq!(ecm_doe::row_list("1, 3-5", 5)?, [0, 2, 3, 4]);
/// # Ok::<(), ecm_doe::DesignError>(())
/// ```
pub fn row_list(text: &str, count: usize) -> Result<Vec<usize>, DesignError> {
    let number = |s: &str| s.trim().parse().ok().filter(|r| (1..=count).contains(r));
    let mut rows = Vec::new();
    for part in text.split(',').map(str::trim) {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        match (number(first), number(last)) {
            (Some(first), Some(last)) if first <= last => rows.extend(first - 1..last),
            _ => {
                return Err(DesignError::Input(format!(
                    "{part:?} is no row of the table; expected numbers from 1 to {count} or ranges like 5-9, separated by commas"
                )));
            }
        }
    }
    let mut seen = HashSet::new();
    match rows.iter().find(|row| !seen.insert(**row)) {
        None => Ok(rows),
        Some(row) => Err(DesignError::Input(format!(
            "row {} occurs twice; name it once",
            row + 1
        ))),
    }
}

type Holds = fn(&f64, &f64) -> bool;
const SIGNS: [(&str, Holds); 6] = [
    ("<", f64::lt),
    ("<=", f64::le),
    (">", f64::gt),
    (">=", f64::ge),
    ("=", f64::eq),
    ("==", f64::eq),
];

/// Rows (from 0) of `values`, row-major with a column for each of `names`, inside a region like
/// `x_m<0.09&y_m>0`.
///
/// # Errors
/// A part that is no condition, or names no column.
pub fn rows_inside<S: AsRef<str>>(
    text: &str,
    names: &[S],
    values: &[f64],
) -> Result<Vec<usize>, DesignError> {
    let mut conditions = Vec::new();
    for part in text.split('&').map(str::trim) {
        let (name, rest) = part.split_at(part.find(['<', '>', '=']).unwrap_or(0));
        let limit = rest.trim_start_matches(['<', '>', '=']);
        let sign = &rest[..rest.len() - limit.len()];
        let sign = SIGNS.iter().find(|(text, _)| *text == sign);
        let column = names.iter().position(|other| other.as_ref() == name.trim());
        let limit = limit.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        let (Some(column), Some((_, holds)), Some(limit)) = (column, sign, limit) else {
            let names: Vec<&str> = names.iter().map(AsRef::as_ref).collect();
            return Err(DesignError::Input(format!(
                "{part:?} is no condition; expected COLUMN<NUMBER (or <=, >, >=, =) joined by &, with a column of {}",
                names.join(", ")
            )));
        };
        conditions.push((column, holds, limit));
    }
    let inside = |row: &[f64]| {
        conditions
            .iter()
            .all(|(c, holds, limit)| holds(&row[*c], limit))
    };
    let rows = values.chunks_exact(names.len().max(1)).enumerate();
    Ok(rows
        .filter(|(_, row)| inside(row))
        .map(|(i, _)| i)
        .collect())
}

/// Rows with the coordinates of an earlier one that may be chosen, or of an included one; included and
/// excluded rows are none of them.
///
/// ```
/// let x = [0.0, 1.0, -0.0, 1.0, 1.0];
/// assert_eq!(ecm_doe::repeated_rows(&x, 1, &[4], &[3]), [1, 2]);
/// ```
pub fn repeated_rows(
    points: &[f64],
    columns: usize,
    include: &[usize],
    exclude: &[usize],
) -> Vec<usize> {
    // + 0.0 makes -0 and 0 the same pose.
    let key = |row: &[f64]| {
        row.iter()
            .map(|v| (v + 0.0).to_bits())
            .collect::<Vec<u64>>()
    };
    let rows: Vec<&[f64]> = points.chunks_exact(columns.max(1)).collect();
    let included = include.iter().filter_map(|&i| rows.get(i));
    let mut seen: HashSet<Vec<u64>> = included.map(|row| key(row)).collect();
    let listed: HashSet<&usize> = include.iter().chain(exclude).collect();
    let open = (0..rows.len()).filter(|i| !listed.contains(i));
    open.filter(|&i| !seen.insert(key(rows[i]))).collect()
}
