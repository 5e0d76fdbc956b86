//! Measured data: points `(time or place, value)` from the tables of this folder.

use serde::de::DeserializeOwned;

/// A curve that was measured.
pub type Points = Vec<(f64, f64)>;

/// The rows of a table.
///
/// # Panics
/// If the table, which is part of the program, is not one of such rows.
pub fn rows<Row: DeserializeOwned>(table: &str) -> Vec<Row> {
    let rows = csv::Reader::from_reader(table.as_bytes()).into_deserialize();
    rows.collect::<Result<_, _>>().expect("a table of measured values")
}

/// The value at `x` between the points of a curve whose x grows; that of the first point before it, and `beyond` behind
/// the last.
pub fn between(points: &[(f64, f64)], x: f64, beyond: f64) -> f64 {
    let next = points.partition_point(|point| point.0 < x);
    match (next.checked_sub(1).map(|before| points[before]), points.get(next)) {
        (None, Some(first)) => first.1,
        (Some((x0, y0)), Some(&(x1, y1))) => y0 + (y1 - y0) * (x - x0) / (x1 - x0),
        (_, None) => beyond,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_linear_between_their_points() {
        let curve = [(1.0, 5.0), (3.0, 9.0)];
        assert_eq!([0.0, 1.0, 2.0, 3.0, 3.1].map(|x| between(&curve, x, 0.0)), [5.0, 5.0, 7.0, 9.0, 0.0]);
    }
}
