//! The shipped cases, which are part of the program: they run by name from any folder.

use std::path::{Path, PathBuf};
use voidage_coupling::{Error, Notice, Result};
use voidage_scene::Scene;

/// The shipped scenes and their texts: `bubbling-bed-quick` is `cases/bubbling-bed/scene-quick.toml`. None reads
/// another file, so that it runs in any folder.
pub const CASES: [(&str, &str); 27] = [
    ("bubbling-bed", include_str!("../../bubbling-bed/scene.toml")),
    ("bubbling-bed-migflow", include_str!("../../bubbling-bed/scene-migflow.toml")),
    ("bubbling-bed-quick", include_str!("../../bubbling-bed/scene-quick.toml")),
    ("cavity", include_str!("../../cavity/scene.toml")),
    ("column-collapse", include_str!("../../column-collapse/scene.toml")),
    ("column-collapse-gate", include_str!("../../column-collapse/scene-gate.toml")),
    ("drag-laws", include_str!("../../drag-laws/scene.toml")),
    ("drag-laws-periodic", include_str!("../../drag-laws/scene-periodic.toml")),
    ("droplet-digging", include_str!("../../droplet-digging/scene.toml")),
    ("droplet-digging-quick", include_str!("../../droplet-digging/scene-quick.toml")),
    ("droplet-digging-scaled", include_str!("../../droplet-digging/scene-scaled.toml")),
    ("drum", include_str!("../../drum/scene.toml")),
    ("fed-hopper", include_str!("../../fed-hopper/scene.toml")),
    ("force-chains", include_str!("../../force-chains/scene.toml")),
    ("heap", include_str!("../../heap/scene.toml")),
    ("hopper", include_str!("../../hopper/scene.toml")),
    ("lift", include_str!("../../lift/scene.toml")),
    ("mixed-bed", include_str!("../../mixed-bed/scene.toml")),
    ("packed-bed", include_str!("../../packed-bed/scene.toml")),
    ("piston", include_str!("../../piston/scene.toml")),
    ("settling-grain", include_str!("../../settling-grain/scene.toml")),
    ("settling-grain-light", include_str!("../../settling-grain/scene-light.toml")),
    ("settling-grain-still", include_str!("../../settling-grain/scene-still.toml")),
    ("sheared-suspension", include_str!("../../sheared-suspension/scene.toml")),
    ("stirred-bed", include_str!("../../stirred-bed/scene.toml")),
    ("stirrer", include_str!("../../stirrer/scene.toml")),
    ("tracer", include_str!("../../tracer/scene.toml")),
];

/// The shipped case of a name, with changes `key=value`; none if there is no such case.
pub fn named(name: &Path, sets: &[String]) -> Option<Result<Scene>> {
    let (name, text) = CASES.iter().find(|(known, _)| name.as_os_str() == *known)?;
    Some(Scene::parse(&PathBuf::from(format!("{name}.toml")), text, sets).map_err(Error::from))
}

/// A scene from its file or, where there is no such file, the shipped case of that name, with changes `key=value`.
///
/// # Errors
/// There is neither such a file nor such a case, or the scene is wrong.
pub fn read(scene: &Path, sets: &[String]) -> Result<Scene> {
    // A folder may have the name of a case.
    let shipped = if scene.is_file() { None } else { named(scene, sets) };
    shipped.unwrap_or_else(|| match scene.exists() {
        true => Scene::read(scene, sets),
        false => Err(Error::input(Notice::new(
            format!("{}: there is no such file, and no shipped case of this name", scene.display()),
            format!("give the path of a scene file, or {}", one_of()),
        ))),
    })
}

/// The names of the shipped cases, for messages.
pub fn one_of() -> String {
    format!("one of {}", CASES.map(|(name, _)| name).join(", "))
}
