//! Meshes that move: the trait of what moves them, and a law of time that does.

use crate::{Coupled, Fluid, Mixture, Notice, StepReport, System};
use voidage_dem::Motion;
use voidage_fluid::harmonic::harmonic;
use voidage_fluid::mesh::Remeshed;
use voidage_fluid::{Error, Mesh, Result, Vector};

/// Share of its measure that a cell must keep in a step; where one would not, the domain is remeshed first.
pub(crate) const LEAST_MEASURE: f64 = 0.1;

/// A cell of a mesh whose nodes have moved that has kept less than a share of what it measured before, if there is one.
pub(crate) fn crushed<const D: usize>(mesh: &Mesh<D>, before: &[f64], share: f64) -> Option<usize> {
    let kept = |(cell, before): (usize, &f64)| mesh.measure(cell) > share * before;
    before.iter().enumerate().position(|cell| !kept(cell))
}

/// A place for people to read, m.
pub(crate) fn at<const D: usize>(place: &Vector<D>) -> String {
    let numbers: Vec<String> = place.iter().map(|x| format!("{x:.4e}")).collect();
    format!("({}) m", numbers.join(", "))
}

/// What moves the nodes of a mesh. Cells keep their nodes; where they come too far out of shape, a
/// [`Remesher`](crate::remesh::Remesher) makes others between the nodes of the boundary, which stay.
///
/// A step begins with [`Self::advance`]: equations are solved on the nodes where they then are, with the velocity that
/// brought them there, so that a fluid at rest stays at rest to rounding (the geometric conservation law).
pub trait MeshMover<const D: usize>: Send {
    /// Puts the nodes where they are at a time, s: at a restart.
    fn place(&self, time: f64, points: &mut [Vector<D>]);

    /// Moves the nodes by a step of `dt` from `time` (s), at which they are where [`Self::place`] puts them.
    fn advance(&mut self, time: f64, dt: f64, points: &mut [Vector<D>]);

    /// Mean velocity of the nodes over the step in hand, m/s.
    fn velocity(&self) -> &[Vector<D>];

    /// Goes on with a mesh that is new at a time, s.
    fn remeshed(&mut self, remeshed: &Remeshed<D>, time: f64);

    /// What [`Self::restore`] needs to go on after a remeshing as if the run had not stopped, bit for bit.
    fn state(&self) -> Vec<f64>;

    /// Takes back a [`Self::state`].
    fn restore(&mut self, state: &[f64]);
}

/// A mesh that oscillates: x(t) = x(0) + weight amplitude sin(2 pi frequency t), with a weight of each node between 0
/// and 1.
///
/// The weight is 1 on the part of the boundary that oscillates, 0 on the others, and harmonic between. Without such a
/// part only the inside of the mesh oscillates: then the weight solves -lap b = 1, scaled to a largest value of 1.
#[derive(Clone, Debug)]
pub struct Oscillation<const D: usize> {
    /// Places at the time of `origin`.
    rest: Vec<Vector<D>>,
    weight: Vec<f64>,
    amplitude: Vector<D>,
    /// 2 pi frequency, 1/s.
    rate: f64,
    /// sin(2 pi frequency t) when the mesh was made.
    origin: f64,
    /// Velocity of the nodes in the step in hand, m/s.
    velocity: Vec<Vector<D>>,
}

/// What a mesh that was made on the way follows from: origin, weights and places.
fn kept<const D: usize>(origin: f64, weight: &[f64], rest: &[Vector<D>]) -> Vec<f64> {
    let places = rest.iter().flat_map(|x| x.iter());
    std::iter::once(&origin).chain(weight).chain(places).copied().collect()
}

/// The same, taken back.
fn restored<const D: usize>(state: &[f64]) -> Option<(f64, Vec<f64>, Vec<Vector<D>>)> {
    let (origin, nodes) = state.split_first()?;
    let (weight, places) = nodes.split_at(nodes.len() / (D + 1));
    let places = places.chunks_exact(D).map(Vector::from_column_slice).collect();
    Some((*origin, weight.to_vec(), places))
}

