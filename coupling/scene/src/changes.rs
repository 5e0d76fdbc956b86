//! What a scene has changed since a checkpoint was written, and whether a run can go on with it.
//!
//! Keys of laws, of what acts from outside and of how equations are solved may change. What the checkpoint holds itself
//! (the grains, the mesh, the fields) may not: a new value would change nothing.

use crate::Scene;
use crate::recorder::{Checkpoint, Kept};
use std::collections::BTreeMap;
use std::fmt;
use toml::Value;
use voidage_coupling::error::{Error, Notice, Result};

/// Keys that may change at a restart and by an event, with `*` for a name or a number in a list; tables with all that
/// is in them.
pub(crate) const LAWS: &[&str] = &[
    "materials.*.friction",
    "materials.*.restitution",
    "materials.*.rolling",
    "materials.*.conductivity",
    "walls.*.friction",
    "walls.*.restitution",
    "walls.*.rolling",
    "walls.*.material",
    "walls.*.temperature",
    "contacts.tolerance",
    "contacts.max_sweeps",
    "contacts.interior",
    "contacts.max_travel",
    "contacts.max_substeps",
    "contacts.cohesion.force",
    "contacts.cohesion.sliding",
    "contacts.pairs.*.friction",
    "contacts.pairs.*.restitution",
    "contacts.pairs.*.rolling",
    "coupling.scheme",
    "coupling.iteration",
    "coupling.cut",
    "coupling.drag",
    "coupling.voidage_function",
    "coupling.heat",
    "coupling.per",
    "coupling.cohesion_halo",
    "coupling.kernel",
    "coupling.added_mass",
    "coupling.lift",
    "fluid.boundaries.*.flow",
    "fluid.boundaries.*.schedule",
    "fluid.boundaries.*.heat",
    "fluid.boundaries.*.scalars",
];

/// Keys that may change at a restart beside these.
const AT_RESTART: &[&str] = &[
    "gravity",
    "time.step",
    "events",
    "walls.*.until",
    "grains.*.placement.source.rate",
    "grains.*.placement.source.start",
    "grains.*.placement.source.end",
    "grains.*.placement.source.lower",
    "grains.*.placement.source.upper",
    "sinks.*.from",
    "sinks.*.to",
    "sinks.*.lower",
    "sinks.*.upper",
    "sinks.*.start",
    "sinks.*.end",
    "fluid.body_force",
    "fluid.density",
    "fluid.viscosity",
    "fluid.solver",
    "fluid.thin_cell",
    "fluid.ramp",
    "fluid.heat.heat_capacity",
    "fluid.heat.conductivity",
    "fluid.heat.expansion",
    "fluid.heat.reference_temperature",
    "fluid.heat.form",
    "fluid.scalars.*.diffusivity",
    "fluid.scalars.*.expansion",
    "fluid.scalars.*.reference",
    "fluid.scalars.*.form",
];

/// A key of a scene whose value is another one than when the checkpoint was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// The key, with numbers for places in lists.
    pub key: String,
    /// What it was; none if the scene did not have it.
    pub before: Option<String>,
    /// What it is.
    pub now: Option<String>,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = |value: &Option<String>| value.clone().unwrap_or_else(|| "absent".to_owned());
        write!(f, "{} = {}, was {}", self.key, text(&self.now), text(&self.before))
    }
}

impl Change {
    /// Whether a run can go on with it from a checkpoint.
    fn is_allowed(&self) -> bool {
        self.is_among(LAWS) || self.is_among(AT_RESTART)
    }

    /// Whether it is of one of these keys, or of a table of them.
    pub(crate) fn is_among(&self, keys: &[&str]) -> bool {
        let parts: Vec<&str> = self.key.split('.').collect();
        keys.iter().any(|key| {
            let allowed = key.split('.');
            allowed.clone().count() <= parts.len() && allowed.zip(&parts).all(|(a, b)| a == "*" || a == *b)
        })
    }
}

/// All values of a document by key; lists of tables by number, other lists whole.
fn flatten(value: &Value, key: String, into: &mut BTreeMap<String, String>) {
    let inner = |name: &str| if key.is_empty() { name.to_owned() } else { format!("{key}.{name}") };
    match value {
        Value::Table(table) => table.iter().for_each(|(name, value)| flatten(value, inner(name), into)),
        Value::Array(list) if list.iter().any(Value::is_table) => {
            list.iter().enumerate().for_each(|(i, value)| flatten(value, inner(&i.to_string()), into));
        }
        other => {
            into.insert(key, other.to_string());
        }
    }
}

/// What differs between two scenes, in order of the keys.
pub(crate) fn differences(before: &str, now: &str) -> Result<Vec<Change>> {
    let read = |text: &str| -> Result<BTreeMap<String, String>> {
        let table: toml::Table = text.parse().map_err(|error| {
            Error::input(Notice::new(
                format!("the scene in the checkpoint cannot be read: {error}"),
                "run from the start",
            ))
        })?;
        let mut values = BTreeMap::new();
        flatten(&Value::Table(table), String::new(), &mut values);
        Ok(values)
    };
    let (mut before, now) = (read(before)?, read(now)?);
    let mut changes: Vec<Change> = now
        .into_iter()
        .map(|(key, now)| Change { before: before.remove(&key), key, now: Some(now) })
        .filter(|change| change.before != change.now)
        .collect();
    changes.extend(before.into_iter().map(|(key, value)| Change { key, before: Some(value), now: None }));
    changes.sort_by(|a, b| a.key.cmp(&b.key));
    Ok(changes)
}

impl Scene {
    /// What this scene changes in the run that a checkpoint is of; nothing if they are the same.
    ///
    /// # Errors
    /// A change with which the run cannot go on; files that the scene names have changed.
    pub fn changes_since(&self, checkpoint: &Checkpoint) -> Result<Vec<Change>> {
        let hash = self.hash()?;
        if checkpoint.stamp.scene_hash == hash {
            return Ok(vec![]);
        }
        let kept: Kept = checkpoint.recorder()?;
        let changes = differences(&kept.course, &self.course_toml()?)?;
        if changes.is_empty() {
            return Err(checkpoint.of_another_scene(&hash));
        }
        match changes.iter().find(|change| !change.is_allowed()) {
            None => Ok(changes),
            Some(change) => {
                let what = format!("`{change}`: a run cannot go on with that from a checkpoint");
                let help = "laws, boundary conditions, gravity, friction, the step and how equations are solved may \
                            change; the grains, \
                            the mesh and the fields are those of the checkpoint";
                Err(self.error(&change.key, what, help))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_named_and_those_of_the_state_are_refused() {
        let before =
            "gravity = [0.0, -9.81]\n[[walls]]\nname = \"a\"\nfriction = 0.1\n[fluid]\ndensity = 1.0\n";
        let now = "gravity = [0.0, -1.62]\n[[walls]]\nname = \"b\"\nfriction = 0.1\n[fluid]\nramp = 0.1\n";
        let changes = differences(before, now).unwrap();
        let said: Vec<String> = changes.iter().map(Change::to_string).collect();
        assert_eq!(
            said,
            [
                "fluid.density = absent, was 1.0",
                "fluid.ramp = 0.1, was absent",
                "gravity = [0.0, -1.62], was [0.0, -9.81]",
                "walls.0.name = \"b\", was \"a\"",
            ]
        );
        let allowed: Vec<bool> = changes.iter().map(Change::is_allowed).collect();
        assert_eq!(allowed, [true, true, true, false]);
        assert!(differences(before, before).unwrap().is_empty());
    }
}
