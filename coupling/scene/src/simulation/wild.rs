//! A fluid that is faster than all that drives it could make it: the solution is wrong, however well it is solved.

use super::Simulation;
use crate::{Flow, Fluid, Scene};
use voidage_coupling::error::{Error, Notice, Result};
use voidage_fluid::{Mesh, Vector};

/// Speeds over what drives the fluid that are out of all proportion.
const WILD: f64 = 100.0;

/// What drives the fluid of a scene, from the keys.
pub(super) struct Drive {
    /// Speed that gravity and pressures give over the extent of the mesh, and that of the start, m/s.
    speed: f64,
    /// Acceleration that acts all the time, m/s2.
    acceleration: f64,
    /// What flows through boundaries, m2/s: all of it may pass between two nodes.
    inflow: f64,
    /// Shortest edge, m.
    edge: f64,
    /// The most that all together have given so far, m/s: what they have set in motion goes on without them.
    most: f64,
}

impl Drive {
    pub fn of(scene: &Scene, mesh: Option<&Mesh<2>>) -> Option<Self> {
        let (fluid, mesh) = (scene.fluid.as_ref()?, mesh?);
        let (lower, upper) = mesh.bounds();
        let body = fluid.body_force.as_ref().map_or(0.0, |force| force.vector::<2>().norm());
        let head = scene.gravity.vector::<2>().norm() * (upper - lower).norm();
        let pressures = || {
            fluid.boundaries.iter().filter_map(|boundary| match boundary.flow {
                Flow::Open { pressure } => Some(pressure),
                _ => None,
            })
        };
        let [low, high] = [f64::min, f64::max].map(|choose| pressures().reduce(choose).unwrap_or(0.0));
        let start = fluid.initial_velocity.as_ref().map_or(0.0, |velocity| velocity.vector::<2>().norm());
        Some(Self {
            speed: start + (2.0 * (head + (high - low) / fluid.density)).sqrt(),
            acceleration: body,
            inflow: inflow(fluid, mesh),
            edge: shortest_edge(mesh),
            most: 0.0,
        })
    }
}

/// What flows through the boundaries at most, m2/s.
fn inflow(fluid: &Fluid, mesh: &Mesh<2>) -> f64 {
    let through = fluid.boundaries.iter().map(|boundary| {
        let (Flow::Velocity(velocity) | Flow::SuperficialVelocity(velocity)) = &boundary.flow else {
            return 0.0;
        };
        let length = mesh.boundary(&boundary.name).map_or(0.0, |part| part.measure(mesh));
        let factor = boundary.schedule.iter().fold(0.0_f64, |most, row| most.max(row[1].abs()));
        let factor = if boundary.schedule.is_empty() { 1.0 } else { factor };
        velocity.vector::<2>().norm() * length * factor
    });
    through.sum()
}

fn shortest_edge(mesh: &Mesh<2>) -> f64 {
    let edges = mesh.cells.chunks_exact(3).flat_map(|cell| {
        [0, 1, 2].map(|k| (mesh.points[cell[k] as usize] - mesh.points[cell[(k + 1) % 3] as usize]).norm())
    });
    edges.fold(f64::INFINITY, f64::min)
}

impl Simulation {
    /// The scene has changed: what drove the fluid before counts on.
    pub(super) fn drive_by(&mut self, scene: &Scene) {
        let most = self.drive.as_ref().map_or(0.0, |drive| drive.most);
        let mesh = self.coupled.fluid().map(|fluid| &fluid.mesh);
        self.drive = Drive::of(scene, mesh).map(|drive| Drive { most, ..drive });
    }

    /// The fluid is as fast as it is where a run goes on.
    pub(super) fn drive_from_here(&mut self) {
        let fastest = self.fastest_fluid().map_or(0.0, |(_, fastest)| fastest);
        self.drive.iter_mut().for_each(|drive| drive.most = fastest);
    }

    /// The node at which the fluid is fastest, and its speed there, m/s.
    fn fastest_fluid(&self) -> Option<(usize, f64)> {
        let speeds = self.coupled.fluid()?.accepted.velocity.iter().map(Vector::norm);
        speeds.enumerate().reduce(|most, now| if now.1 > most.1 { now } else { most })
    }

