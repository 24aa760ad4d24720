//! A CSV table: its text is unchanged, and some columns are parsed as numbers.

use std::collections::HashSet;
use std::io::Read;
use std::path::Path;

pub use ecm_poly::model_file::map::{POSE, WRENCH};

use crate::failure::Failure;

/// Standard columns that are numbers but no coordinates.
const BOOKKEEPING: [&str; 5] = ["pose_id", "time_s", "run", "repeat", "dwell_s"];
/// Most places named in a message about bad cells.
const PLACES: usize = 10;

/// The text of a CSV file and the positions of its rows.
#[derive(Debug)]
pub struct Table {
    /// The file's name for messages.
    pub name: String,
    text: Vec<u8>,
    /// Column names.
    pub header: Vec<String>,
    /// Start byte, end byte and line of each data row.
    rows: Vec<(usize, usize, u64)>,
}

/// Numbers of some columns, and their rows.
#[derive(Debug)]
pub struct Columns {
    /// Positions of the columns.
    pub at: Vec<usize>,
    /// Row-major numbers.
    pub values: Vec<f64>,
    /// Row of the table (from 0) of each row of `values`.
    pub rows: Vec<usize>,
    /// Rows left out because of bad cells.
    pub skipped: usize,
}

impl Table {
    /// Reads a file, or standard input for `-`.
    pub fn read(path: &Path, interrupted: &dyn Fn() -> bool) -> Result<Self, Failure> {
        let mut text = Vec::new();
        let name = if path.as_os_str() == "-" {
            std::io::stdin()
                .lock()
                .read_to_end(&mut text)
                .map_err(|e| Failure::Input(format!("standard input: {e}")))?;
            "standard input".to_owned()
        } else {
            let name = path.display().to_string();
            let say = |e: std::io::Error| {
                Failure::Input(format!(
                    "{name}: cannot be read ({e}), expected a CSV file; check the path"
                ))
            };
            text = std::fs::read(path).map_err(say)?;
            name
        };
        Self::parse(name, text, interrupted)
    }

    /// Finds header and rows; refuses a table that is not rectangular.
    pub fn parse(
        name: String,
        text: Vec<u8>,
        interrupted: &dyn Fn() -> bool,
    ) -> Result<Self, Failure> {
        let bad = |what: String| Failure::Input(format!("{name}: {what}"));
        let body = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
        let offset = text.len() - body.len();
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .from_reader(body);
        let mut record = csv::ByteRecord::new();
        let mut next = |record: &mut csv::ByteRecord| {
            reader
                .read_byte_record(record)
                .map(|more| (more, reader.position().byte() as usize + offset))
                .map_err(|e| Failure::Input(format!("{name}: {e}; expected comma-separated text")))
        };
        if !next(&mut record)?.0 {
            return Err(bad(
                "the file is empty, expected a header row and data rows".into(),
            ));
        }
        let mut header = Vec::new();
        for (c, cell) in record.iter().enumerate() {
            let cell = std::str::from_utf8(cell).map_err(|_| {
                bad(format!(
                    "the name of column {} is not UTF-8; save the table as UTF-8",
                    c + 1
                ))
            })?;
            header.push(cell.trim().to_owned());
        }
        if let Some(symbol) = [';', '\t']
            .into_iter()
            .find(|s| header.len() == 1 && header[0].contains(*s))
        {
            return Err(bad(format!(
                "the columns are separated by {symbol:?}, expected ','; save the table with commas"
            )));
        }
        let mut seen = HashSet::new();
        if let Some(twice) = header.iter().find(|h| !seen.insert(h.as_str())) {
            return Err(bad(format!(
                "column {twice:?} occurs twice, expected different names; rename one"
            )));
        }
        let mut table = Self {
            name: name.clone(),
            text: Vec::new(),
            header,
            rows: Vec::new(),
        };
        let mut ragged = Places::default();
        loop {
            let (more, end) = next(&mut record)?;
            if !more {
                break;
            }
            let start = record.position().map_or(0, |p| p.byte() as usize) + offset;
            let line = record.position().map_or(0, csv::Position::line);
            if record.len() != table.header.len() {
                ragged.add(|| {
                    format!(
                        "row {} (line {line}) has {} cells",
                        table.rows.len() + 1,
                        record.len()
                    )
                });
            }
            table.rows.push((start, end, line));
            if table.rows.len().is_multiple_of(65_536) && interrupted() {
                return Err(Failure::Interrupted);
            }
        }
        if let Some(places) = ragged.message() {
            let expected = table.header.len();
            return Err(bad(format!(
                "{places}; expected {expected} cells as in the header; complete or remove these rows"
            )));
        }
        if table.rows.is_empty() {
            return Err(bad(
                "there is a header but no data row, expected at least one".into(),
            ));
        }
        table.text = text;
        Ok(table)
    }

