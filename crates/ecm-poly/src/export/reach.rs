//! Where a model counts as inside its data: a box of coordinates, and an ellipsoid in it.

use std::string::{String, ToString};
use std::vec::Vec;

use serde_json::{Map, Value};

use crate::error::ModelError;
use crate::export::model::Model;
use crate::export::{filled, list};

/// low <= x <= high and |factor (x - centre)| <= 1, in the mid-frame coordinates of an energy and the
/// inputs of a polynomial.
#[derive(Clone, Debug)]
pub struct Reach {
    /// Ends of the box, (n,) each.
    pub low: Vec<f64>,
    /// See `low`.
    pub high: Vec<f64>,
    /// Centre of the ellipsoid.
    pub centre: Vec<f64>,
    /// Lower triangle, row by row.
    pub factor: Vec<f64>,
}

/// What `inside` of an exported model tells, in words.
pub fn inside_words(model: &Model, reach: Option<&Reach>) -> &'static str {
    match (reach, model) {
        (Some(_), Model::Energy(_)) => {
            "p lies in the box and the ellipsoid of the measured poses, in mid-frame coordinates"
        }
        (Some(_), Model::Actuated(_)) => {
            "p lies in the box and the ellipsoid of the measured rows: mid-frame coordinates and inputs"
        }
        (Some(_), Model::Polynomial(_)) => {
            "p lies in the box and the ellipsoid of the measured inputs"
        }
        (None, Model::Energy(_)) => {
            "|c| and |theta| of the mid frame are at most 1.01 times those of the training data"
        }
        (None, _) => "every input is in the range of the training data",
    }
}

/// The function `within` and its tables, by the template of a reach, a range or a box.
pub fn within(
    model: &Model,
    reach: Option<&Reach>,
    [of_reach, of_range, of_box]: [&str; 3],
    number: impl Fn(f64) -> String,
) -> String {
    let row = |values: &[f64]| list(values.iter().map(|&x| number(x)));
    match (reach, model) {
        (Some(reach), _) => filled(
            of_reach,
            &[
                ("LOW", &row(&reach.low)),
                ("HIGH", &row(&reach.high)),
                ("MIDDLE", &row(&reach.centre)),
                ("TRIANGLE", &reach.factor.len().to_string()),
                ("FACTOR", &row(&reach.factor)),
            ],
        ),
        (None, Model::Energy(model)) => {
            let [c, theta] = model.reach_squared().map(number);
            filled(of_range, &[("CSQUARED", &c), ("THETASQUARED", &theta)])
        }
        (None, Model::Actuated(_)) => String::new(),
        (None, Model::Polynomial(model)) => filled(
            of_box,
            &[
                ("LOWER", &row(model.lower())),
                ("UPPER", &row(model.upper())),
            ],
        ),
    }
}

/// Share of the reach that golden points take: rounding leaves them inside.
const SHARE: f64 = 0.98;

impl Reach {
    /// The `reach` of a model's document; None where it has none.
    ///
    /// # Errors
    /// As [`Reach::from_document`]; none beside actuators, whose ranges nothing else tells.
    pub fn of_model(
        document: &Map<String, Value>,
        model: &Model,
    ) -> Result<Option<Self>, ModelError> {
        let reach = Self::from_document(document, model.shape().0)?;
        match (&reach, model) {
            (None, Model::Actuated(_)) => Err(ModelError::Setting {
                name: "reach",
                found: "none".into(),
                expected: "one of poses and inputs: fit again, so that the file holds its rows",
            }),
            _ => Ok(reach),
        }
    }

    /// The `reach` of a document of n inputs; None where it has none.
    ///
    /// # Errors
    /// Lists of other lengths, a number that is not finite, a centre outside the box, a factor without
    /// a positive diagonal.
    pub fn from_document(
        document: &Map<String, Value>,
        n: usize,
    ) -> Result<Option<Self>, ModelError> {
        let Some(reach) = document.get("reach") else {
            return Ok(None);
        };
        let sound = Self::read(reach, n).filter(|r| {
            let boxed = |i: usize| r.low[i] <= r.centre[i] && r.centre[i] <= r.high[i];
            (0..n).all(|i| boxed(i) && r.factor[i * (i + 3) / 2] > 0.0)
        });
        sound.map(Some).ok_or(ModelError::Setting {
            name: "reach",
            found: "lists that are none".into(),
            expected: "low, high, centre and factor of a box and an ellipsoid around its middle",
        })
    }

    /// None where a list lacks, or has another length or a number that is not finite.
    fn read(reach: &Value, n: usize) -> Option<Self> {
        let list = |key: &str, count: usize| -> Option<Vec<f64>> {
            let values = reach.get(key)?.as_array()?;
            let numbers: Option<Vec<f64>> = values.iter().map(Value::as_f64).collect();
            numbers.filter(|v| v.len() == count && v.iter().all(|x| x.is_finite()))
        };
        Some(Self {
            low: list("low", n)?,
            high: list("high", n)?,
            centre: list("centre", n)?,
            factor: list("factor", n * (n + 1) / 2)?,
        })
    }

    /// The point inside of n numbers from -1 to 1; the centre of zeros.
    pub fn point(&self, spread: impl Fn(usize) -> f64) -> Vec<f64> {
        let n = self.centre.len();
        let root = (n as f64).sqrt();
        let mut away: Vec<f64> = Vec::new();
        for k in 0..n {
            let row = &self.factor[k * (k + 1) / 2..];
            let before: f64 = away.iter().zip(row).map(|(x, f)| x * f).sum();
            away.push((SHARE * spread(k) / root - before) / row[k]);
        }
        let room = |k: usize| match away[k] {
            x if x > 0.0 => SHARE * (self.high[k] - self.centre[k]) / x,
            x if x < 0.0 => SHARE * (self.low[k] - self.centre[k]) / x,
            _ => 1.0,
        };
        let share = (0..n).map(room).fold(1.0, f64::min);
        (self.centre.iter().zip(&away))
            .map(|(c, x)| c + share * x)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn reach(text: &str) -> Result<Option<Reach>, ModelError> {
        let document: Map<String, Value> = serde_json::from_str(text).unwrap_or_default();
        Reach::from_document(&document, 2)
    }

    #[test]
    fn points_are_inside_and_lists_that_do_not_fit_are_refused() {
        let text = r#"{"reach": {"low": [-1, -1], "high": [2, 1], "centre": [0, 0.5], "factor": [1, -2, 3]}}"#;
        let found = reach(text).unwrap().unwrap();
        for i in 0..50 {
            let x = found.point(|k| (1.0 + (7 * i + 3 * k) as f64).sin());
            let (a, b) = (x[0] - found.centre[0], x[1] - found.centre[1]);
            assert!(a * a + (3.0 * b - 2.0 * a).powi(2) < 1.0);
            assert!((0..2).all(|k| found.low[k] < x[k] && x[k] < found.high[k]));
        }
        assert_eq!(found.point(|_| 0.0), found.centre);
        assert!(reach("{}").unwrap().is_none());
        for (right, wrong) in [
            ("[0, 0.5]", "[0, 5]"),
            ("-2, 3]", "-2, 0]"),
            ("[-1, -1]", "[-1]"),
        ] {
            assert!(reach(&text.replace(right, wrong)).is_err(), "{wrong}");
        }
    }
}
