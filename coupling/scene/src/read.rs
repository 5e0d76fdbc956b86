//! From a file to a checked scene, and back.

use super::document::{self, fill};
use super::edit::edit;
use super::{Contacts, Coupling, MeshSource, Motion, Placement, Scene, check};
use std::fs;
use std::path::{Path, PathBuf};
use voidage_coupling::closure::HeatTransfer;
use voidage_coupling::error::{Error, Notice, Result};
use voidage_coupling::error::{Location, SceneError};

impl Scene {
    /// Reads a scene, changes it by options `key=value`, fills in the defaults, and checks it.
    pub fn read(file: &Path, sets: &[String]) -> Result<Scene> {
        let text = fs::read_to_string(file).map_err(|error| {
            Error::input(Notice::new(
                format!("{}: cannot read the scene: {error}", file.display()),
                "give the path of a scene file, such as cases/bubbling-bed/scene.toml",
            ))
        })?;
        Ok(Scene::parse(file, &text, sets)?)
    }

    /// The same from a text; `file` is named in errors, and its folder is where paths start.
    pub fn parse(file: &Path, text: &str, sets: &[String]) -> std::result::Result<Scene, Box<SceneError>> {
        let (mut document, mut origin) = document::parse::<Scene>(file, text)?;
        let mut scene: Scene = fill(&document).map_err(|fault| origin.fault(fault))?;
        for option in sets {
            let place = Location::Set(option.clone());
            let edit =
                edit(&document, option).map_err(|(message, help)| origin.at(place.clone(), message, help))?;
            (scene, document) = match (fill(&edit.inserted), fill(&edit.replaced)) {
                (Ok(scene), _) => (scene, edit.inserted),
                (Err(_), Ok(scene)) => (scene, edit.replaced),
                // Beside another choice the new one cannot be read; in its place it may be wrong for a reason of its
                // own.
                (Err(first), Err(alone)) => {
                    let fault =
                        if first.notice.what.contains(", where one is chosen") { alone } else { first };
                    return Err(origin.at(place, fault.notice.what, fault.notice.help));
                }
            };
            origin.sets.push((edit.path, option.clone()));
            document::finite::<Scene>(&document, &origin)?;
        }
        scene.origin = origin;
        check::structure(&scene)?;
        scene.resolve();
        scene.read_motions()?;
        // Before walls along its boundary make the mesh.
        check::mesh(&scene)?;
        check::walls(&scene)?;
        scene.lay_walls()?;
        check::values(&scene)?;
        scene.check_events()?;
        Ok(scene)
    }

    /// Fills in what follows from the rest of the scene, and makes paths independent of the folder.
    fn resolve(&mut self) {
        let heat = self.grains_have_heat() && self.fluid_has_heat();
        if !self.grains.is_empty() {
            self.contacts.get_or_insert_with(Contacts::default);
            if self.fluid.is_some() {
                let coupling = self.coupling.get_or_insert_with(Coupling::default);
                if heat {
                    coupling.heat.get_or_insert(HeatTransfer::Henry);
                }
            }
        }
        let folder = fs::canonicalize(self.origin.folder()).unwrap_or_else(|_| PathBuf::from("."));
        let folder = if self.origin.folder().as_os_str().is_empty() {
            std::env::current_dir().unwrap_or(folder)
        } else {
            folder
        };
        for file in self.files_mut() {
            *file = folder.join(&*file);
        }
        if let Some(coupling) = &mut self.coupling {
            coupling.scheme = coupling.scheme.within(&folder);
        }
        if let Some(heat) = self.fluid.as_mut().and_then(|fluid| fluid.heat.as_mut()) {
            heat.reference_temperature.get_or_insert(heat.initial_temperature);
        }
    }

    /// Reads the tables of motions, which then are part of the scene.
    fn read_motions(&mut self) -> std::result::Result<(), Box<SceneError>> {
        let folder = self.origin.folder().to_path_buf();
        let walls = self.walls.iter_mut().enumerate().filter_map(|(k, wall)| match &mut wall.motion {
            Some(Motion::Table(table)) => Some((format!("walls[{k}].motion.table.file"), table)),
            _ => None,
        });
        let motion = self.fluid.as_mut().and_then(|fluid| fluid.mesh_motion.as_mut());
        let mesh = motion.and_then(|motion| motion.table.as_mut());
        for (path, table) in walls.chain(mesh.map(|table| ("fluid.mesh_motion.table.file".into(), table))) {
            let Some(file) = table.file.take() else { continue };
            if !table.rows.is_empty() {
                let message = format!("`{path}` is there beside `rows`");
                return Err(self.origin.error(&path, message, "take one of the two away"));
            }
            table.rows = motion_rows(&folder.join(file)).map_err(|message| {
                let help = "give a CSV file with the header t,x,y,angle and a number in each column";
                self.origin.error(&path, message, help)
            })?;
        }
        Ok(())
    }

