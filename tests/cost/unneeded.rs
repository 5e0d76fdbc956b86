//! What a scene does not need is not there: columns, allocations, calls, phases, bytes on the wire.

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use voidage_coupling::Result;
use voidage_coupling::backend::{FluidBackend, FluidStep, Solution};
use voidage_coupling::remesh::Remesh;
use voidage_coupling::scheme::SchemeName;
use voidage_fluid::flow::State;
use voidage_fluid::mesh::Mesh;
use voidage_remote::protocol::StepMessage;
use voidage_scene::{Cohesion, Conduction, Coordinates, MeshMotion, ThinCell};
use voidage_scene::{Scene, Simulation};

struct Counting;

static BYTES: AtomicUsize = AtomicUsize::new(0);
static CALLS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: hands every request to the system's allocator unchanged and only counts.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        BYTES.fetch_add(layout.size(), Ordering::Relaxed);
        CALLS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's contract is the system's.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        BYTES.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's contract is the system's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

fn scene(case: &str, sets: &[&str]) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases").join(case);
    let sets: Vec<String> = sets.iter().map(|set| set.to_string()).collect();
    Scene::read(&path, &sets).unwrap_or_else(|error| panic!("{error}"))
}

/// The quick bed on a lattice, small.
const SMALL: [&str; 2] = [
    "grains[0].amount={count=200}",
    "grains[0].placement={lattice={lower=[0.0,0.0],upper=[0.04,0.12],spacing=1.01}}",
];

/// The same without any heat.
fn cold(scene: &mut Scene) {
    scene.grains.iter_mut().for_each(|group| group.temperature = None);
    if let Some(contacts) = &mut scene.contacts {
        contacts.conduction = None;
    }
    if let Some(fluid) = &mut scene.fluid {
        fluid.heat = None;
        fluid.boundaries.iter_mut().for_each(|boundary| boundary.heat = None);
        fluid.thin_cell.iter_mut().for_each(|cell| cell.heat = None);
    }
    if let Some(coupling) = &mut scene.coupling {
        coupling.heat = None;
    }
}

/// One test, because the count of bytes is the whole process's.
#[test]
fn what_a_scene_does_not_need_costs_nothing() {
    without_heat_there_is_no_temperature();
    without_fluid_there_is_no_mesh();
    without_grains_there_is_no_overlap();
    // Queues between threads grow by chance.
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    one.install(each_part_costs_its_own);
    one.install(without_a_droplet_there_is_no_water);
}

fn without_heat_there_is_no_temperature() {
    let with = scene("bubbling-bed/scene-quick.toml", &SMALL);
    let mut without = with.clone();
    cold(&mut without);
    let build = |scene: &Scene| {
        let before = BYTES.load(Ordering::Relaxed);
        let mut simulation = Simulation::new(scene).expect("a valid scene");
        for _ in 0..3 {
            simulation.step().expect("a step");
        }
        let bytes = BYTES.load(Ordering::Relaxed) - before;
        simulation.refresh().expect("fields");
        (simulation, bytes)
    };
    let (warm, warm_bytes) = build(&with);
    let (cold, cold_bytes) = build(&without);
    let view = cold.view();
    assert!(view.grains.expect("grains").temperature.is_none());
    assert!(view.fluid.expect("fluid").scalars.is_empty());
    let interaction = cold.coupled().interaction().expect("both");
    assert!(interaction.load.heat.is_none() && interaction.at.temperature.is_empty());
    assert!(interaction.heat.is_empty());
    assert!(cold.coupled().grains().expect("grains").contact_heat().is_empty());
    assert!(cold.readings().iter().all(|(name, _)| !name.contains("heat") && !name.contains("energy")));
    assert!(cold.totals().energy_exchange_defect.is_none());
    // The two temperatures (state and next), the matrix of the energy equation and its ILU.
    let fluid = cold.coupled().fluid().expect("fluid");
    let nodes = fluid.mesh.points.len();
    assert!(warm_bytes > cold_bytes + 8 * nodes * (2 + 7 + 7), "{warm_bytes} {cold_bytes}");
    assert!(!warm.view().fluid.expect("fluid").scalars.is_empty());
}

fn without_fluid_there_is_no_mesh() {
    let mut simulation = Simulation::new(&scene("hopper/scene.toml", &[])).expect("a valid scene");
    for _ in 0..3 {
        simulation.step().expect("a step");
    }
    let coupled = simulation.coupled();
    assert!(coupled.fluid().is_none() && coupled.interaction().is_none());
    assert!(coupled.passage.is_none());
    let phases = simulation.totals().phases;
    let others = phases.named().into_iter().filter(|(name, _)| *name != "contacts");
    assert!(others.map(|(_, seconds)| seconds).sum::<f64>() == 0.0, "{phases:?}");
    assert!(phases.contacts > 0.0);
}

