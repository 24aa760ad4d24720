//! Row lists like `1,5-9` and regions like `x_m<0.09&y_m>0`.

use crate::failure::Failure;
use crate::table::{Columns, Table};

/// Rows (from 0) of a list that counts data rows from 1.
pub fn list(option: &str, text: &str, count: usize) -> Result<Vec<usize>, Failure> {
    let bad = |part: &str| {
        Failure::Input(format!(
            "{option}: {part:?} is no row of the table, expected numbers from 1 to {count} or ranges like 5-9, separated by commas"
        ))
    };
    let mut rows = Vec::new();
    for part in text.split(',').map(str::trim) {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let number = |s: &str| {
            s.trim()
                .parse::<usize>()
                .ok()
                .filter(|r| (1..=count).contains(r))
        };
        let (Some(first), Some(last)) = (number(first), number(last)) else {
            return Err(bad(part));
        };
        if first > last {
            return Err(bad(part));
        }
        rows.extend(first - 1..last);
    }
    Ok(rows)
}

/// Rows (from 0) that a list names or that lie in a region.
pub fn list_or_region(
    option: &str,
    text: &str,
    table: &Table,
    columns: &Columns,
) -> Result<Vec<usize>, Failure> {
    if !text.contains(['<', '>', '=']) {
        return list(option, text, table.len());
    }
    let width = columns.at.len();
    let mut conditions = Vec::new();
    for part in text.split('&').map(str::trim) {
        let at = part.find(['<', '>', '=']).unwrap_or(0);
        let (name, rest) = part.split_at(at);
        let sign_len = rest.len() - rest.trim_start_matches(['<', '>', '=']).len();
        let (sign, limit) = rest.split_at(sign_len);
        let position = columns
            .at
            .iter()
            .position(|&c| table.header[c] == name.trim());
        let limit = limit.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        let (Some(position), Some(limit), "<" | "<=" | ">" | ">=" | "=" | "==") =
            (position, limit, sign)
        else {
            let names: Vec<&str> = columns
                .at
                .iter()
                .map(|&c| table.header[c].as_str())
                .collect();
            return Err(Failure::Input(format!(
                "{option}: {part:?} is no condition, expected COLUMN<NUMBER (or <=, >, >=, =) joined by &, with a column of {}",
                names.join(", ")
            )));
        };
        conditions.push((position, sign.to_owned(), limit));
    }
    let inside_region = |row: &[f64]| {
        conditions
            .iter()
            .all(|(c, sign, limit)| match sign.as_str() {
                "<" => row[*c] < *limit,
                "<=" => row[*c] <= *limit,
                ">" => row[*c] > *limit,
                ">=" => row[*c] >= *limit,
                _ => row[*c] == *limit,
            })
    };
    let inside = columns.values.chunks_exact(width).zip(&columns.rows);
    Ok(inside
        .filter(|(values, _)| inside_region(values))
        .map(|(_, row)| *row)
        .collect())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn lists_count_from_one() {
        assert_eq!(list("--include", "1, 3-5", 5).unwrap(), [0, 2, 3, 4]);
        for text in ["0", "6", "5-4", "a", "", "1,,2", "-3"] {
            let failure = list("--include", text, 5).unwrap_err();
            assert!(failure.message().contains("from 1 to 5"), "{text}");
        }
    }
}
