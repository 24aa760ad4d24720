//! A CSV table of candidates: its text stays as it is written, and some columns are numbers.

use std::collections::HashSet;
use std::io::Read;
use std::path::Path;

use ecm_poly::model_file::map::{POSE, WRENCH};

use crate::DesignError;

/// Standard columns that are numbers but no coordinates.
const BOOKKEEPING: [&str; 5] = ["pose_id", "time_s", "run", "repeat", "dwell_s"];
/// Units other than those of the standard names.
const UNITS: [&str; 13] = [
    "mm", "cm", "um", "deg", "mrad", "kn", "mn", "nmm", "gf", "m", "rad", "n", "nm",
];

/// The text of a CSV file.
#[derive(Debug)]
pub struct Table {
    /// The file's name for messages.
    pub name: String,
    /// Column names.
    pub header: Vec<String>,
    text: Vec<u8>,
    /// Start and line of each data row in the text.
    rows: Vec<(usize, u64)>,
}

/// Numbers of some columns.
#[derive(Debug)]
pub struct Columns {
    /// Names of the columns.
    pub names: Vec<String>,
    /// Row-major numbers of the rows without a bad cell.
    pub values: Vec<f64>,
    /// The row of the table (from 0) of each.
    pub rows: Vec<usize>,
}

fn bad<T>(text: String) -> Result<T, DesignError> {
    Err(DesignError::Input(text))
}

fn reader(text: &[u8], flexible: bool) -> csv::Reader<&[u8]> {
    let mut builder = csv::ReaderBuilder::new();
    builder
        .has_headers(false)
        .flexible(flexible)
        .from_reader(text)
}

impl Table {
    /// Reads a file, or standard input for `-`.
    ///
    /// # Errors
    /// A file that cannot be read, no header, no row, names that occur twice, rows of unequal length.
    pub fn read(path: &Path) -> Result<Self, DesignError> {
        let (mut text, mut name) = (Vec::new(), path.display().to_string());
        let found = if name == "-" {
            name = "standard input".into();
            std::io::stdin().lock().read_to_end(&mut text)
        } else {
            std::fs::File::open(path).and_then(|mut file| file.read_to_end(&mut text))
        };
        found.or_else(|e| {
            bad(format!(
                "{name}: cannot be read ({e}), expected a CSV file; check the path"
            ))
        })?;
        if text.starts_with(b"\xef\xbb\xbf") {
            text.drain(..3);
        }
        let unread = |e: csv::Error| match e.kind() {
            csv::ErrorKind::UnequalLengths {
                pos: Some(at),
                expected_len,
                len,
            } => format!(
                "{name}: row {} (line {}) has {len} cells; expected {expected_len} cells as in the header; complete or remove the row",
                at.record(),
                at.line()
            ),
            _ => format!("{name}: {e}; expected comma-separated text in UTF-8"),
        };
        let mut records = reader(&text, false);
        let mut first = csv::StringRecord::new();
        if !records
            .read_record(&mut first)
            .or_else(|e| bad(unread(e)))?
        {
            return bad(format!(
                "{name}: the file is empty, expected a header row and data rows"
            ));
        }
        let header: Vec<String> = first.iter().map(|cell| cell.trim().to_owned()).collect();
        if let ([one], Some(symbol)) = (&header[..], first[0].chars().find(|c| ";\t".contains(*c)))
        {
            return bad(format!(
                "{name}: the columns of {one:?} are separated by {symbol:?}, expected ','; save the table with commas"
            ));
        }
        let mut seen = HashSet::new();
        if let Some(twice) = header.iter().find(|h| !seen.insert(h.as_str())) {
            return bad(format!(
                "{name}: column {twice:?} occurs twice, expected different names; rename one"
            ));
        }
        let mut rows = Vec::new();
        let mut record = csv::ByteRecord::new();
        while records
            .read_byte_record(&mut record)
            .or_else(|e| bad(unread(e)))?
        {
            rows.extend(record.position().map(|p| (p.byte() as usize, p.line())));
        }
        if rows.is_empty() {
            return bad(format!(
                "{name}: there is a header but no data row, expected at least one"
            ));
        }
        Ok(Self {
            name,
            header,
            text,
            rows,
        })
    }

    /// Number of data rows, at least one.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Cells of a data row with the text of the file.
    pub fn cells(&self, row: usize) -> csv::ByteRecord {
        let mut record = csv::ByteRecord::new();
        // The same bytes were read once before.
        let _ = reader(&self.text[self.rows[row].0..], true).read_byte_record(&mut record);
        record
    }

