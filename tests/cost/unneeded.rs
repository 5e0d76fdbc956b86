//! What a scene does not need is not there: columns, allocations, phases.

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use voidage_coupling::{Scene, Simulation};

struct Counting;

static BYTES: AtomicUsize = AtomicUsize::new(0);

// SAFETY: hands every request to the system's allocator unchanged and only counts.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        BYTES.fetch_add(layout.size(), Ordering::Relaxed);
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
    assert!(view.fluid.expect("fluid").temperature.is_none());
    let interaction = cold.coupled().interaction.as_ref().expect("both");
    assert!(interaction.load.heat.is_none() && interaction.at.temperature.is_empty());
    assert!(interaction.heat.is_empty());
    assert!(cold.coupled().grains.as_ref().expect("grains").contact_heat().is_empty());
    assert!(cold.readings().iter().all(|(name, _)| !name.contains("heat") && !name.contains("energy")));
    assert!(cold.totals().energy_exchange_defect.is_none());
    // The two temperatures (state and next), the matrix of the energy equation and its ILU.
    let fluid = cold.coupled().fluid.as_ref().expect("fluid");
    let nodes = fluid.mesh.points.len();
    assert!(warm_bytes > cold_bytes + 8 * nodes * (2 + 7 + 7), "{warm_bytes} {cold_bytes}");
    assert!(warm.view().fluid.expect("fluid").temperature.is_some());
}

fn without_fluid_there_is_no_mesh() {
    let mut simulation = Simulation::new(&scene("hopper/scene.toml", &[])).expect("a valid scene");
    for _ in 0..3 {
        simulation.step().expect("a step");
    }
    let coupled = simulation.coupled();
    assert!(coupled.fluid.is_none() && coupled.interaction.is_none());
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
    assert!(coupled.grains.is_none() && coupled.interaction.is_none());
    let phases = simulation.totals().phases;
    assert_eq!((phases.overlap, phases.closure, phases.contacts), (0.0, 0.0, 0.0));
    assert!(phases.flow > 0.0);
}
