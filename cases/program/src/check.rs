//! `voidage check`: all of a run but its steps; what a scene has, how large it is, and what is unusual about it.

use crate::ending::Ending;
use crate::sizes::{Sizes, Unusual, closed_inflow};
use crate::{placing, run, shipped};
use std::path::Path;
use voidage_campaign::process::catch_interrupts;
use voidage_coupling::Result;
use voidage_dem::Rounded;
use voidage_remote::launch::Host;
use voidage_scene::probes::check_probes;
use voidage_scene::recorder::check_averages;
use voidage_scene::{Amount, MeshSource, Placement, Rate, Scene, Simulation, Time};

/// Checks a scene, builds what it describes, and prints its parts and sizes.
pub fn check(file: &Path, sets: &[String]) -> Result<u8> {
    let scene = shipped::read(file, sets)?;
    let (simulation, unused) = build(&scene)?;
    println!("{}: good\n{}", file.display(), scene.title);
    line("steps", steps(&scene.time));
    part("periodic", scene.periodic.as_ref(), |periodic| {
        let axes = [("x", periodic.x), ("y", periodic.y)].into_iter();
        let axes = axes.filter_map(|(axis, sides)| sides.map(|[a, b]| format!("{axis} from {a} to {b} m")));
        axes.collect::<Vec<_>>().join(", ")
    });
    grains(&scene);
    fluid(&scene);
    part("droplet", scene.droplet.as_ref(), |droplet| {
        let held = if droplet.held { ", held" } else { "" };
        format!("the hole \"{}\" at {} K{held}", droplet.boundary, droplet.temperature)
    });
    part("coupling", scene.coupling.as_ref(), |coupling| {
        format!(
            "{} with drag {} and voidage function {}",
            name(&coupling.scheme),
            name(&coupling.drag),
            name(&coupling.voidage_function)
        )
    });
    part("  heat exchange", scene.coupling.as_ref().and_then(|coupling| coupling.heat.as_ref()), name);
    let output = &scene.output;
    part("pressure drop", output.pressure_drop.as_ref(), |drop| format!("from {} to {}", drop.from, drop.to));
    let probes: Vec<&str> = output.probes.iter().map(|probe| probe.name.as_str()).collect();
    part("probes", (!probes.is_empty()).then_some(&probes), |probes| probes.join(", "));
    part("averages", output.average.as_ref(), |average| {
        format!("{} to {} s on squares of {} m", average.from, average.to, average.cell)
    });
    line("hash", scene.hash()?);
    let sizes = Sizes::of(&scene, &simulation);
    println!("\nsizes");
    sizes.lines.iter().for_each(|(name, text)| line(name, text));
    let mut unusual = [unused, scene.faster_than_steps()].concat();
    unusual.extend(sizes.unusual.iter().map(Unusual::to_string));
    if !unusual.is_empty() {
        println!("\nunusual: right, if you mean it");
        unusual.iter().for_each(|unusual| println!("  {unusual}"));
    }
    Ok(0)
}

/// How many steps there are, and how long they are.
fn steps(time: &Time) -> String {
    let last = time.steps() - 1;
    match time.length(last) {
        short if short < time.step => {
            format!("{last} of {} s and one of {} s to {} s", time.step, Rounded(short), time.end)
        }
        _ => format!("{} of {} s to {} s", last + 1, time.step, time.end),
    }
}

/// The scene at time zero. A fluid solver in another process is not started, and beds do not settle: that takes minutes
/// for a large one. With it come the columns of tables that are not used.
fn build(scene: &Scene) -> Result<(Simulation, Vec<String>)> {
    let mut here = scene.clone();
    here.fluid.iter_mut().for_each(|fluid| fluid.backend = None);
    for group in &mut here.grains {
        if let Placement::Deposit(deposit) = &mut group.placement {
            deposit.settle = false;
        }
    }
    let ending = Ending::watched(catch_interrupts()?);
    let mut placing = placing::watched(None, ending.flag(), false);
    let mut simulation = Simulation::placed(&here, &Host::default(), &mut placing)?;
    simulation.refresh().map_err(run::at_start)?;
    placing::tell(&placing.beds);
    run::check_stop(scene, &simulation)?;
    check_averages(scene, &simulation.view())?;
    check_probes(scene, &simulation.view())?;
    let mesh = simulation.coupled().fluid().map(|fluid| &fluid.mesh);
    match mesh.and_then(|mesh| closed_inflow(scene, mesh)) {
        None => Ok((simulation, placing::unused(&placing))),
        Some(rate) => {
            let way = if rate > 0.0 { "into" } else { "out of" };
            let what = format!("no boundary is open, and {} m2/s flow {way} the box", rate.abs());
            Err(scene.error(
                "fluid.boundaries",
                what,
                "give a boundary `flow = \"open\"`, or velocities that sum to nothing",
            ))
        }
    }
}

