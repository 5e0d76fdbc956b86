//! Solid volume that comes into the mesh or goes out of it otherwise than by moving within it: grains that sources and
//! sinks put in and take out, and grains that cross an open boundary.
//!
//! With phi + eps = 1, d(phi)/dt + div(phi v) = S and d(eps)/dt + div(eps u) = 0 the equation of mass is div(eps u +
//! phi v) = S. Where a boundary cuts a grain, S is the change of the nodal solid fraction since the last accepted
//! solution, over the time of this one.
//!
//! A grain that is put in or taken out does so in no time, but the fluid cannot: its velocity would grow without bound
//! as steps become shorter. It makes room, or fills it, evenly over the time in which the grain would have come through
//! an opening. What it has not yet done is pending. So the volume that leaves through the boundary is, to the residual of
//! the linear solver, the change of the voidage that the fluid sees, less that of what is pending.

use crate::leaving::nearest_part;
use crate::overlap::{self, Overlap};
use crate::{Mixture, Result};
use serde::{Deserialize, Serialize};
use voidage_dem::Particles;
use voidage_fluid::conditions::FlowCondition;
use voidage_fluid::{Mesh, Vector};

/// A grain that was put in or taken out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Change<const D: usize> {
    place: Vector<D>,
    radius: f64,
    /// By how much the solid volume in the mesh has grown, less what the fluid has made room for, m3 (m2 in the plane).
    volume: f64,
    /// Time that the fluid still has to make room for it, s; zero: until its next solution.
    #[serde(default)]
    time: f64,
}

impl<const D: usize> Change<D> {
    /// What the fluid makes room for within `dt` seconds, m3 (m2 in the plane).
    fn within(&self, dt: f64) -> f64 {
        // Times are sums of steps.
        if self.time > dt * (1.0 + 1e-9) { self.volume * (dt / self.time) } else { self.volume }
    }
}

/// Time in which a grain goes by its own diameter, by its velocity or as it falls, s; zero if it does neither.
fn passage<const D: usize>(radius: f64, velocity: &Vector<D>, gravity: &Vector<D>) -> f64 {
    let diameter = 2.0 * radius;
    let speed = velocity.norm().max((gravity.norm() * diameter).sqrt());
    if speed > 0.0 { diameter / speed } else { 0.0 }
}

/// A grain of which a part lies in the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Cut {
    /// Its number for life.
    id: u32,
    /// Its volume in the mesh, m3 (m2 in the plane).
    volume: f64,
    /// Whether an open boundary cuts it.
    open: bool,
}

/// What came and went since the last accepted solution of the fluid.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Appearing<const D: usize> {
    /// Grains that were put in or taken out, and for which the fluid has not yet made all room.
    changes: Vec<Change<D>>,
    /// Grains that were cut then, in the order of their numbers. None before the first.
    cut: Option<Vec<Cut>>,
    /// The same now.
    #[serde(skip)]
    now: Vec<Cut>,
    /// What an open boundary has cut since then.
    #[serde(skip)]
    crossing: Vec<Change<D>>,
    /// What the fluid makes room for in its last solution, by node, m3; empty if there is nothing.
    #[serde(skip)]
    nodal: Vec<f64>,
}

impl<const D: usize> Appearing<D> {
    /// Solid volume for which the fluid made room in its last solution, less that which it filled, m3 (m2 in the plane).
    pub fn volume(&self) -> f64 {
        self.nodal.iter().sum()
    }

    /// Solid volume that is in the mesh and for which the fluid has not yet made room, m3 (m2 in the plane).
    pub fn pending(&self) -> f64 {
        self.changes.iter().map(|change| change.volume).sum()
    }

