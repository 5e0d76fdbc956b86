//! All moments of a run with the same axes and colours: a film.

use super::hole::Track;
use super::snapshot::{Picture, View, draw};
use crate::results::Moment;
use rayon::prelude::*;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use tracing::{info, warn};
use voidage_coupling::{Error, Result};
use voidage_scene::Scene;
use voidage_scene::recorder::create_folder;

/// Frames of the film in a second, and seconds that it lasts if that lies between these.
const RATE: [usize; 2] = [5, 25];
const LASTS: usize = 10;

/// Draws every moment into `film/`, and joins the pictures into `film.mp4` where there is an ffmpeg; what was made.
pub fn film(
    folder: &Path,
    scene: &Scene,
    moments: &[Moment],
    (view, track): (&View, Option<&Track>),
) -> Result<Vec<PathBuf>> {
    let frames = folder.join("film");
    create_folder(&frames)?;
    let path = |number: usize| frames.join(format!("frame-{number:05}.png"));
    moments.par_iter().enumerate().try_for_each(|(k, moment)| {
        let picture = Picture::read(moment, track)?;
        draw(&path(k + 1), scene, &picture, view)
    })?;
    // Those of an earlier run that lasted longer would be part of the film.
    let mut later = (moments.len() + 1..).map(path).take_while(|path| path.is_file());
    later.try_for_each(|path| fs::remove_file(&path).map_err(|error| Error::file(&path, "remove", error)))?;
    let mut made = vec![frames];
    made.extend(join(folder, moments.len())?);
    Ok(made)
}

/// Makes the film of so many frames, if ffmpeg can be started.
fn join(folder: &Path, count: usize) -> Result<Option<PathBuf>> {
    let (film, part) = (folder.join("film.mp4"), folder.join("film.part.mp4"));
    let rate = (count / LASTS).clamp(RATE[0], RATE[1]).to_string();
    let frames = folder.join("film").join("frame-%05d.png");
    let mut command = Command::new("ffmpeg");
    command.args(["-y", "-loglevel", "error", "-framerate", &rate, "-i"]).arg(&frames);
    // Players want even sides and this kind of colours.
    command.args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"]).arg(&part);
    match command.stdin(Stdio::null()).output() {
        Ok(output) if output.status.success() => {
            fs::rename(&part, &film).map_err(|error| Error::file(&film, "write", error))?;
            Ok(Some(film))
        }
        Ok(output) => {
            // Half a film is of no use; if it cannot be removed either, the warning says enough.
            let _ = fs::remove_file(&part);
            warn!("{}: ffmpeg: {}", film.display(), String::from_utf8_lossy(&output.stderr).trim());
            Ok(None)
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {
            info!(
                "no ffmpeg here to join the film; where there is one: ffmpeg -framerate {rate} -i {} -vf \
                 'pad=ceil(iw/2)*2:ceil(ih/2)*2' -pix_fmt yuv420p {}",
                frames.display(),
                film.display()
            );
            Ok(None)
        }
        Err(error) => {
            warn!("{}: ffmpeg: {error}", film.display());
            Ok(None)
        }
    }
}