fn without_grains_there_is_no_overlap() {
    let mut simulation = Simulation::new(&scene("cavity/scene.toml", &[])).expect("a valid scene");
    for _ in 0..3 {
        simulation.step().expect("a step");
    }
    let coupled = simulation.coupled();
    assert!(coupled.grains().is_none() && coupled.interaction().is_none());
    let phases = simulation.totals().phases;
    assert_eq!((phases.overlap, phases.closure, phases.contacts), (0.0, 0.0, 0.0));
    assert!(phases.flow > 0.0);
}

/// The same hole in the mesh, with a droplet in it and as a wall.
fn without_a_droplet_there_is_no_water() {
    let mut with = voidage_tests::droplet_scene(&["coupling.scheme=\"henry\"", "coupling.cohesion_below={}"]);
    with.grains.iter_mut().for_each(|group| group.velocity = None);
    let mut without = with.clone();
    let hole = without.droplet.take().expect("a droplet").boundary;
    let boundaries = &mut fluid(&mut without).boundaries;
    let walls = boundaries.iter().find(|boundary| boundary.name == "walls").expect("walls").clone();
    boundaries.push(voidage_scene::Boundary { name: hole, ..walls });
    // Nothing is in the hole that is not there with the droplet.
    let lattice = "grains[0].placement={lattice={lower=[0.0015,0.001],upper=[0.0045,0.003],spacing=1.8}}";
    let grains = voidage_tests::droplet_scene(&[lattice]).grains;
    for scene in [&mut with, &mut without] {
        scene.grains.clone_from(&grains);
        scene.grains.iter_mut().for_each(|group| group.velocity = None);
    }
    let run = Simulation::new(&without).expect("a valid scene");
    let (fluid, interaction) = (run.coupled().fluid(), run.coupled().interaction());
    let (fluid, interaction) = (fluid.expect("a fluid"), interaction.expect("both"));
    assert!(fluid.droplet.is_none() && fluid.remesher.is_none() && fluid.motion.is_none());
    assert!(interaction.wet.is_none() && fluid.solution.bodies.is_empty());
    let columns = run.readings();
    assert!(columns.iter().all(|(name, _)| !name.contains("remesh") && !name.contains("vaporisation")));
    drop((columns, run));
    count(&without);
    let (more, less) = (count(&with), count(&without));
    println!("{:<36}{:>12}{:>14}{:>12}", "droplet", more.bytes - less.bytes, more.allocations, more.wire);
    println!("{:<36}{:>12}{:>14}{:>12}", "without", 0, less.allocations, less.wire);
    assert_eq!((more.nodes, more.grains), (less.nodes, less.grains));
    // Places and velocities of the nodes, and not even these.
    assert_eq!(more.wire, less.wire + 4 * less.nodes);
    // The solutions for a unit velocity and the mesh that a step may have to put back are made in each.
    assert!(more.bytes > less.bytes + 8 * 6 * less.nodes, "{} and {} bytes", more.bytes, less.bytes);
    assert!(more.allocations > less.allocations, "{} and {}", more.allocations, less.allocations);
    assert!(!less.phases.contains(&"remesh"), "{:?}", less.phases);
}

/// A part of a scene, how it is turned on, and what it then adds.
struct Part {
    name: &'static str,
    on: fn(&mut Scene),
    adds: Added,
}

/// What a part adds to a plain bed.
#[derive(Default)]
struct Added {
    /// Numbers on the wire by point and by node, in a step.
    wire: [usize; 2],
    /// Numbers in memory by grain and by node, at least.
    memory: [usize; 2],
    /// Whether a second linear system is solved.
    energy: bool,
    /// Whether the fluid loses heat to grains.
    exchange: bool,
}

/// A step of a scene as it is counted.
struct Counted {
    grains: usize,
    nodes: usize,
    /// Rows of the columns of points, with those that fill them up.
    points: usize,
    /// Bytes in use after it.
    bytes: usize,
    /// Allocations of a step when all buffers have been made.
    allocations: usize,
    /// Numbers that it would send to another process.
    wire: usize,
    /// Solutions of the fluid, iterations of its energy equation, scalars that its points exchange.
    calls: [usize; 3],
    phases: Vec<&'static str>,
}

