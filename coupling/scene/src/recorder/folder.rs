//! The folder of a run: one process at a time writes into it, and it holds the files of one run.
//!
//! A folder that runs have written into has a file [`LOCK`]. Its lock belongs to the process that writes, and goes with
//! it whatever ends it. Files that no run makes are never touched; files named like those of a run, in a folder without
//! [`LOCK`], belong to somebody else.

use super::create_folder;
use super::files::TEMPORARY;
use super::recording::{CHECKPOINT, FAILED};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use voidage_coupling::error::{Error, Notice, Result};

/// The file that says that a folder is one of runs, with the number of the process that wrote last.
pub const LOCK: &str = "voidage.lock";

/// What may become of an earlier run in a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Earlier {
    /// It stays, and there is no other beside it.
    Keep,
    /// Its files give way to those of the new run.
    Overwrite,
    /// The run goes on.
    Continue,
}

/// A folder in which this process alone writes.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    /// Whether an earlier run is in it.
    used: bool,
    /// Held for its lock.
    _lock: File,
}

/// Files that each run makes, but for beds, which any run may take.
const FILES: [&str; 10] = [
    "scene.toml",
    "series.csv",
    "summary.json",
    "averages.csv",
    "grains.pvd",
    "fluid.pvd",
    "contacts.pvd",
    "temperature_fit.json",
    CHECKPOINT,
    FAILED,
];

/// Pictures of a run.
const PICTURES: [&str; 14] = [
    "temperature.png",
    "pressure.png",
    "energy.png",
    "packing.png",
    "velocity.png",
    "digging.png",
    "film.mp4",
    "droplet-profiles.png",
    "droplet-depth.png",
    "droplet-velocity.png",
    "droplet-lifetime.png",
    "droplet-forces.png",
    "droplet-heat.png",
    "grain-temperature.png",
];

/// Files that `voidage analyse` makes in the folder [`ANALYSIS`] of a run.
pub const ANALYSES: [&str; 13] = [
    "analysis.csv",
    "spectra.csv",
    "spectrum.csv",
    "spectrum.png",
    "bed.csv",
    "bed.png",
    "bubbles.csv",
    "bubbles-by-height.csv",
    "bubbles.png",
    "profiles.csv",
    "profiles.png",
    "mean-fields.vtu",
    "mean-fields.png",
];

/// The folder of what `voidage analyse` makes, in that of the run.
pub const ANALYSIS: &str = "analysis";

/// Whether a file is a picture of a run.
fn is_picture(name: &str) -> bool {
    let at_times = ["snapshot-", "chains-"].iter().any(|start| name.starts_with(start));
    PICTURES.contains(&name) || at_times && name.ends_with("s.png")
}

/// Whether a file in `frames` is a frame of a run.
fn is_frame(name: &str) -> bool {
    [("grains-", ".vtp"), ("fluid-", ".vtu"), ("contacts-", ".vtp")].iter().any(|(start, end)| {
        let number = name.strip_prefix(start).and_then(|rest| rest.strip_suffix(end));
        number.is_some_and(|digits| digits.bytes().all(|c| c.is_ascii_digit()))
    })
}

/// The names in a folder that `of_interest` picks; none if there is no folder.
fn names(folder: &Path, of_interest: impl Fn(&str) -> bool) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .filter(|name| of_interest(name))
        .collect();
    names.sort();
    names
}

