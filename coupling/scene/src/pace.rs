//! What changes within a step: inputs that the run reads at the ends of steps only, and so misses.

use crate::{Motion, Oscillation, Placement, Scene};
use std::collections::BTreeSet;
use std::f64::consts::TAU;
use voidage_dem::Rounded;

/// Steps that a period of an oscillation has at least: the velocity at a step, a difference of places, is then that of
/// the sine within 2 %.
const STEPS_PER_PERIOD: f64 = 10.0;
/// Angle of a rotation in a step, rad, up to which chords are arcs within 1 %.
const ANGLE: f64 = 0.5;

impl Scene {
    /// Inputs that change faster than the steps that sample them, a sentence each: the key, how fast it is, the step, and
    /// what helps.
    pub fn faster_than_steps(&self) -> Vec<String> {
        let dt = self.time.step;
        let mut told = BTreeSet::new();
        let mut said = vec![];
        let mut add = |key: String, what: String| said.push(format!("`{key}`: {what}"));
        for (i, wall) in self.walls.iter().enumerate() {
            let Some(motion) = &wall.motion else { continue };
            // Of the pieces of a body one is enough.
            if !told.insert(wall.body().to_owned()) {
                continue;
            }
            let key = format!("walls[{i}].motion");
            match motion {
                Motion::Velocity(_) => {}
                Motion::Oscillate(Oscillation { frequency, .. }) => {
                    add_some(&mut add, format!("{key}.oscillate.frequency"), period(*frequency, dt));
                }
                Motion::Rotate(rotation) if rotation.rate.abs() * dt > ANGLE => {
                    let (rate, turn) = (Rounded(rotation.rate), Rounded(TAU / rotation.rate.abs()));
                    let step = Rounded(ANGLE / rotation.rate.abs());
                    add(
                        format!("{key}.rotate.rate"),
                        format!(
                            "at {rate} rad/s a turn takes {turn} s, and a step {} s: walls go along chords; give \
                             `time.step` of {step} s at most",
                            Rounded(dt)
                        ),
                    );
                }
                Motion::Rotate(_) => {}
                Motion::Table(table) => {
                    let times = table.rows.iter().map(|row| row[0]);
                    add_some(&mut add, format!("{key}.table"), missed(times, dt));
                }
            }
        }
        for (i, boundary) in self.fluid.iter().flat_map(|fluid| &fluid.boundaries).enumerate() {
            let times = boundary.schedule.iter().map(|row| row[0]);
            add_some(&mut add, format!("fluid.boundaries[{i}].schedule"), missed(times, dt));
        }
        if let Some(motion) = self.fluid.as_ref().and_then(|fluid| fluid.mesh_motion.as_ref()) {
            let frequency = motion.frequency.and_then(|frequency| period(frequency, dt));
            add_some(&mut add, "fluid.mesh_motion.frequency".to_owned(), frequency);
            let times = motion.table.iter().flat_map(|table| &table.rows).map(|row| row[0]);
            add_some(&mut add, "fluid.mesh_motion.table".to_owned(), missed(times, dt));
        }
        for (i, group) in self.grains.iter().enumerate() {
            if let Placement::Source(source) = &group.placement {
                add_some(
                    &mut add,
                    format!("grains[{i}].placement.source.end"),
                    window(source.start, source.end, dt),
                );
            }
        }
        for (i, sink) in self.sinks.iter().enumerate() {
            add_some(&mut add, format!("sinks[{i}].end"), window(sink.start, sink.end, dt));
        }
        said
    }
}

fn add_some(add: &mut impl FnMut(String, String), key: String, what: Option<String>) {
    what.into_iter().for_each(|what| add(key.clone(), what));
}

/// An oscillation with too few steps in a period.
fn period(frequency: f64, dt: f64) -> Option<String> {
    let steps = 1.0 / (frequency.abs() * dt);
    (steps < STEPS_PER_PERIOD).then(|| {
        format!(
            "at {} Hz a period takes {} s, {} steps of {} s: between their ends nothing of it is seen; give `time.step` \
             of {} s at most",
            Rounded(frequency),
            Rounded(1.0 / frequency.abs()),
            Rounded(steps),
            Rounded(dt),
            Rounded(1.0 / (frequency.abs() * STEPS_PER_PERIOD))
        )
    })
}

/// A row of a table with both neighbours in one step: what it says is not seen. Two rows close to each other are a jump,
/// which is.
fn missed(times: impl Iterator<Item = f64>, dt: f64) -> Option<String> {
    let times: Vec<f64> = times.collect();
    let lost = times.windows(3).filter(|rows| rows[2] - rows[0] < dt * (1.0 - 1e-9)).map(|rows| rows[1]);
    let lost: Vec<f64> = lost.collect();
    let first = lost.first()?;
    Some(format!(
        "{} rows, the first at {} s, lie with the rows before and after within one step of {} s, and may not be seen; \
         give a shorter `time.step`",
        lost.len(),
        Rounded(*first),
        Rounded(dt)
    ))
}

/// A window of time that is shorter than a step.
fn window(start: f64, end: Option<f64>, dt: f64) -> Option<String> {
    let length = end? - start;
    (length < dt * (1.0 - 1e-9)).then(|| {
        format!(
            "the {} s from the start are shorter than a step of {} s; give a shorter `time.step`",
            Rounded(length),
            Rounded(dt)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plate at 1000 Hz stood still with steps of 1 ms, and nothing was said.
    #[test]
    fn what_is_faster_than_the_step_is_said() {
        assert!(
            period(1000.0, 1e-3).is_some_and(|said| said.contains("1000 Hz") && said.contains("0.001 s"))
        );
        assert!(period(50.0, 1e-3).is_none());
        // A jump between two rows is seen, a pulse is not.
        assert_eq!(missed([0.0, 0.1, 0.1001, 0.2].into_iter(), 1e-3), None);
        assert!(missed([0.0, 0.1, 0.1001, 0.1002, 0.2].into_iter(), 1e-3).is_some());
        assert_eq!(missed([0.0, 1e-3, 2e-3].into_iter(), 1e-3), None);
        assert!(window(0.1, Some(0.1005), 1e-3).is_some());
        assert!(window(0.1, None, 1e-3).is_none() && window(0.1, Some(0.101), 1e-3).is_none());
    }
}