    /// The source of the equation of mass over `dt`, 1/s at the nodes; none if nothing came or went.
    pub(crate) fn source(
        &mut self,
        dt: f64,
        (mesh, nodal_volume): (&Mesh<D>, &[f64]),
        overlap: &mut Overlap<D>,
    ) -> Result<Option<Vec<f64>>> {
        let all = self.changes.iter().chain(&self.crossing);
        let now: Vec<Change<D>> = all.map(|change| Change { volume: change.within(dt), ..*change }).collect();
        self.nodal.clear();
        if now.is_empty() {
            return Ok(None);
        }
        spread((mesh, overlap), &now, &mut self.nodal)?;
        let density = |(volume, whole): (&f64, &f64)| volume / whole / dt;
        let mut source = self.nodal.iter().zip(nodal_volume).map(density).collect::<Vec<f64>>();
        mesh.periodic.mirror(&mut source);
        Ok(Some(source))
    }

    /// The fluid has been told what happens within `dt`.
    pub(crate) fn settle(&mut self, dt: f64) {
        for change in &mut self.changes {
            change.volume -= change.within(dt);
            change.time -= dt;
        }
        self.changes.retain(|change| change.volume != 0.0);
        self.crossing.clear();
        self.nodal.clear();
        self.cut.get_or_insert_default().clone_from(&self.now);
    }

    /// A grain of this number was taken out, of which a volume was in the mesh.
    fn gone(&mut self, id: u32, change: Change<D>) {
        self.cut.iter_mut().for_each(|cut| cut.retain(|cut| cut.id != id));
        if change.volume != 0.0 {
            self.changes.push(change);
        }
    }
}

/// Shares of a volume at the nodes near a disc: by its pieces, or at the nearest node where it has none.
fn spread<const D: usize>(
    (mesh, overlap): (&Mesh<D>, &mut Overlap<D>),
    changes: &[Change<D>],
    nodal: &mut Vec<f64>,
) -> Result<()> {
    let places: Vec<Vector<D>> = changes.iter().map(|change| change.place).collect();
    let radii: Vec<f64> = changes.iter().map(|change| change.radius).collect();
    let volumes: Vec<f64> = changes.iter().map(|change| change.volume).collect();
    let pieces = overlap.pieces_of(mesh, &places, &radii)?.0;
    overlap::spread(mesh, &pieces, &volumes, nodal);
    for (k, change) in changes.iter().enumerate().filter(|(k, _)| pieces.of(*k).is_empty()) {
        let far = |node: &usize| (mesh.points[*node] - change.place).norm_squared();
        let nearest = (0..mesh.points.len()).min_by(|a, b| far(a).total_cmp(&far(b)));
        nearest.into_iter().for_each(|node| nodal[mesh.periodic.master(node as u32) as usize] += volumes[k]);
    }
    Ok(())
}

impl<const D: usize> Mixture<D> {
    /// Adds grains of a source, between two steps. They lie wholly in the mesh.
    ///
    /// # Errors
    /// One does not; values that no grain may have.
    pub fn add(&mut self, source: &str, grains: Particles<D>) -> Result<()> {
        let mesh = &self.fluid.mesh;
        let (pieces, inside) = self.interaction.overlap.pieces_of(mesh, &grains.position, &grains.radius)?;
        if let Some(grain) = inside.iter().position(|share| *share < 1.0 - 1e-9) {
            return Err(self.outside_of_mesh(source, &grains.position[grain], grains.radius[grain]));
        }
        let gravity = self.grains.settings().gravity;
        let changes = (0..grains.len()).map(|i| Change {
            place: grains.position[i],
            radius: grains.radius[i],
            volume: grains.volume[i],
            time: passage(grains.radius[i], &grains.velocity[i], &gravity),
        });
        self.interaction.appearing.changes.extend(changes);
        self.interaction.extend(&pieces, &self.fluid.on_mesh(), &grains.volume);
        Ok(self.grains.add(grains)?)
    }