/// Weight of each node: 1 on the part of the boundary that moves, 0 on the others, and between them that of
/// -lap b = `source`. On parts that slide the weight is as free as inside, with no slope across.
fn weights(mesh: &Mesh<2>, source: f64, moving: Option<&str>, sliding: &[String]) -> Result<Vec<f64>> {
    let mut held = vec![None; mesh.points.len()];
    let moving = moving.map(|name| mesh.boundary(name)).transpose()?;
    for part in mesh.boundaries.iter().filter(|part| !sliding.contains(&part.name)) {
        part.facets.iter().for_each(|&node| held[node as usize] = Some(0.0));
    }
    for &node in moving.iter().flat_map(|part| &part.facets) {
        held[node as usize] = Some(1.0);
    }
    harmonic::<2, 3>(mesh, source, |node| held[node])
}

impl Oscillation<2> {
    /// An oscillation of the mesh from where it is: `amplitude` in m, `frequency` in 1/s, `boundary` the part that
    /// moves.
    ///
    /// # Errors
    /// There is no such part.
    pub fn new(mesh: &Mesh<2>, amplitude: Vector<2>, frequency: f64, boundary: Option<&str>) -> Result<Self> {
        let source = if boundary.is_some() { 0.0 } else { 1.0 };
        let mut weight = weights(mesh, source, boundary, &[])?;
        let largest = weight.iter().copied().fold(0.0, f64::max);
        weight.iter_mut().for_each(|weight| *weight /= largest);
        let rate = 2.0 * std::f64::consts::PI * frequency;
        let rest = mesh.points.clone();
        Ok(Self { rest, weight, amplitude, rate, origin: 0.0, velocity: Vec::new() })
    }

    /// Whether one mesh can follow all of the oscillation. The nodes move along straight lines and each cell's measure
    /// is a square polynomial of sin(2 pi f t): where it is positive at both ends and at its least between them, it
    /// always is.
    ///
    /// # Errors
    /// A cell turns over on the way.
    pub fn check(&self, mesh: &Mesh<2>) -> Result<()> {
        let mut moved = mesh.clone();
        let mut measures = [-1.0, 0.0, 1.0].map(|sine| {
            self.put(sine, &mut moved.points);
            (0..mesh.cell_count()).map(|cell| moved.measure(cell)).collect::<Vec<_>>()
        });
        let [low, rest, high] = &mut measures;
        for cell in 0..mesh.cell_count() {
            let (linear, square) =
                ((high[cell] - low[cell]) / 2.0, (high[cell] + low[cell]) / 2.0 - rest[cell]);
            let turn = if square > 0.0 { (-linear / (2.0 * square)).clamp(-1.0, 1.0) } else { 1.0 };
            let least = (rest[cell] + turn * (linear + turn * square)).min(low[cell]).min(high[cell]);
            if least <= 0.0 {
                return Err(Error::Mesh(format!("cell {cell} at {:?} turns over on the way", {
                    let place = mesh.centroid(cell);
                    [place[0], place[1]]
                })));
            }
        }
        Ok(())
    }
}

impl<const D: usize> Oscillation<D> {
    fn put(&self, sine: f64, points: &mut [Vector<D>]) {
        for ((point, rest), weight) in points.iter_mut().zip(&self.rest).zip(&self.weight) {
            *point = rest + self.amplitude * (weight * (sine - self.origin));
        }
    }
}

impl<const D: usize> MeshMover<D> for Oscillation<D> {
    fn place(&self, time: f64, points: &mut [Vector<D>]) {
        self.put((self.rate * time).sin(), points);
    }

    fn advance(&mut self, time: f64, dt: f64, points: &mut [Vector<D>]) {
        let (from, to) = ((self.rate * time).sin(), (self.rate * (time + dt)).sin());
        self.put(to, points);
        let mean = self.amplitude * ((to - from) / dt);
        self.velocity.clear();
        self.velocity.extend(self.weight.iter().map(|weight| mean * *weight));
    }

    fn velocity(&self) -> &[Vector<D>] {
        &self.velocity
    }