    /// Number of data rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Cells of a data row with the text of the file.
    pub fn cells(&self, row: usize) -> csv::ByteRecord {
        let (start, end, _) = self.rows[row];
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .from_reader(&self.text[start..end]);
        let mut record = csv::ByteRecord::new();
        // The same bytes were read once before.
        let _ = reader.read_byte_record(&mut record);
        record
    }

    /// The coordinate columns: the requested ones, else the pose columns, else all numeric columns.
    pub fn coordinates(&self, wanted: &[String]) -> Result<Vec<usize>, Failure> {
        let find = |name: &str| self.header.iter().position(|h| h == name);
        if !wanted.is_empty() {
            let mut at = Vec::new();
            for name in wanted {
                let Some(c) = find(name.trim()) else {
                    return Err(Failure::Input(format!(
                        "{}: there is no column {name:?}; the columns are {}",
                        self.name,
                        self.header.join(", ")
                    )));
                };
                if at.contains(&c) {
                    return Err(Failure::Input(format!(
                        "--columns names {name:?} twice; name it once"
                    )));
                }
                at.push(c);
            }
            return Ok(at);
        }
        for (c, name) in self.header.iter().enumerate() {
            if let Some(likely) = likely_name(name) {
                return Err(Failure::Input(format!(
                    "{}: column {} is called {name:?}, expected {likely:?} with its unit in the name; rename it, or name the coordinates with --columns",
                    self.name,
                    c + 1
                )));
            }
        }
        let pose: Vec<usize> = POSE.iter().filter_map(|p| find(p)).collect();
        if !pose.is_empty() {
            return Ok(pose);
        }
        let first = self.cells(0);
        let numeric: Vec<usize> = (0..self.header.len())
            .filter(|&c| !BOOKKEEPING.contains(&self.header[c].as_str()))
            .filter(|&c| first.get(c).is_some_and(|cell| number(cell).is_some()))
            .collect();
        if numeric.is_empty() {
            return Err(Failure::Input(format!(
                "{}: no column holds numbers in row 1, expected pose columns or other coordinates; the columns are {}",
                self.name,
                self.header.join(", ")
            )));
        }
        Ok(numeric)
    }

    /// The numbers of the columns `at`; bad cells are refused, or their rows left out.
    pub fn numbers(
        &self,
        at: Vec<usize>,
        skip_bad_rows: bool,
        interrupted: &dyn Fn() -> bool,
    ) -> Result<Columns, Failure> {
        let start = self.rows.first().map_or(0, |r| r.0);
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .from_reader(&self.text[start..]);
        let mut record = csv::ByteRecord::new();
        let mut values = Vec::with_capacity(self.len() * at.len());
        let mut rows = Vec::with_capacity(self.len());
        let mut bad = Places::default();
        let mut skipped = 0;
        for row in 0..self.len() {
            let _ = reader.read_byte_record(&mut record);
            let mut good = true;
            let filled = values.len();
            for &c in &at {
                let cell = record.get(c).unwrap_or_default();
                match number(cell) {
                    Some(v) if v.is_finite() => values.push(v),
                    _ => {
                        good = false;
                        bad.add(|| {
                            let text: String =
                                String::from_utf8_lossy(cell).chars().take(40).collect();
                            let (line, name) = (self.rows[row].2, &self.header[c]);
                            format!("row {} (line {line}), column {name}: {text:?}", row + 1)
                        });
                    }
                }
            }
            if good {
                rows.push(row);
            } else {
                values.truncate(filled);
                skipped += 1;
            }
            if row.is_multiple_of(65_536) && interrupted() {
                return Err(Failure::Interrupted);
            }
        }
        if let Some(places) = bad.message().filter(|_| !skip_bad_rows) {
            return Err(Failure::Input(format!(
                "{}: {places}; expected finite numbers; correct these cells or give --skip-bad-rows",
                self.name
            )));
        }
        if rows.is_empty() {
            return Err(Failure::Input(format!(
                "{}: every row has a bad cell, nothing is left",
                self.name
            )));
        }
        let columns = Columns {
            at,
            values,
            rows,
            skipped,
        };
        self.check_units(&columns)?;
        Ok(columns)
    }

