//! Overlaps of grains with each other and with walls.

use crate::{Scene, Wall};
use voidage_coupling::Error;
use voidage_dem::{Particles, Period, Vector};

/// Share of the radius by which a grain may overlap a wall or a grain of another group once all are placed: settling
/// leaves small penetrations, a wrong box much more.
const LEFT_BY_SETTLING: f64 = 0.25;

impl Scene {
    /// Checks that what a grain is spread over meets its image over periodic sides nowhere.
    pub(crate) fn check_kernel(&self, grains: &Particles<2>) -> Result<(), Error> {
        let kernel = self.coupling.as_ref().map_or(1.0, |coupling| coupling.kernel);
        let Some(periodic) = self.periodic.as_ref().filter(|_| kernel > 1.0) else { return Ok(()) };
        let to_come = self.grains.iter().filter_map(|group| Some(group.radius.as_ref()?.largest()));
        let radius = grains.radius.iter().copied().chain(to_come).fold(0.0, f64::max);
        for (_, name, [low, high]) in periodic.axes() {
            let most = (high - low) / (4.0 * radius);
            if kernel > most {
                let path = format!("`coupling.kernel = {kernel}`");
                let message = format!(
                    "{path}: the largest grain, of radius {radius} m, would be spread over more than half of \
                     `periodic.{name}`"
                );
                return Err(self.error(
                    "coupling.kernel",
                    message,
                    format!("at most {most:.3}, or a wider domain"),
                ));
            }
        }
        Ok(())
    }

    /// Checks that grains of different groups do not overlap once all have been placed, and that no wall cuts one
    /// (placement keeps the grains of a group apart). The error points at the group.
    pub(crate) fn check_apart(&self, grains: &Particles<2>) -> Result<(), Error> {
        let path = |grain: usize| format!("grains[{}].placement", grains.material[grain]);
        let number =
            |grain: usize| format!("at ({:.6}, {:.6})", grains.position[grain].x, grains.position[grain].y);
        let one_group = |a: usize, b: usize| grains.material[a] == grains.material[b];
        if let Some((a, b, overlap)) =
            overlapping((&grains.position, &grains.radius), &self.period(), LEFT_BY_SETTLING, one_group)
        {
            let message = format!(
                "`{}`: the grain {} overlaps that {} of `{}` by {overlap:.3e} m",
                path(b),
                number(b),
                number(a),
                path(a)
            );
            return Err(self.error(&path(b), message, "keep groups of grains apart"));
        }
        for (i, (at, radius)) in grains.position.iter().zip(&grains.radius).enumerate() {
            let cuts =
                |wall: &&Wall| distance_to_wall(wall, &self.period(), at) < radius * (1.0 - LEFT_BY_SETTLING);
            if let Some(wall) = self.walls.iter().find(cuts) {
                let message =
                    format!("`{}`: the grain {} overlaps the wall \"{}\"", path(i), number(i), wall.name);
                return Err(self.error(&path(i), message, "place grains off the walls"));
            }
        }
        Ok(())
    }
}

/// Two grains that overlap by more than a share of the smaller radius, the first before the second, and by how much;
/// pairs that are excused do not count. A sweep along x, in a periodic domain also over the images beyond its upper
/// sides.
pub(super) fn overlapping(
    (positions, radii): (&[Vector<2>], &[f64]),
    period: &Period<2>,
    share: f64,
    excused: impl Fn(usize, usize) -> bool,
) -> Option<(usize, usize, f64)> {
    let reach = radii.iter().copied().fold(0.0, f64::max);
    let mut order: Vec<(usize, Vector<2>)> = positions.iter().map(|x| period.wrap(*x)).enumerate().collect();
    for axis in 0..2 {
        let Some([low, high]) = period.sides()[axis] else { continue };
        let mut image = Vector::<2>::zeros();
        image[axis] = high - low;
        let beyond = |place: &Vector<2>| place[axis] - low < 2.0 * reach;
        let images: Vec<_> =
            order.iter().filter(|(_, x)| beyond(x)).map(|(grain, x)| (*grain, x + image)).collect();
        order.extend(images);
    }
    order.sort_by(|a, b| a.1.x.total_cmp(&b.1.x));
    for (k, &(a, place)) in order.iter().enumerate() {
        for &(b, other) in &order[k + 1..] {
            let between = other - place;
            if between.x > radii[a] + reach {
                break;
            }
            let overlap = radii[a] + radii[b] - between.norm();
            if a != b && overlap > share * radii[a].min(radii[b]) && !excused(a, b) {
                return Some((a.min(b), a.max(b), overlap));
            }
        }
    }
    None
}

pub(super) fn distance_to_wall(wall: &Wall, period: &Period<2>, place: &Vector<2>) -> f64 {
    let [ax, ay] = [wall.from.0[0], wall.from.0[1]];
    let [bx, by] = [wall.to.0[0] - ax, wall.to.0[1] - ay];
    let image = period.image(*place, &Vector::<2>::new(ax + 0.5 * bx, ay + 0.5 * by));
    let [x, y] = [image.x, image.y];
    let along = ((x - ax) * bx + (y - ay) * by) / (bx * bx + by * by);
    let along = along.clamp(0.0, 1.0);
    (x - ax - along * bx).hypot(y - ay - along * by)
}