    fn remeshed(&mut self, remeshed: &Remeshed<D>, time: f64) {
        self.rest.clone_from(&remeshed.mesh.points);
        self.weight = remeshed.carry(&self.weight);
        self.origin = (self.rate * time).sin();
    }

    fn state(&self) -> Vec<f64> {
        kept(self.origin, &self.weight, &self.rest)
    }

    fn restore(&mut self, state: &[f64]) {
        let Some(kept) = restored(state) else { return };
        (self.origin, self.weight, self.rest) = kept;
    }
}

/// A mesh of which a part of the boundary moves as a rigid body by a table, as a wall of the grains may: a piston, a
/// stirrer. x(t) = X + weight (m(t) - X), where m(t) is where the motion has brought what was at X; the weight is 1 on
/// that part, 0 on the others, and harmonic between.
#[derive(Clone, Debug)]
pub struct Follow {
    motion: Motion<2>,
    /// Places at the time of `origin`, s.
    rest: Vec<Vector<2>>,
    weight: Vec<f64>,
    origin: f64,
    /// Velocity of the nodes in the step in hand, m/s.
    velocity: Vec<Vector<2>>,
}

impl Follow {
    /// A mesh, as it is at time zero, whose part `boundary` moves by the rows of a [`Motion::Table`] with its `centre`;
    /// the nodes of the parts `sliding` go along these parts, which must be straight and parallel to the motion.
    ///
    /// # Errors
    /// There is no such part; a part that slides is not parallel to the motion, with the place where.
    pub fn new(
        mesh: &Mesh<2>,
        centre: Vector<2>,
        rows: Vec<[f64; 4]>,
        boundary: &str,
        sliding: &[String],
    ) -> Result<Self> {
        let weight = weights(mesh, 0.0, Some(boundary), sliding)?;
        let rest = mesh.points.clone();
        let times: Vec<f64> = rows.iter().map(|row| row[0]).collect();
        let motion = Motion::Table { centre, rows };
        for name in sliding {
            for facet in mesh.boundary(name)?.facets.chunks_exact(2) {
                let [a, b] = [facet[0], facet[1]].map(|node| rest[node as usize]);
                let across = |time: &f64| {
                    let [way, along] = [motion.carry(a, *time) - a, b - a];
                    (way.x * along.y - way.y * along.x).abs() > 1e-9 * way.norm() * along.norm()
                };
                if times.iter().any(across) {
                    let message = format!("the motion leaves the part {name:?} at {}", at(&a));
                    return Err(Error::Mesh(message));
                }
            }
        }
        Ok(Self { motion, rest, weight, origin: 0.0, velocity: Vec::new() })
    }
}

impl MeshMover<2> for Follow {
    fn place(&self, time: f64, points: &mut [Vector<2>]) {
        // There and back by the motion is not exact, and a run that goes on from here must be.
        if time == self.origin {
            return points.copy_from_slice(&self.rest);
        }
        for ((point, rest), weight) in points.iter_mut().zip(&self.rest).zip(&self.weight) {
            let carried = self.motion.carry(self.motion.uncarry(*rest, self.origin), time);
            *point = rest + (carried - rest) * *weight;
        }
    }

    fn advance(&mut self, time: f64, dt: f64, points: &mut [Vector<2>]) {
        let before = points.to_vec();
        self.place(time + dt, points);
        self.velocity.clear();
        self.velocity.extend(points.iter().zip(&before).map(|(now, before)| (now - before) / dt));
    }

    fn velocity(&self) -> &[Vector<2>] {
        &self.velocity
    }

    fn remeshed(&mut self, remeshed: &Remeshed<2>, time: f64) {
        self.rest.clone_from(&remeshed.mesh.points);
        self.weight = remeshed.carry(&self.weight);
        self.origin = time;
    }

    fn state(&self) -> Vec<f64> {
        kept(self.origin, &self.weight, &self.rest)
    }

    fn restore(&mut self, state: &[f64]) {
        let Some(kept) = restored(state) else { return };
        (self.origin, self.weight, self.rest) = kept;
    }
}

