//! Runs that go on from a checkpoint: in which folder, and by which command.

use crate::run::Options;
use std::path::{Path, PathBuf};
use voidage_coupling::{Error, Notice, Result};
use voidage_scene::recorder::{CHECKPOINT, Checkpoint, Earlier, OutputFolder};
use voidage_scene::{Change, Scene};

/// The folder of a checkpoint, where it holds a run of the same scene.
pub fn own_folder(checkpoint: &Path, hash: &str) -> Option<PathBuf> {
    let folder =
        checkpoint.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    holds(folder, hash).then(|| folder.to_path_buf())
}

/// Whether a folder has results of the scene of this hash.
fn holds(folder: &Path, hash: &str) -> bool {
    let there = Scene::read(&folder.join("scene.toml"), &[]).and_then(|scene| scene.hash());
    there.is_ok_and(|there| there == hash)
}

/// The command line that goes on from the checkpoint in a folder with the same options.
pub fn command(options: &Options, folder: &Path) -> String {
    let mut words =
        vec![options.scene.display().to_string(), "--out".to_owned(), folder.display().to_string()];
    let mut option = |name: &str, value: Option<String>| {
        words.extend(value.into_iter().flat_map(|value| [name.to_owned(), value]));
    };
    options.sets.iter().for_each(|set| option("--set", Some(set.clone())));
    option("--scheme", options.scheme.map(|scheme| scheme.name().to_owned()));
    option("--fluid", options.fluid.clone());
    option("--transport", options.process.transport.clone());
    option("--timeout", options.process.timeout.map(|seconds| seconds.to_string()));
    option("--ranks", options.process.ranks.map(|ranks| ranks.to_string()));
    option("--threads", options.threads.map(|threads| threads.to_string()));
    option("--restart", Some(folder.join(CHECKPOINT).display().to_string()));
    let plain = |c: char| c.is_alphanumeric() || "-_./=+,:@%".contains(c);
    let quoted = words.iter().map(|word| match word.chars().all(plain) && !word.is_empty() {
        true => word.clone(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    });
    format!("voidage run {}", quoted.collect::<Vec<_>>().join(" "))
}

/// The folder of a run that goes on from a checkpoint, and whether it is that of the run that wrote it.
pub fn folder(
    folder: &Path,
    file: &Path,
    checkpoint: &Checkpoint,
    changes: &[Change],
    overwrite: bool,
) -> Result<(OutputFolder, bool)> {
    let absolute = |path: &Path| path.canonicalize().ok();
    if overwrite && file.parent().and_then(absolute).is_some_and(|parent| Some(parent) == absolute(folder)) {
        let what = format!("--overwrite would remove the run that {} is of", file.display());
        return Err(Error::input(Notice::new(what, "give another folder with --out")));
    }
    let same = holds(folder, &checkpoint.stamp.scene_hash);
    if same && !changes.is_empty() && !overwrite {
        let what = format!(
            "{}: holds the run that the checkpoint is of, without the change `{}`",
            folder.display(),
            changes[0]
        );
        return Err(Error::input(Notice::new(
            what,
            "give another folder with --out: two runs in one would mix",
        )));
    }
    let earlier = match (overwrite, same) {
        (true, _) => Earlier::Overwrite,
        (false, true) => Earlier::Continue,
        (false, false) => Earlier::Keep,
    };
    Ok((OutputFolder::take(folder, earlier)?, earlier == Earlier::Continue))
}