    /// Whether the fluid is no faster than what drives it could make it: gravity, pressures, what flows in, grains, walls
    /// and the mesh, now or earlier.
    ///
    /// # Errors
    /// It is: where, and how fast.
    pub(super) fn check_speed(&mut self) -> Result<()> {
        let Some((node, fastest)) = self.fastest_fluid() else { return Ok(()) };
        let moved = self.moved();
        let (time, room) = (self.time(), self.room());
        let (Some(drive), Some(fluid)) = (&mut self.drive, self.coupled.fluid()) else { return Ok(()) };
        let given = drive.speed + drive.acceleration * time + (drive.inflow + room) / drive.edge + moved;
        drive.most = drive.most.max(given);
        // A droplet boils by the heat that its grains give, and its vapour may be as fast as it likes.
        if fluid.droplet.as_ref().is_some_and(|droplet| !droplet.state.gone) {
            drive.most = drive.most.max(fastest);
            return Ok(());
        }
        if fastest <= WILD * drive.most {
            return Ok(());
        }
        let [x, y] = [0, 1].map(|axis| fluid.mesh.points[node][axis]);
        Err(Error::run(Notice::new(
            format!(
                "the fluid has {fastest:.3e} m/s at ({x:.4e}, {y:.4e}), and all that drives it (gravity, pressures, what \
                 flows in, grains, walls) would give it {:.3e} m/s",
                drive.most
            ),
            "the step may be too long, elements far smaller than solid grains (see coupling.kernel and solidity), or a \
             fluid solver wrong: frames and the last checkpoint show where it began",
        )))
    }

    /// What flows where grains come or go by sources and sinks, m2/s: the fluid makes room for one within a step.
    fn room(&self) -> f64 {
        let (Some(_), Some(grains)) = (&self.coupled.passage, self.coupled.grains()) else { return 0.0 };
        let largest = grains.particles.radius.iter().copied().fold(0.0, f64::max);
        std::f64::consts::PI * largest * largest / self.last_length()
    }

    /// Speed of the fastest grain, wall or node of the mesh in the last step, m/s.
    fn moved(&self) -> f64 {
        let length = self.last_length();
        let [before, now] = [self.time() - length, self.time()];
        let walls = self.coupled.grains().map_or(&[][..], |grains| grains.walls());
        let walls = walls.iter().filter(|wall| wall.moves()).flat_map(|wall| {
            let ends = wall.at(before).into_iter().zip(wall.at(now));
            ends.map(|(from, to)| (to - from).norm() / length)
        });
        let mesh = self.coupled.fluid().and_then(|fluid| fluid.mesh_velocity()).unwrap_or(&[]);
        walls.chain(mesh.iter().map(Vector::norm)).fold(self.fastest(), f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: &str = r#"
gravity = [0.0, 0.0]
time = { step = 1e-2, end = 1.0 }
[fluid]
density = 1.0
viscosity = 1e-2
boundaries = [{ name = "in", flow = { superficial_velocity = [1.0, 0.0] } }, { name = "out", flow = "open" },
    { name = "side", flow = "slip" }]
mesh.rectangle = { lower = [0.0, 0.0], upper = [1.0, 1.0], size = 0.25, sides = { left = "in", right = "out", top = "side", bottom = "side" } }
"#;

    /// A fluid of 1e27 m/s was the result of a run that said "done".
    #[test]
    fn a_fluid_that_is_faster_than_what_drives_it_ends_the_run() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.toml");
        std::fs::write(&file, BOX).unwrap();
        let scene = Scene::read(&file, &[]).unwrap();
        let mut simulation = Simulation::new(&scene).unwrap();
        simulation.step().unwrap();
        assert!(simulation.check_speed().is_ok());
        if let Some(fluid) = simulation.coupled_mut().fluid_mut() {
            fluid.accepted.velocity[3] = Vector::<2>::new(0.0, 1e27);
        }
        let said = simulation.check_speed().unwrap_err().notice().what;
        assert!(said.contains("1.000e27 m/s at (") && said.contains("would give it"), "{said}");
    }

    /// What has set the fluid in motion may stop, or begin to.
    #[test]
    fn a_stream_that_is_turned_off_or_up_is_no_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.toml");
        std::fs::write(&file, BOX).unwrap();
        for inflow in ["1e-9", "1e6"] {
            let set = format!("\"fluid.boundaries.in.flow.superficial_velocity=[{inflow}, 0.0]\"");
            let events = format!("events=[{{time=0.1,set=[{set}]}}]");
            let scene = Scene::read(&file, &[events, "time.end=0.2".into()]).unwrap();
            let mut simulation = Simulation::new(&scene).unwrap();
            for _ in 0..20 {
                simulation.step().unwrap();
            }
        }
    }

    /// In a fluid at rest nothing else drives it than the grain that comes.
    #[test]
    fn a_grain_that_comes_is_no_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.toml");
        let grains = r#"
[materials.m]
density = 2500.0
[[grains]]
material = "m"
radius = 0.02
placement = { source = { name = "feed", lower = [0.3, 0.3], upper = [0.7, 0.7], rate = { grains = 20.0 } } }
[coupling]
scheme = "iterated"
"#;
        std::fs::write(&file, format!("{BOX}{grains}").replace("[1.0, 0.0] } }", "[0.0, 0.0] } }")).unwrap();
        let scene = Scene::read(&file, &[]).unwrap();
        let mut simulation = Simulation::new(&scene).unwrap();
        for _ in 0..20 {
            simulation.step().unwrap();
            simulation.check_speed().unwrap();
        }
        assert!(simulation.coupled.grains().is_some_and(|grains| grains.particles.len() > 1));
    }
}