    /// Position of a column.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|h| h == name)
    }

    /// The coordinate columns: the requested ones, else the pose columns, else all numeric columns.
    ///
    /// # Errors
    /// A requested column that is missing, pose columns with another unit, no numeric column.
    pub fn coordinates(&self, wanted: &[String]) -> Result<Vec<usize>, DesignError> {
        let (file, all) = (&self.name, self.header.join(", "));
        let mut at = Vec::new();
        for name in wanted {
            match self.find(name.trim()) {
                None => {
                    return bad(format!(
                        "{file}: there is no column {name:?}; the columns are {all}"
                    ));
                }
                Some(c) if at.contains(&c) => {
                    return bad(format!("--columns names {name:?} twice; name it once"));
                }
                Some(c) => at.push(c),
            }
        }
        if !at.is_empty() {
            return Ok(at);
        }
        let mut likely = self
            .header
            .iter()
            .filter_map(|name| Some((name, likely_name(name)?)));
        if let Some((name, likely)) = likely.next() {
            return bad(format!(
                "{file}: a column is called {name:?}, expected {likely:?} with its unit in the name; rename it, or name the coordinates with --columns"
            ));
        }
        at.extend(POSE.iter().filter_map(|p| self.find(p)));
        if at.is_empty() {
            let first = self.cells(0);
            let numeric = |c: &usize| {
                let kept = BOOKKEEPING.contains(&self.header[*c].as_str());
                !kept && first.get(*c).and_then(number).is_some()
            };
            at.extend((0..self.header.len()).filter(numeric));
        }
        if at.is_empty() {
            return bad(format!(
                "{file}: no column holds numbers in row 1, expected pose columns or other coordinates; the columns are {all}"
            ));
        }
        Ok(at)
    }

    /// The numbers of the columns `at`; rows with bad cells are refused, or left out.
    ///
    /// # Errors
    /// Bad cells, no row without one, millimetres or degrees in a pose column.
    pub fn numbers(&self, at: Vec<usize>, skip_bad_rows: bool) -> Result<Columns, DesignError> {
        let (mut values, mut rows, mut wrong) = (Vec::new(), Vec::new(), Vec::new());
        let mut records = reader(&self.text[self.rows[0].0..], true);
        let mut record = csv::ByteRecord::new();
        for (row, (_, line)) in self.rows.iter().enumerate() {
            let _ = records.read_byte_record(&mut record);
            let before = wrong.len();
            for &c in &at {
                match record.get(c).and_then(number).filter(|v| v.is_finite()) {
                    Some(v) => values.push(v),
                    None => wrong.push((row, *line, c)),
                }
            }
            if wrong.len() == before {
                rows.push(row);
            } else {
                values.truncate(rows.len() * at.len());
            }
        }
        let file = &self.name;
        if !(wrong.is_empty() || skip_bad_rows && !rows.is_empty()) {
            let places = wrong.iter().take(10).map(|&(row, line, c)| {
                let (text, name) = (
                    String::from_utf8_lossy(&self.cells(row)[c]).into_owned(),
                    &self.header[c],
                );
                format!("row {} (line {line}), column {name}: {text:.40?}", row + 1)
            });
            let places = places.collect::<Vec<_>>().join("; ");
            let (cells, good) = (wrong.len(), rows.len());
            return bad(format!(
                "{file}: {places} ({cells} bad cells, {good} rows without one); expected finite numbers; correct these cells or give --skip-bad-rows"
            ));
        }
        let names: Vec<String> = at.iter().map(|&c| self.header[c].clone()).collect();
        for (j, name) in names.iter().enumerate() {
            let (limit, guess, unit) = match POSE.iter().position(|p| p == name) {
                None => continue,
                Some(0..3) => (5.0, "millimetres", "metres"),
                Some(_) => (std::f64::consts::TAU, "degrees", "radians"),
            };
            let mut column = values.iter().skip(j).step_by(at.len()).zip(&rows);
            if let Some((v, row)) = column.find(|(v, _)| f64::abs(**v) > limit) {
                let row = row + 1;
                return bad(format!(
                    "{file}: row {row}, column {name}: {v} looks like {guess}, expected {unit}; convert the column"
                ));
            }
        }
        Ok(Columns {
            names,
            values,
            rows,
        })
    }
}

/// A cell as a number.
fn number(cell: &[u8]) -> Option<f64> {
    std::str::from_utf8(cell).ok()?.trim().parse().ok()
}

/// The standard name that was probably meant by a pose or wrench name with another unit.
fn likely_name(name: &str) -> Option<&'static str> {
    let (lower, mut all) = (name.to_ascii_lowercase(), POSE.into_iter().chain(WRENCH));
    if all.clone().any(|standard| standard == name) {
        return None;
    }
    all.find(|standard| {
        let stem = standard
            .rsplit_once('_')
            .map_or("", |s| s.0)
            .to_ascii_lowercase();
        match lower.strip_prefix(&stem) {
            // Bare x, y, z are common names of other coordinates.
            Some("") => stem.len() > 1,
            Some(rest) => rest
                .strip_prefix('_')
                .is_some_and(|unit| UNITS.contains(&unit)),
            None => false,
        }
    })
}
