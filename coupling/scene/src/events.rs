//! Keys that change while a run goes on.
//!
//! An event does what a restart with other keys does, without the stop: the laws of grains, walls, exchange and
//! boundary are those of another scene from then on.

use crate::build::other_scheme;
use crate::changes::{LAWS, differences};
use crate::check::sources;
use crate::{Event, Scene};
use voidage_coupling::error::{Notice, SceneError};

/// Keys that an event may change beside [`LAWS`].
const BY_EVENT: &[&str] = &["grains.*.placement.source", "sinks", "coupling.cohesion_below"];

/// The names of all sources and sinks.
fn passages(scene: &Scene) -> Vec<&str> {
    let sources = sources(scene).map(|(_, _, source)| source.name.as_str());
    sources.chain(scene.sinks.iter().map(|sink| sink.name.as_str())).collect()
}

impl Scene {
    /// The number of the step before which an event takes place: the first that starts at its time or later.
    pub(crate) fn step_of(&self, event: &Event) -> u64 {
        (event.time / self.time.step * (1.0 - 1e-9)).ceil() as u64
    }

    /// The scene as it is when a step begins, with all events that took place before the steps up to this one.
    ///
    /// # Errors
    /// Keys that are wrong; none in a scene that was read.
    pub(crate) fn before_step(&self, step: u64) -> Result<Scene, Box<SceneError>> {
        let past = self.events.iter().filter(|event| self.step_of(event) <= step);
        self.with(&past.flat_map(|event| event.set.clone()).collect::<Vec<_>>())
    }

    /// The scene without events, with other keys.
    fn with(&self, sets: &[String]) -> Result<Scene, Box<SceneError>> {
        let bare = Scene { events: vec![], ..self.clone() };
        if sets.is_empty() {
            return Ok(bare);
        }
        let unwritten = |error: voidage_coupling::Error| {
            let Notice { what, help } = error.notice();
            self.origin.error("events", what, help)
        };
        Scene::parse(self.origin.file(), &bare.to_toml().map_err(unwritten)?, sets)
    }

    /// Checks of a scene whose steps a scheme of one's own does, in place of the one that it names.
    ///
    /// # Errors
    /// The scene asks for another scheme at some time.
    pub fn check_own_scheme(&self) -> Result<(), Box<SceneError>> {
        if other_scheme(self, &self.before_step(u64::MAX)?) {
            let what = "`events` change the scheme, but it is one of your own";
            return Err(self.origin.error(
                "events",
                what,
                "leave `coupling.scheme` and its options out of them",
            ));
        }
        Ok(())
    }

    /// Checks of the events: their times, and that each changes what may change.
    pub(crate) fn check_events(&self) -> Result<(), Box<SceneError>> {
        let mut sets: Vec<String> = vec![];
        let mut before = f64::NEG_INFINITY;
        for (k, event) in self.events.iter().enumerate() {
            let path = format!("events[{k}]");
            if event.time.is_nan() || event.time <= 0.0 || event.time < before {
                let key = format!("{path}.time");
                let message = format!(
                    "`{key} = {}` is not after the start, or before the event in front of it",
                    event.time
                );
                return Err(self.origin.error(&key, message, "give times above 0 that increase"));
            }
            before = event.time;
            if event.set.is_empty() {
                let key = format!("{path}.set");
                return Err(self.origin.error(
                    &key,
                    format!("`{key}` is empty"),
                    "give keys with values: [\"KEY=VALUE\", ..]",
                ));
            }
            for (i, set) in event.set.iter().enumerate() {
                let key = format!("{path}.set[{i}]");
                let wrong = |error: Box<SceneError>| {
                    self.origin.error(
                        &key,
                        format!("`{key} = {set:?}`: {}", error.notice.what),
                        error.notice.help,
                    )
                };
                let old = self.with(&sets).map_err(wrong)?;
                sets.push(set.clone());
                let new = self.with(&sets).map_err(wrong)?;
                if passages(&old) != passages(&new) {
                    let what =
                        "sources or sinks come, go or change their names, and `series.csv` has their columns";
                    let help =
                        "give all of them from the start on, with `start` and `end` where they do not last";
                    return Err(self.origin.error(&key, format!("`{key} = {set:?}`: {what}"), help));
                }
                self.check_change(&key, set, (&old, &new))?;
            }
        }
        Ok(())
    }

    fn check_change(
        &self,
        key: &str,
        set: &str,
        (old, new): (&Scene, &Scene),
    ) -> Result<(), Box<SceneError>> {
        let wrong = |what: String, help: &str| {
            Err(self.origin.error(key, format!("`{key} = {set:?}`: {what}"), help))
        };
        let texts = (old.course().to_toml(), new.course().to_toml());
        let (Ok(old), Ok(new)) = texts else { return wrong("the scene cannot be written".into(), "") };
        let Ok(changes) = differences(&old, &new) else {
            return wrong("the scene cannot be read".into(), "");
        };
        if changes.is_empty() {
            return wrong(
                "this changes nothing that decides the run".into(),
                "give another value, or take it away",
            );
        }
        match changes.iter().find(|change| !(change.is_among(LAWS) || change.is_among(BY_EVENT))) {
            None => Ok(()),
            Some(change) => wrong(
                format!("`{}` cannot change while a run goes on", change.key),
                "friction, rolling, restitution, cohesion, sources and sinks, laws, schemes and conditions at \
                 boundaries can",
            ),
        }
    }
}