impl<const D: usize> Fluid<D> {
    /// Moves the nodes of a mesh that moves; what was computed of their places follows. Returns whether it moves.
    pub(crate) fn move_mesh(
        &mut self,
        move_nodes: impl FnOnce(&mut dyn MeshMover<D>, f64, &mut [Vector<D>]),
    ) -> bool {
        let Some(motion) = &mut self.motion else { return false };
        move_nodes(&mut **motion, self.clock.time, &mut self.mesh.points);
        self.nodal_volume = self.mesh.nodal_volume();
        self.moved = true;
        true
    }
}

impl<const D: usize> Mixture<D> {
    /// Moves the nodes of a mesh that moves, under the grains.
    pub(crate) fn move_mesh(
        &mut self,
        move_nodes: impl FnOnce(&mut dyn MeshMover<D>, f64, &mut [Vector<D>]),
    ) {
        if self.fluid.move_mesh(move_nodes) {
            self.interaction.overlap.moved(&self.fluid.mesh);
        }
    }
}

impl<const D: usize> Coupled<D> {
    /// Puts a mesh that moves where it is now, after time was set.
    pub fn place_mesh(&mut self) {
        self.move_mesh(|motion, time, points| motion.place(time, points));
    }

    /// Moves the nodes by a step of `dt`; where a cell would turn over on the way, or nearly, the domain is remeshed
    /// before.
    ///
    /// # Errors
    /// A cell turns over also of a new mesh; the nodes are where they were.
    pub(crate) fn advance_mesh(&mut self, dt: f64, report: &mut StepReport) -> crate::Result<()> {
        let Some(before) = self.fluid().filter(|fluid| fluid.motion.is_some()) else { return Ok(()) };
        let (renews, before) = (before.remesher.is_some(), before.mesh.measures());
        self.move_mesh(|motion, time, points| motion.advance(time, dt, points));
        let crushed_by = |coupled: &Self, before: &[f64], share: f64| {
            coupled.fluid().and_then(|fluid| crushed(&fluid.mesh, before, share))
        };
        // One mesh may do for a motion in which its cells become thin.
        let found = crushed_by(self, &before, if renews { LEAST_MEASURE } else { 0.0 });
        if found.is_none() {
            return Ok(());
        }
        self.place_mesh();
        match &mut self.system {
            System::Grains(..) => {}
            System::Fluid(fluid) => fluid.renew(report)?,
            System::Mixture(mixture) => mixture.renew(report)?,
        }
        let before = self.fluid().map_or_else(Vec::new, |fluid| fluid.mesh.measures());
        self.move_mesh(|motion, time, points| motion.advance(time, dt, points));
        let Some(cell) = crushed_by(self, &before, 0.0) else { return Ok(()) };
        self.place_mesh();
        let place = self.fluid().map_or_else(Vector::zeros, |fluid| fluid.mesh.centroid(cell));
        Err(crate::Error::run(Notice::new(
            format!("the mesh moves so far in {dt:.3e} s that its cell at {} would turn over", at(&place)),
            "give a smaller time.step, or a slower motion; fluid.mesh_motion.remesh makes new meshes between the steps",
        )))
    }