fn grains(scene: &Scene) {
    if scene.grains.is_empty() {
        return line("grains", "off");
    }
    for group in &scene.grains {
        let amount = match (&group.amount, &group.placement) {
            (Amount::Count(count), _) => format!("{count}"),
            (Amount::Mass(mass), _) => match &group.radius {
                Some(radius) => {
                    let density = scene.materials[&group.material].density * group.solidity;
                    format!("about {:.0} ({mass} kg/m)", mass / (density * radius.mean_area()))
                }
                None => format!("{mass} kg/m"),
            },
            (Amount::Fill, Placement::Source(source)) => match source.rate {
                Rate::Grains(rate) => format!("{rate} a second"),
                Rate::Mass(rate) => format!("{rate} kg/s per m"),
            },
            (Amount::Fill, Placement::State(state)) => format!("those of {}", state.file.display()),
            (Amount::Fill, Placement::Csv(csv)) => format!("all of {}", csv.file.display()),
            (Amount::Fill, _) => "as many as its place holds".to_owned(),
        };
        let held = if group.fixed { ", held in place" } else { "" };
        let from = match &group.placement {
            Placement::Source(source) => format!(", let in by the source \"{}\"", source.name),
            _ => String::new(),
        };
        line("grains", format!("{amount} of {}{held}{from}", group.material));
    }
    line("  walls", scene.walls.len());
    if !scene.sinks.is_empty() {
        line("  sinks", scene.sinks.len());
    }
    let contacts = scene.contacts.as_ref();
    line("  rotation", if contacts.is_some_and(|contacts| contacts.rotation) { "on" } else { "off" });
    line("  heat", if scene.grains_have_heat() { "on" } else { "off" });
    part("  conduction", contacts.and_then(|contacts| contacts.conduction.as_ref()), name);
    if contacts.is_some_and(|contacts| contacts.dissipation_heats) {
        line("  dissipation", "warms the grains");
    }
    part("  cohesion", contacts.and_then(|contacts| contacts.cohesion.as_ref()), |c| {
        format!("{} N/m", c.force)
    });
}

fn fluid(scene: &Scene) {
    let Some(fluid) = &scene.fluid else {
        return line("fluid", "off");
    };
    line("fluid", format!("density {} kg/m3, viscosity {} Pa s", fluid.density, fluid.viscosity));
    if let MeshSource::File(file) = &fluid.mesh {
        line("  mesh", file.display());
    }
    part("  body force", fluid.body_force.as_ref(), |force| format!("{:?} m/s2", force.0));
    part("  mesh motion", fluid.mesh_motion.as_ref(), |motion| {
        let what = motion.boundary.as_deref().unwrap_or("inside");
        let remeshed = motion.remesh.map_or(String::new(), |remesh| {
            format!(", remeshed after {} steps or below {} degrees", remesh.every, remesh.angle)
        });
        match (&motion.table, motion.frequency) {
            (Some(table), _) => format!("{what} by a table of {} rows{remeshed}", table.rows.len()),
            (None, frequency) => {
                let frequency = frequency.unwrap_or(0.0);
                format!("{what} by {:?} m, {frequency} times a second{remeshed}", motion.amplitude.0)
            }
        }
    });
    part("  heat", fluid.heat.as_ref(), |heat| match heat.expansion {
        0.0 => "on, without buoyancy".to_owned(),
        expansion => format!("on, with buoyancy ({expansion} 1/K)"),
    });
    part("  thin cell", fluid.thin_cell.as_ref(), |cell| {
        format!("drag {} kg/m3/s{}", cell.drag, if cell.heat.is_some() { ", heat" } else { "" })
    });
    line("  solver", fluid.backend.clone().unwrap_or_default().solver.name());
}

fn line(what: &str, text: impl std::fmt::Display) {
    println!("{what:16} {text}");
}

fn part<T>(what: &str, part: Option<&T>, text: impl FnOnce(&T) -> String) {
    line(what, part.map_or("off".to_owned(), text));
}

/// The name of a law as scenes write it.
fn name(value: &impl serde::Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
}
