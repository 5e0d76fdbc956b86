//! Pictures of runs with a droplet, in the scales of Henry et al.: the diameter D at time zero, the time sqrt(D/g) of a
//! fall, the velocity sqrt(D g), the weight at time zero, and the heat of the gas in the first step that is recorded.

pub mod compare;
mod curves;
mod profiles;
mod sheet;

use self::curves::Run;
use super::film::film;
use super::hole::Track;
use super::snapshot::View;
use crate::results::Moment;
use crate::results::table::Table;
use std::path::{Path, PathBuf};
use voidage_coupling::Result;
use voidage_scene::Scene;

/// What pictures of a run with a droplet share: where it is, and the axes and colours of its moments.
pub struct Droplet {
    /// Where it is, if the series says so.
    pub track: Option<Track>,
    /// Axes and colours; none without moments.
    pub view: Option<View>,
}

impl Droplet {
    /// Of a run that left this series and these moments; none where the scene has no droplet.
    pub fn new(scene: &Scene, series: Option<&Table>, moments: &[Moment]) -> Result<Option<Droplet>> {
        if scene.droplet.is_none() {
            return Ok(None);
        }
        let track = series.and_then(Track::new);
        let view = View::over(moments, scene, track.as_ref(), 0.0)?;
        Ok(Some(Droplet { track, view }))
    }

    /// Draws all but the snapshots.
    pub fn draw(
        &self,
        folder: &Path,
        scene: &Scene,
        series: Option<&Table>,
        moments: &[Moment],
    ) -> Result<Vec<PathBuf>> {
        let mut drawn = Vec::new();
        if let Some(run) = series.and_then(|series| Run::new(scene, series)) {
            drawn.extend(curves::draw(folder, &run)?);
            drawn.extend(profiles::draw(folder, &run, self.track.as_ref(), moments)?);
        }
        if let Some(view) = &self.view {
            let look = (view, self.track.as_ref());
            let sheet = folder.join("digging.png");
            if sheet::sheet(&sheet, scene, moments, look)? {
                drawn.push(sheet);
                drawn.extend(film(folder, scene, moments, look)?);
            }
        }
        Ok(drawn)
    }
}