impl OutputFolder {
    /// Takes a folder, which is made if need be.
    ///
    /// # Errors
    /// Another process writes into it; it holds a run and `earlier` keeps that; files of somebody else have the names
    /// of those of a run; it cannot be made.
    pub fn take(path: &Path, earlier: Earlier) -> Result<OutputFolder> {
        let known = path.join(LOCK).is_file();
        let present = names(path, |name| FILES.contains(&name) || is_picture(name));
        let wrong = |what: String, help: &str| Error::input(Notice::new(what, help).within(path.display()));
        if let (false, Some(name)) = (known, present.first()) {
            return Err(wrong(
                format!("holds `{name}`, which no run of this program left there"),
                "give another folder with --out: files of others are not overwritten",
            ));
        }
        create_folder(path)?;
        let lock = path.join(LOCK);
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&lock);
        let mut file = file.map_err(|error| Error::file(&lock, "write", error))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut process = String::new();
                let _ = file.read_to_string(&mut process);
                return Err(wrong(
                    format!("another run (process {}) writes into this folder", process.trim()),
                    "wait for it, or give another folder with --out",
                ));
            }
            Err(TryLockError::Error(error)) => return Err(Error::file(&lock, "lock", error)),
        }
        // Under the lock: a run may just have ended here.
        let used = FILES.iter().any(|name| path.join(name).exists());
        if used && earlier == Earlier::Keep {
            return Err(wrong(
                "holds the results of an earlier run".to_owned(),
                "--overwrite replaces them, --out FOLDER writes elsewhere, --restart FILE goes on from a checkpoint",
            ));
        }
        let cut = file.set_len(0).and_then(|()| file.rewind());
        cut.and_then(|()| writeln!(file, "{}", std::process::id()))
            .map_err(|error| Error::file(&lock, "write", error))?;
        let folder = OutputFolder { path: path.to_path_buf(), used, _lock: file };
        folder.remove(path, |name| name.starts_with(TEMPORARY))?;
        folder.remove(&path.join("frames"), |name| name.starts_with(TEMPORARY))?;
        Ok(folder)
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether an earlier run is in it.
    pub fn is_used(&self) -> bool {
        self.used
    }

    /// Removes all files of an earlier run, but for its beds.
    ///
    /// # Errors
    /// One cannot be removed.
    pub fn clear(&self) -> Result<()> {
        self.remove(&self.path, |name| FILES.contains(&name) || is_picture(name))?;
        self.remove(&self.path.join("film"), |name| name.starts_with("frame-") && name.ends_with(".png"))?;
        self.remove(&self.path.join(ANALYSIS), |name| ANALYSES.contains(&name))?;
        self.remove(&self.path.join("frames"), is_frame)
    }

    /// Removes what shows the end of a run that goes on, and frames that its lists do not have.
    ///
    /// # Errors
    /// One cannot be removed.
    pub fn reopen(&self, kept: impl Fn(&str) -> bool) -> Result<()> {
        let shows_end =
            |name: &str| ["summary.json", "averages.csv", "temperature_fit.json", FAILED].contains(&name);
        self.remove(&self.path, |name| shows_end(name) || is_picture(name))?;
        self.remove(&self.path.join(ANALYSIS), |name| ANALYSES.contains(&name))?;
        self.remove(&self.path.join("frames"), |name| is_frame(name) && !kept(name))
    }

    fn remove(&self, folder: &Path, which: impl Fn(&str) -> bool) -> Result<()> {
        names(folder, which).into_iter().try_for_each(|name| {
            let file = folder.join(name);
            fs::remove_file(&file).map_err(|error| Error::file(&file, "remove", error))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_one_run_at_a_time_and_foreign_files_stay() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("notes.txt"), "mine").unwrap();
        let first = OutputFolder::take(folder.path(), Earlier::Keep).unwrap();
        assert!(!first.is_used());
        let error = OutputFolder::take(folder.path(), Earlier::Overwrite).unwrap_err();
        assert!(error.is_input() && error.to_string().contains(&std::process::id().to_string()), "{error}");
        ["frames", ANALYSIS].iter().for_each(|name| fs::create_dir(at(name)).unwrap());
        let of_run = [
            "series.csv",
            "snapshot-0.020s.png",
            "frames/grains-00000040.vtp",
            "frames/.voidage-x",
            "analysis/analysis.csv",
        ];
        let of_others = [
            "notes.txt",
            "packing-0.csv",
            "snapshot-1.txt",
            "frames/grains-a.vtp",
            "frames/mine",
            "analysis/mine.csv",
        ];
        of_run.iter().chain(&of_others).for_each(|name| fs::write(at(name), "").unwrap());
        drop(first);
        assert!(
            OutputFolder::take(folder.path(), Earlier::Keep).unwrap_err().to_string().contains("earlier run")
        );
        OutputFolder::take(folder.path(), Earlier::Overwrite).unwrap().clear().unwrap();
        assert!(
            of_run.iter().all(|name| !at(name).exists()) && of_others.iter().all(|name| at(name).exists())
        );
    }

    #[test]
    fn files_of_others_are_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("series.csv"), "a,b\n").unwrap();
        for earlier in [Earlier::Keep, Earlier::Overwrite, Earlier::Continue] {
            let error = OutputFolder::take(folder.path(), earlier).unwrap_err();
            assert!(error.is_input() && error.to_string().contains("series.csv"), "{error}");
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_run_that_goes_on_loses_what_showed_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        drop(OutputFolder::take(folder.path(), Earlier::Keep).unwrap());
        fs::create_dir(at("frames")).unwrap();
        let stale = ["summary.json", "averages.csv", "pressure.png", "frames/grains-00000040.vtp"];
        let kept = ["series.csv", CHECKPOINT, "frames/grains-00000020.vtp"];
        stale.iter().chain(&kept).for_each(|name| fs::write(at(name), "").unwrap());
        let again = OutputFolder::take(folder.path(), Earlier::Continue).unwrap();
        assert!(again.is_used());
        again.reopen(|name| name.contains("20")).unwrap();
        assert!(stale.iter().all(|name| !at(name).exists()) && kept.iter().all(|name| at(name).exists()));
    }
}