    /// Moves the nodes. Schemes find the mesh where it is at the end of the step.
    pub(crate) fn move_mesh(
        &mut self,
        move_nodes: impl FnOnce(&mut dyn MeshMover<D>, f64, &mut [Vector<D>]),
    ) {
        match &mut self.system {
            System::Grains(..) => {}
            System::Fluid(fluid) => drop(fluid.move_mesh(move_nodes)),
            System::Mixture(mixture) => mixture.move_mesh(move_nodes),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use voidage_fluid::mesh::{Rectangle, Side, Sides};

    /// A rod that goes aside and turns: its nodes are where the law takes them, also from a mesh that is made on the way.
    #[test]
    fn a_part_of_the_boundary_follows_its_law_across_a_remeshing() {
        let rows = vec![[0.0; 4], [1.0, 0.1, -0.05, 0.7]];
        let centre = Vector::<2>::new(0.5, 0.5);
        let law = Motion::Table { centre, rows: rows.clone() };
        let mesh = mesh();
        let mut follow = Follow::new(&mesh, centre, rows.clone(), "lid", &[]).expect("a lid");
        let lid = mesh.boundary("lid").expect("a lid").facets.clone();
        let mut points = mesh.points.clone();
        follow.advance(0.0, 0.4, &mut points);
        let on_lid = |points: &[Vector<2>], time: f64| {
            for node in &lid {
                let exact = law.carry(mesh.points[*node as usize], time);
                assert!((points[*node as usize] - exact).norm() < 1e-15, "{:?}", points[*node as usize]);
            }
        };
        on_lid(&points, 0.4);
        // The same nodes as those of a new mesh, from a state that is read back.
        (follow.rest, follow.origin) = (points.clone(), 0.4);
        let state = follow.state();
        let mut again = Follow::new(&mesh, centre, rows, "lid", &[]).expect("a lid");
        again.restore(&state);
        again.place(0.9, &mut points);
        on_lid(&points, 0.9);
        let wall = mesh.boundary("wall").expect("walls");
        let held = wall.facets.iter().filter(|node| !lid.contains(node));
        held.for_each(|node| assert!((points[*node as usize] - mesh.points[*node as usize]).norm() == 0.0));
    }

    fn mesh() -> Mesh<2> {
        let [left, right, bottom, top] = ["wall", "wall", "wall", "lid"].map(Side::named);
        Mesh::rectangle(&Rectangle {
            lower: [0.0; 2],
            upper: [1.0, 1.0],
            size: Some(0.1),
            sides: Sides { left, right, bottom, top },
            holes: vec![],
            refine: vec![],
            structured: None,
        })
        .expect("a valid rectangle")
    }

    #[test]
    fn nodes_oscillate_between_a_wall_that_moves_and_walls_that_stand() {
        let mut mesh = mesh();
        let rest = mesh.points.clone();
        let amplitude = Vector::<2>::new(0.0, 0.05);
        let mut oscillation = Oscillation::new(&mesh, amplitude, 0.25, Some("lid")).expect("a boundary");
        oscillation.advance(0.0, 1.0, &mut mesh.points);
        for (node, (now, then)) in mesh.points.iter().zip(&rest).enumerate() {
            let moved = now - then;
            assert!(
                (moved - oscillation.velocity[node]).norm() < 1e-15,
                "a quarter of a period in one second"
            );
            assert!(moved[0] == 0.0 && (-1e-15..=0.05 + 1e-15).contains(&moved[1]), "{moved}");
            if then[1] == 1.0 {
                assert!((moved - amplitude).norm() < 1e-14);
            } else if then[0] == 0.0 || then[1] == 0.0 || then[0] == 1.0 {
                assert_eq!(moved.norm(), 0.0);
            }
        }
        oscillation.place(0.0, &mut mesh.points);
        assert_eq!(mesh.points, rest);
        let mut other = Oscillation { rest: vec![], weight: vec![], origin: 1.0, ..oscillation.clone() };
        other.restore(&oscillation.state());
        assert_eq!((&other.rest, &other.weight, other.origin), (&rest, &oscillation.weight, 0.0));
    }

    #[test]
    fn the_inside_oscillates_alone_and_no_cell_may_turn_over() {
        let mesh = mesh();
        let amplitude = Vector::<2>::new(0.05, 0.02);
        let oscillation = Oscillation::new(&mesh, amplitude, 1.0, None).expect("an oscillation");
        oscillation.check(&mesh).expect("a gentle oscillation");
        assert_eq!(oscillation.weight.iter().copied().fold(0.0, f64::max), 1.0);
        assert!(
            mesh.boundaries.iter().flat_map(|p| &p.facets).all(|&n| oscillation.weight[n as usize] == 0.0)
        );
        let far = Oscillation::new(&mesh, amplitude * 20.0, 1.0, None).expect("an oscillation");
        let error = far.check(&mesh).expect_err("too far");
        assert!(error.to_string().contains("turns over"), "{error}");
        assert!(Oscillation::new(&mesh, amplitude, 1.0, Some("door")).is_err());
    }
}