const PARTS: &[Part] = &[
    Part {
        name: "rotation",
        on: |scene| contacts(scene).rotation = true,
        // Spin; angles are not integrated.
        adds: Added { memory: [1, 0], ..NOTHING },
    },
    Part {
        name: "friction",
        on: |scene| scene.materials.values_mut().for_each(|material| material.friction = 0.3),
        adds: NOTHING,
    },
    Part {
        name: "cohesion",
        on: |scene| contacts(scene).cohesion = Some(Cohesion { force: 1e-6, age: 0.0, sliding: None }),
        adds: NOTHING,
    },
    Part {
        name: "heat of the grains",
        on: |scene| scene.grains.iter_mut().for_each(|group| group.temperature = Some(350.0)),
        // Temperature and capacity.
        adds: Added { memory: [2, 0], ..NOTHING },
    },
    Part {
        name: "heat of grains and contacts",
        on: |scene| {
            scene.grains.iter_mut().for_each(|group| group.temperature = Some(350.0));
            contacts(scene).conduction = Some(Conduction::Henry);
        },
        adds: Added { memory: [2, 0], ..NOTHING },
    },
    Part {
        name: "thin cell",
        on: |scene| fluid(scene).thin_cell = Some(ThinCell { drag: 1.0, heat: None }),
        adds: NOTHING,
    },
    Part {
        name: "moving mesh",
        on: |scene| {
            fluid(scene).mesh_motion = Some(MeshMotion {
                amplitude: Coordinates(vec![1e-9, 0.0]),
                frequency: Some(5.0),
                ..MeshMotion::default()
            });
        },
        // Places and velocities; too small a motion to change the pieces of the grains.
        adds: Added { wire: [0, 4], memory: [0, 4], ..NOTHING },
    },
    Part {
        name: "moving mesh with remeshing",
        on: |scene| {
            let remesh = Some(Remesh { every: 1000, angle: 0.0 });
            let amplitude = Coordinates(vec![1e-9, 0.0]);
            fluid(scene).mesh_motion =
                Some(MeshMotion { amplitude, frequency: Some(5.0), remesh, ..MeshMotion::default() });
        },
        // And the lengths that edges should have.
        adds: Added { wire: [0, 4], memory: [0, 5], ..NOTHING },
    },
    Part {
        name: "lagged: a second law",
        on: |scene| coupling(scene).scheme = SchemeName::Lagged,
        adds: Added { memory: [3, 0], ..NOTHING },
    },
    Part {
        name: "iterated: two laws, what is carried",
        on: |scene| coupling(scene).scheme = SchemeName::Iterated,
        adds: Added { memory: [7, 0], ..NOTHING },
    },
];

const NOTHING: Added = Added { wire: [0; 2], memory: [0; 2], energy: false, exchange: false };

fn contacts(scene: &mut Scene) -> &mut voidage_scene::Contacts {
    scene.contacts.get_or_insert_default()
}

fn fluid(scene: &mut Scene) -> &mut voidage_scene::Fluid {
    scene.fluid.as_mut().expect("a fluid")
}

fn coupling(scene: &mut Scene) -> &mut voidage_scene::Coupling {
    scene.coupling.as_mut().expect("a coupling")
}

/// Each part, alone in a plain bed, adds what it needs and nothing else.
fn each_part_costs_its_own() {
    let with_all = scene("bubbling-bed/scene-quick.toml", &SMALL);
    let mut plain = with_all.clone();
    cold(&mut plain);
    plain.materials.values_mut().for_each(|material| material.friction = 0.0);
    plain.walls.iter_mut().for_each(|wall| wall.friction = Some(0.0));
    contacts(&mut plain).rotation = false;
    fluid(&mut plain).thin_cell = None;
    // What the process makes once, as its threads start, is no part of a scene.
    count(&plain);
    let base = count(&plain);
    assert_eq!(base.calls, [1, 0, 0]);
    let phases = ["overlap", "closure", "flow", "exchange", "contacts"];
    assert!(base.phases.iter().all(|phase| phases.contains(phase)), "{:?}", base.phases);
    println!(
        "{:<36}{:>12}{:>14}{:>12}  calls of flow, energy, heat to grains",
        "part", "bytes", "allocations", "wire"
    );
    show("(none)", &base, &base);
    for part in PARTS {
        let mut changed = plain.clone();
        (part.on)(&mut changed);
        let with = count(&changed);
        show(part.name, &with, &base);
        compare(part.name, &part.adds, &with, &base);
    }
    let all = count(&with_all);
    show("all of the quick bed", &all, &base);
    let heat = Added { wire: [3, 0], memory: [9, 16], energy: true, exchange: true };
    compare("all of the quick bed", &heat, &all, &base);
}