    /// Positions that look like millimetres and angles that look like degrees.
    fn check_units(&self, columns: &Columns) -> Result<(), Failure> {
        let width = columns.at.len();
        for (j, &c) in columns.at.iter().enumerate() {
            let name = self.header[c].as_str();
            let Some(kind) = POSE.iter().position(|p| *p == name) else {
                continue;
            };
            let (limit, guess) = if kind < 3 {
                (5.0, "millimetres")
            } else {
                (2.0 * std::f64::consts::PI, "degrees")
            };
            let found =
                (0..columns.rows.len()).find(|r| columns.values[r * width + j].abs() > limit);
            if let Some(r) = found {
                return Err(Failure::Input(format!(
                    "{}: row {}, column {name}: {} looks like {guess}, expected {}; convert the column",
                    self.name,
                    columns.rows[r] + 1,
                    columns.values[r * width + j],
                    if kind < 3 { "metres" } else { "radians" },
                )));
            }
        }
        Ok(())
    }
}

/// A cell as a number.
fn number(cell: &[u8]) -> Option<f64> {
    std::str::from_utf8(cell).ok()?.trim().parse().ok()
}

/// The standard name that was probably meant by a pose or wrench name with another unit.
fn likely_name(name: &str) -> Option<String> {
    if POSE.contains(&name) || WRENCH.contains(&name) {
        return None;
    }
    let lower = name.to_ascii_lowercase();
    let stem = |s: &str| {
        s.rsplit_once('_')
            .map_or(s.to_owned(), |(stem, _)| stem.to_owned())
    };
    for standard in POSE.iter().chain(&WRENCH) {
        let base = stem(standard).to_ascii_lowercase();
        let units = [
            "mm", "cm", "um", "deg", "mrad", "kn", "mn", "nmm", "gf", "m", "rad", "n", "nm",
        ];
        let with_unit = units.iter().any(|u| lower == format!("{base}_{u}"));
        // Bare x, y, z are common names of other coordinates.
        if with_unit || (lower == base && base.len() > 1) {
            return Some((*standard).to_owned());
        }
    }
    None
}

/// The first places of an error and their total number.
#[derive(Default)]
struct Places {
    first: Vec<String>,
    count: usize,
}

impl Places {
    fn add(&mut self, place: impl FnOnce() -> String) {
        self.count += 1;
        if self.first.len() < PLACES {
            self.first.push(place());
        }
    }

    fn message(&self) -> Option<String> {
        let more = match self.count {
            0 => return None,
            c if c > self.first.len() => format!(" … ({c} in all)"),
            _ => String::new(),
        };
        Some(self.first.join("; ") + &more)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &[u8]) -> Result<Table, Failure> {
        Table::parse("t.csv".into(), text.to_vec(), &|| false)
    }

    #[test]
    fn cells_are_kept_as_written() {
        let table =
            parse(b"\xef\xbb\xbfname,x_m\r\n\"a, \"\"b\"\"\",1.50e-1\r\n\r\nc,2\n").unwrap();
        assert_eq!(table.header, ["name", "x_m"]);
        assert_eq!(table.len(), 2);
        assert_eq!(table.cells(0).get(0).unwrap(), b"a, \"b\"");
        assert_eq!(table.cells(0).get(1).unwrap(), b"1.50e-1");
        assert_eq!(table.cells(1).get(0).unwrap(), b"c");
        let columns = table
            .numbers(table.coordinates(&[]).unwrap(), false, &|| false)
            .unwrap();
        assert_eq!(columns.values, [0.15, 2.0]);
    }

    #[test]
    fn names_with_other_units_are_recognised() {
        assert_eq!(likely_name("x_mm").as_deref(), Some("x_m"));
        assert_eq!(likely_name("theta_x").as_deref(), Some("theta_x_rad"));
        assert_eq!(likely_name("tau_z").as_deref(), Some("tau_z_Nm"));
        assert_eq!(likely_name("fx_kN").as_deref(), Some("fx_N"));
        assert_eq!(likely_name("x"), None);
        assert_eq!(likely_name("x_m"), None);
    }

    proptest! {
        /// Whatever the bytes, reading ends with a table or a message, and every row can be read.
        #[test]
        fn any_bytes_are_survived(text in prop::collection::vec(prop_oneof![
            Just(b','), Just(b'\n'), Just(b'\r'), Just(b'"'), Just(b'1'), Just(b'.'), Just(b'-'), Just(b'e'), Just(b'x'), any::<u8>()
        ], 0..300)) {
            match parse(&text) {
                Err(failure) => prop_assert!(failure.code() == 2 && failure.message().contains("t.csv")),
                Ok(table) => {
                    for row in 0..table.len() {
                        prop_assert_eq!(table.cells(row).len(), table.header.len());
                    }
                    if let Ok(at) = table.coordinates(&[]) {
                        let width = at.len();
                        if let Ok(columns) = table.numbers(at, true, &|| false) {
                            prop_assert_eq!(columns.values.len(), columns.rows.len() * width);
                            prop_assert!(columns.values.iter().all(|v| v.is_finite()));
                        }
                    }
                }
            }
        }
    }
}
