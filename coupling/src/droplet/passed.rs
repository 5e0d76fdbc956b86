//! The solid that passes the surface of a droplet.

use super::Droplet;
use super::wet::Wet;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use voidage_dem::Particles;
use voidage_fluid::Vector;

/// Solid volume (m2) that has passed the surface of a droplet since time zero, less what came back: what it took in
/// through the half that lies ahead of it when it falls, and what it threw out through the other. Their difference is
/// what it has more in it than at time zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Passed {
    /// In through the lower half.
    pub in_below: f64,
    /// Out through the upper half.
    pub out_above: f64,
}

impl<const D: usize> Droplet<D> {
    /// Counts the solid that has passed the surface since the grains were cut, with grains and droplet where they now
    /// are: `wet` has the shares of before.
    pub(crate) fn count_passed(&mut self, particles: &Particles<D>, wet: &Wet<D>) {
        let mut upright = Vector::zeros();
        upright[D - 1] = -1.0;
        let gravity = &self.material.gravity;
        let down = if gravity.norm() > 0.0 { gravity } else { &upright };
        let (centre, size) = (self.state.centre, self.state.radius);
        let changes = (0..particles.len()).into_par_iter().filter_map(|i| {
            let (radius, x) = (particles.radius[i], particles.position[i] - centre);
            let whole = std::f64::consts::PI * radius * radius;
            let now = self.surface.cut(size, &x, radius).map_or(0.0, |within| within.area / whole);
            let won = (now - wet.share(i)) * particles.volume[i];
            (won != 0.0).then_some((x.dot(down) > 0.0, won))
        });
        // Collected, so that the sums are the same for any number of threads.
        let changes: Vec<(bool, f64)> = changes.collect();
        let of =
            |half: bool| changes.iter().filter(|(below, _)| *below == half).map(|(_, won)| won).sum::<f64>();
        self.state.passed.in_below += of(true);
        self.state.passed.out_above -= of(false);
    }
}