fn show(name: &str, counted: &Counted, base: &Counted) {
    let more = counted.bytes as isize - base.bytes as isize;
    let wire = counted.wire as isize - base.wire as isize;
    println!("{name:<36}{more:>+12}{:>14}{wire:>+12}  {:?}", counted.allocations, counted.calls);
}

fn compare(name: &str, adds: &Added, with: &Counted, base: &Counted) {
    let numbers = |[by_grain, by_node]: [usize; 2]| by_grain * base.grains + by_node * base.nodes;
    let wire = base.wire + adds.wire[0] * base.points + adds.wire[1] * base.nodes;
    assert_eq!(with.wire, wire, "{name}: numbers on the wire");
    // The text of the scene differs by some letters.
    let least = base.bytes + 8 * numbers(adds.memory) - 64;
    // What the part needs, and as much again for its working memory; the rest of the scene stays as it is.
    let most = base.bytes + 8 * (4 * numbers(adds.memory) + 2 * base.grains + base.nodes / 2);
    assert!(with.bytes >= least, "{name}: {} bytes, at least {least}", with.bytes);
    assert!(with.bytes <= most || adds.energy, "{name}: {} bytes, at most {most}", with.bytes);
    assert!(with.allocations <= base.allocations + 16, "{name}: {} allocations", with.allocations);
    assert_eq!(with.calls[1] > 0, adds.energy, "{name}: energy equation");
    assert_eq!(with.calls[2] > 0, adds.exchange, "{name}: heat at the grains");
    assert_eq!(with.phases.contains(&"energy"), adds.energy, "{name}: {:?}", with.phases);
}

/// Builds the scene and counts its first step, when the grains lie alike in all scenes, and the allocations of later
/// ones, the fewest: the more iterations the linear solver needs with the factors that it has kept, the more of them.
fn count(scene: &Scene) -> Counted {
    let before = BYTES.load(Ordering::Relaxed);
    let mut simulation = Simulation::new(scene).expect("a valid scene");
    let counts = Arc::new(Counts::default());
    let fluid = simulation.coupled_mut().fluid_mut().expect("a fluid");
    let nodes = fluid.mesh.points.len();
    fluid.wrap_backend(|inner| Box::new(Spy { inner, counts: counts.clone() }));
    simulation.step().expect("a step");
    let bytes = BYTES.load(Ordering::Relaxed) - before;
    let calls = [&counts.solves, &counts.energy, &counts.heat].map(|count| count.load(Ordering::Relaxed));
    let wire = counts.wire.load(Ordering::Relaxed);
    let points = simulation.coupled().interaction().map_or(0, |both| both.points.len());
    let points = points.next_multiple_of(8);
    for _ in 0..5 {
        simulation.step().expect("a step");
    }
    let mut of_step = || {
        let before = CALLS.load(Ordering::Relaxed);
        simulation.step().expect("a step");
        CALLS.load(Ordering::Relaxed) - before
    };
    let allocations = (0..12).map(|_| of_step()).min().unwrap_or_default();
    let phases = simulation.totals().phases.named().into_iter();
    let phases = phases.filter(|(_, seconds)| *seconds > 0.0).map(|(name, _)| name).collect();
    let grains = simulation.coupled().grains().map_or(0, |grains| grains.particles.len());
    Counted { grains, nodes, points, bytes, allocations, wire, calls, phases }
}

#[derive(Default)]
struct Counts {
    wire: AtomicUsize,
    solves: AtomicUsize,
    energy: AtomicUsize,
    heat: AtomicUsize,
}

/// Hands everything on and counts what a step is made of.
struct Spy {
    inner: Box<dyn FluidBackend<2>>,
    counts: Arc<Counts>,
}

impl FluidBackend<2> for Spy {
    fn set_mesh(&mut self, mesh: &Mesh<2>, generation: u32, fields: &State<2>) -> Result<()> {
        self.inner.set_mesh(mesh, generation, fields)
    }

    fn solve(&mut self, step: &FluidStep<'_, 2>, out: &mut Solution<2>) -> Result<()> {
        let length = StepMessage::new(step, String::new()).header(false, 1).length;
        self.counts.wire.store(length as usize, Ordering::Relaxed);
        self.inner.solve(step, out)?;
        self.counts.solves.fetch_add(1, Ordering::Relaxed);
        self.counts.energy.fetch_add(out.report.scalar_iterations, Ordering::Relaxed);
        let exchanged = step.immersed.iter().flat_map(|immersed| immersed.points.scalars.iter().flatten());
        self.counts.heat.fetch_add(exchanged.count(), Ordering::Relaxed);
        Ok(())
    }

    fn accept(&mut self) {
        self.inner.accept()
    }
}