    /// Books grains that are no longer there at the end of a step, those that are not kept. Those that the last cut
    /// found outside have left little by little.
    pub(crate) fn book_gone(&mut self, keep: &[bool]) {
        let gravity = self.grains.settings().gravity;
        let outside: Vec<bool> = (0..keep.len()).map(|i| self.is_outside(i)).collect();
        let (particles, interaction) = (&self.grains.particles, &mut self.interaction);
        for i in (0..keep.len()).filter(|i| !keep[*i]) {
            let (radius, velocity) = (particles.radius[i], &particles.velocity[i]);
            let change = Change {
                place: particles.position[i],
                radius,
                volume: -interaction.load.volume[i],
                time: if outside[i] { 0.0 } else { passage(radius, velocity, &gravity) },
            };
            interaction.appearing.gone(particles.id[i], change);
        }
    }

    /// Finds what came and went since the last accepted solution, with the grains that have just been cut.
    pub(crate) fn find_appearing(&mut self) {
        self.find_cut();
        let Self { grains, interaction, .. } = self;
        let crate::Interaction { appearing, load, .. } = interaction;
        let particles = &grains.particles;
        let place_of = |id: u32| particles.id.binary_search(&id).ok();
        appearing.crossing.clear();
        // What an open boundary cuts now was cut then, if not by an open one then by one that has opened, or was whole;
        // what one cut then and none cuts now is whole, or had gone when it was last cut.
        let (known, then) = (appearing.cut.is_some(), appearing.cut.as_deref().unwrap_or_default());
        let before = |id: u32| then.binary_search_by_key(&id, |cut| cut.id).ok().map(|k| then[k]);
        let new = appearing.now.iter().filter(|cut| known && cut.open);
        let new = new.filter(|cut| before(cut.id).is_none_or(|then| !then.open));
        for id in then.iter().filter(|cut| cut.open).chain(new).map(|cut| cut.id) {
            let Some(i) = place_of(id) else { continue };
            let volume = load.volume[i] - before(id).map_or(particles.volume[i], |cut| cut.volume);
            if volume != 0.0 {
                let (place, radius) = (particles.position[i], particles.radius[i]);
                appearing.crossing.push(Change { place, radius, volume, time: 0.0 });
            }
        }
    }

    /// Finds the grains that are cut.
    fn find_cut(&mut self) {
        let Self { grains, fluid, interaction, .. } = self;
        let (particles, volume) = (&grains.particles, &interaction.load.volume);
        let now = &mut interaction.appearing.now;
        now.clear();
        let open = |name: &str| {
            let of = fluid.conditions.iter().find(|condition| condition.boundary == name);
            of.is_some_and(|condition| matches!(condition.flow, FlowCondition::Open { .. }))
        };
        let mut boxes: Option<Vec<[Vector<D>; 2]>> = None;
        let gone = interaction.overlap.outside();
        for i in 0..particles.len() {
            if volume[i] >= particles.volume[i] * (1.0 - 1e-12) {
                continue;
            }
            let left = volume[i] == 0.0 && gone.binary_search(&(i as u32)).is_ok();
            // A wall of the fluid cuts many grains a little: most are told by where the open parts are.
            let boxes = boxes.get_or_insert_with(|| {
                let parts = fluid.mesh.boundaries.iter().filter(|part| open(&part.name));
                parts.filter_map(|part| bounds(&fluid.mesh, &part.facets)).collect()
            });
            let (x, r) = (&particles.position[i], particles.radius[i]);
            let near =
                |[low, high]: &[Vector<D>; 2]| (0..D).all(|a| x[a] + r >= low[a] && x[a] - r <= high[a]);
            let nearest =
                || nearest_part(&fluid.mesh, x).map(|part| fluid.mesh.boundaries[part].name.as_str());
            let open = (left || (volume[i] > 0.0 && boxes.iter().any(near))) && nearest().is_some_and(open);
            now.push(Cut { id: particles.id[i], volume: volume[i], open });
        }
    }
}

/// The corners of the box around facets.
fn bounds<const D: usize>(mesh: &Mesh<D>, facets: &[u32]) -> Option<[Vector<D>; 2]> {
    let first = mesh.points[*facets.first()? as usize];
    let points = facets.iter().map(|node| &mesh.points[*node as usize]);
    Some(points.fold([first, first], |[low, high], x| [low.inf(x), high.sup(x)]))
}
