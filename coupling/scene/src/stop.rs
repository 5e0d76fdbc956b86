//! What ends a run before its time.

use crate::recorder::Reading;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What ends a run before `time.end`, whichever comes first; the run is then done.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Stop {
    /// The run ends when the grains are at rest. Default: it does not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_rest: Option<AtRest>,
    /// The run ends when a column of `series.csv` has reached a value in one of its rows. Default: it does not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<Reached>,
    /// Longest wall-clock time of the run, s, counted from the start of the program. Above 0. Default: no limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wall_time: Option<f64>,
}

/// Grains at rest: none is faster than `speed` for as long as `during`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AtRest {
    /// Bound of the speed of the fastest grain, m/s. Above 0.
    pub speed: f64,
    /// How long no grain may be faster, s, because a grain at the top of its flight is not at rest. Above 0.
    pub during: f64,
}

/// A value of the time series, with either `above` or `below`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Reached {
    /// Name of the column, such as `mean_grain_temperature_K`.
    pub column: String,
    /// The run ends when the column is above this.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub above: Option<f64>,
    /// The run ends when the column is below this.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub below: Option<f64>,
}

/// Since when grains have been slow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Slow {
    /// No grain has been faster than this, m/s,
    pub speed: f64,
    /// since this time, s.
    pub since: f64,
}

/// Whether a run that goes on has come to what ends it.
#[derive(Clone, Debug, Default)]
pub struct Watch {
    stop: Stop,
    slow: Option<Slow>,
}

impl Watch {
    /// Begins to watch a run; in one that goes on grains may have been slow before, which counts for the same bound.
    pub fn new(stop: Option<&Stop>, slow: Option<Slow>) -> Self {
        let bound = stop.and_then(|stop| stop.at_rest.as_ref()).map(|at_rest| at_rest.speed);
        let slow = slow.filter(|slow| Some(slow.speed) == bound);
        Self { stop: stop.cloned().unwrap_or_default(), slow }
    }

    /// Since when no grain has been faster than allowed; none if one is, or nobody asks.
    pub fn slow(&self) -> Option<Slow> {
        self.slow
    }

    /// After a step: why the run ends at `time`, s, if it does; `speed` is that of the fastest grain, m/s, `wall` the
    /// time since the start, s.
    pub fn after_step(&mut self, time: f64, speed: impl FnOnce() -> f64, wall: f64) -> Option<String> {
        if let Some(AtRest { speed: bound, during }) = self.stop.at_rest {
            // Written so that a speed that is no number is not at rest.
            let slow = speed() <= bound;
            let begins = Slow { speed: bound, since: time };
            self.slow = if slow { self.slow.or(Some(begins)) } else { None };
            if self.slow.is_some_and(|slow| time - slow.since >= during) {
                return Some(format!(
                    "stop.at_rest: no grain has been faster than {bound} m/s for {during} s"
                ));
            }
        }
        let limit = self.stop.wall_time.filter(|limit| wall >= *limit)?;
        Some(format!("stop.wall_time: the run has taken {limit} s"))
    }

    /// The same with a row of the series.
    pub fn after_row(&self, row: &[Reading]) -> Option<String> {
        let Reached { column, above, below } = self.stop.value.as_ref()?;
        let (_, value) = row.iter().find(|(name, _)| name == column)?;
        let reached = above.is_some_and(|bound| *value > bound) || below.is_some_and(|bound| *value < bound);
        reached.then(|| format!("stop.value: {column} = {value}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grains_are_at_rest_when_they_have_been_slow_for_long_enough() {
        let stop = Stop { at_rest: Some(AtRest { speed: 0.1, during: 0.2 }), ..Stop::default() };
        let mut watch = Watch::new(Some(&stop), None);
        let speeds =
            [(0.0, 0.0), (0.1, 0.05), (0.15, 0.2), (0.2, 0.05), (0.3, f64::NAN), (0.4, 0.0), (0.55, 0.1)];
        assert!(speeds.iter().all(|(time, speed)| watch.after_step(*time, || *speed, 0.0).is_none()));
        // A run that is stopped and goes on does not begin to count anew.
        let mut again = Watch::new(Some(&stop), watch.slow());
        // Unless it asks for slower grains than before.
        let slower = Stop { at_rest: Some(AtRest { speed: 0.099, during: 0.2 }), ..Stop::default() };
        assert!(Watch::new(Some(&slower), watch.slow()).after_step(0.65, || 0.0, 0.0).is_none());
        for watch in [&mut watch, &mut again] {
            assert!(watch.after_step(0.65, || 0.1, 0.0).unwrap().starts_with("stop.at_rest"));
        }
    }

    #[test]
    fn values_and_wall_time_end_a_run() {
        let value = Some(Reached { column: "x".into(), above: Some(1.0), below: Some(-1.0) });
        let mut watch = Watch::new(Some(&Stop { value, wall_time: Some(5.0), ..Stop::default() }), None);
        let row = |x: f64| vec![("time_s".into(), 9.0), ("x".into(), x)];
        assert_eq!(
            [0.0, 1.0, 2.0, -2.0, f64::NAN].map(|x| watch.after_row(&row(x)).is_some()),
            [false, false, true, true, false]
        );
        assert!(watch.after_step(0.0, || 0.0, 4.9).is_none() && watch.after_step(0.0, || 0.0, 5.0).is_some());
        assert!(Watch::new(None, None).after_row(&row(9.0)).is_none());
    }
}
