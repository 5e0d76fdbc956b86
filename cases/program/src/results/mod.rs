//! What a run left in its folder, read back: for pictures and for `voidage analyse`.

pub mod table;

use std::path::{Path, PathBuf};
use voidage_coupling::{Error, Notice, Result};
use voidage_scene::Scene;
use voidage_scene::recorder::read_collection;

/// Which folders hold the results of a run.
pub const FOLDER: &str = "give the folder of a run (its option --out)";

/// The scene of the run that left a folder.
///
/// # Errors
/// There is none, or it is wrong.
pub fn read_scene(folder: &Path) -> Result<Scene> {
    let scene = folder.join("scene.toml");
    if !scene.is_file() {
        let what = format!("{}: holds no scene.toml", folder.display());
        return Err(Error::input(Notice::new(what, FOLDER)));
    }
    Scene::read(&scene, &[])
}

/// A recorded moment: the files of its grains and its fluid.
pub struct Moment {
    /// s.
    pub time: f64,
    /// Frame of the grains.
    pub grains: Option<PathBuf>,
    /// Frame of the fluid.
    pub fluid: Option<PathBuf>,
    /// Frame of the contacts, if they are recorded.
    pub contacts: Option<PathBuf>,
}

/// The moments that a folder has, in order.
pub fn moments(folder: &Path) -> Result<Vec<Moment>> {
    let list = |name: &str| {
        let path = folder.join(name);
        if path.is_file() { read_collection(&path) } else { Ok(Vec::new()) }
    };
    let (grains, fluid, contacts) = (list("grains.pvd")?, list("fluid.pvd")?, list("contacts.pvd")?);
    let mut times: Vec<f64> = grains.iter().chain(&fluid).map(|(time, _)| *time).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let at = |list: &[(f64, PathBuf)], time: f64| {
        list.iter().find(|(other, _)| *other == time).map(|(_, file)| file.clone())
    };
    let moment = |time: f64| {
        let (grains, fluid) = (at(&grains, time), at(&fluid, time));
        Moment { time, grains, fluid, contacts: at(&contacts, time) }
    };
    Ok(times.into_iter().map(moment).collect())
}