    fn files_mut(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        let mesh = self.fluid.as_mut().and_then(|fluid| match &mut fluid.mesh {
            MeshSource::File(file) => Some(file),
            MeshSource::Rectangle(_) => None,
        });
        let grains = self.grains.iter_mut().filter_map(|group| match &mut group.placement {
            Placement::Csv(csv) => Some(&mut csv.file),
            Placement::State(state) => Some(&mut state.file),
            _ => None,
        });
        grains.chain(mesh)
    }

    /// The scene as it runs, with all defaults, as TOML.
    pub fn to_toml(&self) -> Result<String> {
        toml::to_string(self).map_err(|error| Error::run(format!("cannot write the scene as TOML: {error}")))
    }

    /// What decides the course of a run: the scene without its title, its end, what stops it, its output and the
    /// program that solves the fluid.
    pub(crate) fn course(&self) -> Scene {
        let mut bare = self.clone();
        bare.title = String::new();
        bare.time.end = 0.0;
        bare.stop = None;
        bare.contacts.iter_mut().for_each(|contacts| contacts.max_penetration = 0.0);
        bare.output = super::Output::default();
        bare.fluid.iter_mut().for_each(|fluid| fluid.backend = None);
        bare
    }

    /// With the hashes of its files in the place of their names.
    fn with_hashes(mut self) -> Result<Self> {
        for file in self.files_mut() {
            let content = fs::read(&*file).map_err(|error| Error::file(file, "read", error))?;
            *file = PathBuf::from(blake3::hash(&content).to_hex().as_str());
        }
        Ok(self)
    }

    /// The course of the run as TOML, with the hashes of its files in the place of their names: two runs of equal texts
    /// take the same course.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn course_toml(&self) -> Result<String> {
        self.course().with_hashes()?.to_toml()
    }

    /// All but the title as TOML, with the hashes of its files in the place of their names: two runs of equal texts
    /// measure the same, wherever their files are.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn identity_toml(&self) -> Result<String> {
        Self { title: String::new(), ..self.clone() }.with_hashes()?.to_toml()
    }

    /// A hash (blake3, hexadecimal) of [`Self::course_toml`]. Equal hashes: a checkpoint of one restarts the other.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn hash(&self) -> Result<String> {
        Ok(blake3::hash(self.course_toml()?.as_bytes()).to_hex().to_string())
    }

    /// An error that points at a key of the scene, such as `fluid.boundaries[0].name`; for checks that need more than
    /// the scene (a mesh, say).
    pub fn error(&self, path: &str, message: impl Into<String>, help: impl Into<String>) -> Error {
        self.origin.error(path, message, help).into()
    }
}

/// The rows `t,x,y,angle` of a file, or what is wrong with it.
fn motion_rows(file: &Path) -> std::result::Result<Vec<[f64; 4]>, String> {
    let name = file.display();
    let mut reader = csv::Reader::from_path(file).map_err(|error| format!("{name}: {error}"))?;
    let header = reader.headers().map_err(|error| format!("{name}: {error}"))?;
    if header.iter().map(str::trim).ne(["t", "x", "y", "angle"]) {
        return Err(format!("{name}, line 1: the header is not t,x,y,angle"));
    }
    let mut rows = Vec::new();
    for (k, row) in reader.records().enumerate() {
        let row = row.map_err(|error| format!("{name}: {error}"))?;
        let numbers: Vec<f64> = row.iter().filter_map(|text| text.trim().parse().ok()).collect();
        let finite = numbers.iter().all(|number| number.is_finite());
        let row = <[f64; 4]>::try_from(numbers).ok().filter(|_| finite);
        rows.push(row.ok_or_else(|| format!("{name}, line {}: these are not four numbers", k + 2))?);
    }
    Ok(rows)
}
