//! The sizes of a scene that tell a mistake, and what is out of its usual range: for `voidage check`.

use std::fmt;
use voidage_coupling::Interaction;
use voidage_coupling::single::Single;
use voidage_dem::Particles;
use voidage_fluid::{Mesh, Vector};
use voidage_scene::{Flow, Placement, Scene, Simulation};
use walls::unguarded;

mod walls;

/// Something unusual: the key, what it makes, and the reason to look at it.
#[derive(Clone, Debug)]
pub struct Unusual {
    key: String,
    what: String,
}

impl fmt::Display for Unusual {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}`: {}", self.key, self.what)
    }
}

/// A number for reading, with three significant digits.
pub struct Short(pub f64);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = self.0.abs();
        if size != 0.0 && !(1e-3..1e5).contains(&size) {
            return write!(f, "{:.2e}", self.0);
        }
        let rounded: f64 = format!("{:.2e}", self.0).parse().unwrap_or(self.0);
        write!(f, "{rounded}")
    }
}

/// The sizes of a scene that is built.
#[derive(Default)]
pub struct Sizes {
    /// Lines of the report: name and text.
    pub lines: Vec<(&'static str, String)>,
    /// What is out of its usual range.
    pub unusual: Vec<Unusual>,
}

/// Width over which grains are spread, in their diameters.
fn kernel(scene: &Scene) -> f64 {
    scene.coupling.as_ref().map_or(1.0, |coupling| coupling.kernel)
}

/// Through how much a boundary lets a velocity in, as a share of what it would if it stood across, and the length of
/// the boundary, m.
fn inward(mesh: &Mesh<2>, name: &str, velocity: &Vector<2>) -> Option<(f64, f64)> {
    let part = mesh.boundary(name).ok()?;
    let (mut through, mut length) = (0.0, 0.0);
    for facet in part.facets.chunks_exact(2) {
        let along = mesh.points[facet[1] as usize] - mesh.points[facet[0] as usize];
        // The mesh lies on the left of its facets.
        through += velocity.dot(&Vector::<2>::new(-along[1], along[0]));
        length += along.norm();
    }
    Some((through / (velocity.norm() * length), length))
}

impl Sizes {
    /// The sizes of a scene at time zero.
    pub fn of(scene: &Scene, simulation: &Simulation) -> Sizes {
        let mut sizes = Sizes::default();
        let gravity: Vector<2> = scene.gravity.vector();
        if gravity[1] > 0.0 {
            sizes.odd(
                "gravity",
                "points upwards: what falls has a negative second number, such as [0.0, -9.81]".into(),
            );
        }
        if gravity.norm() != 0.0 && !(0.1..=100.0).contains(&gravity.norm()) {
            let what = format!("is {} m/s2; on earth it is 9.81", Short(gravity.norm()));
            sizes.odd("gravity", what);
        }
        let coupled = simulation.coupled();
        let grains = coupled.grains().map(|grains| &grains.particles);
        if let Some(grains) = grains {
            sizes.grains(scene, grains);
        }
        sizes.walls(scene);
        if let Some(fluid) = coupled.fluid() {
            sizes.fluid(scene, &fluid.mesh, grains);
        }
        match (grains, coupled.fluid(), coupled.interaction()) {
            (Some(grains), Some(fluid), Some(interaction)) => {
                sizes.together(scene, grains, &fluid.mesh, interaction);
            }
            _ => sizes.fall(scene, grains),
        }
        sizes
    }

    fn line(&mut self, name: &'static str, text: String) {
        self.lines.push((name, text));
    }

    fn odd(&mut self, key: &str, what: String) {
        self.unusual.push(Unusual { key: key.to_owned(), what });
    }

    fn grains(&mut self, scene: &Scene, grains: &Particles<2>) {
        match grains.is_empty() {
            true => self.line("grains", "none at the start".into()),
            false => self.grains_there(grains),
        }
        self.groups(scene, grains.len());
    }

    fn grains_there(&mut self, grains: &Particles<2>) {
        let (least, most) = diameters(grains);
        let moving: Vec<f64> = grains.mass.iter().copied().filter(|mass| mass.is_finite()).collect();
        let weigh = match moving.is_empty() {
            true => "held".into(),
            false => format!("mass {} kg/m", Short(moving.iter().sum())),
        };
        let sizes = format!("diameter {} to {} m", Short(least), Short(most));
        self.line("grains", format!("{}, {sizes}, {weigh}", grains.len()));
        let [lower, upper] = bounds(grains);
        self.line(
            "  they lie in",
            format!(
                "[{}, {}] to [{}, {}] m",
                Short(lower[0]),
                Short(lower[1]),
                Short(upper[0]),
                Short(upper[1])
            ),
        );
    }

    fn groups(&mut self, scene: &Scene, count: usize) {
        for (i, group) in scene.grains.iter().enumerate() {
            let Some(radius) = &group.radius else { continue };
            let diameter = 2.0 * radius.largest();
            if !(1e-6..=0.05).contains(&diameter) {
                let what = format!(
                    "diameters of {} m: lengths are in metres, and this is the radius",
                    Short(diameter)
                );
                self.odd(&format!("grains[{i}].radius"), what);
            }
            if matches!(group.placement, Placement::Deposit(_)) && scene.gravity.vector::<2>().norm() == 0.0 {
                let what = "without gravity nothing presses the grains together: contacts carry no force";
                self.odd(&format!("grains[{i}].placement.deposit"), what.into());
            }
            if let Some(temperature) = group.temperature.filter(|t| !(100.0..=3000.0).contains(t)) {
                self.odd(
                    &format!("grains[{i}].temperature"),
                    format!("{temperature} K: temperatures are in kelvin"),
                );
            }
            if group.solidity == 1.0 && scene.fluid.is_some() && count > 20 {
                let what = "is 1, so that discs that touch leave a voidage of 0.1 to 0.2; beds of spheres have 0.4: \
                            0.8165 compares the densest packings (cases/choosing.md)";
                self.odd(&format!("grains[{i}].solidity"), what.into());
            }
        }
        for (name, material) in &scene.materials {
            if !(100.0..=25_000.0).contains(&material.density) {
                let what =
                    format!("{} kg/m3: water has 1000, glass 2500, steel 7800", Short(material.density));
                self.odd(&format!("materials.{name}.density"), what);
            }
            if let Some(capacity) = material.heat_capacity {
                self.heat_capacity(&format!("materials.{name}.heat_capacity"), capacity);
            }
            if material.friction > 2.0 {
                let what = format!("{}: between grains it is mostly 0.1 to 1", Short(material.friction));
                self.odd(&format!("materials.{name}.friction"), what);
            }
        }
    }

    /// Capacities of solids, liquids and gases lie between those of lead and hydrogen.
    fn heat_capacity(&mut self, key: &str, capacity: f64) {
        if !(100.0..=15_000.0).contains(&capacity) {
            let what = format!("{} J/kg/K: glass has 840, air 1005, water 4180", Short(capacity));
            self.odd(key, what);
        }
    }

    fn fluid(&mut self, scene: &Scene, mesh: &Mesh<2>, grains: Option<&Particles<2>>) {
        let Some(fluid) = &scene.fluid else { return };
        let (lower, upper) = mesh.bounds();
        let [nodes, cells] = [mesh.points.len(), mesh.cell_count()];
        let edge = (mesh.volume() / cells as f64 * 4.0 / 3.0_f64.sqrt()).sqrt();
        let [width, height] = [0, 1].map(|axis| upper[axis] - lower[axis]);
        self.line(
            "mesh",
            format!(
                "{nodes} nodes, {cells} triangles, {} x {} m, edges of about {} m",
                Short(width),
                Short(height),
                Short(edge)
            ),
        );
        let names: Vec<&str> = mesh.boundaries.iter().map(|part| part.name.as_str()).collect();
        self.line("  boundaries", names.join(", "));
        if nodes > 200_000 {
            let what =
                format!("{nodes} nodes: a step takes minutes; beds need edges of one to two grain diameters");
            self.odd("fluid.mesh", what);
        }
        if width.max(height) > 100.0 {
            self.odd("fluid.mesh", format!("is {} m wide: lengths are in metres", Short(width.max(height))));
        }
        if !(0.01..=20_000.0).contains(&fluid.density) {
            let what = format!("{} kg/m3: air has 1.2, water 1000", Short(fluid.density));
            self.odd("fluid.density", what);
        }
        if !(1e-6..=100.0).contains(&fluid.viscosity) {
            let what = format!("{} Pa s: air has 1.8e-5, water 1e-3", Short(fluid.viscosity));
            self.odd("fluid.viscosity", what);
        }
        let thickness = fluid.viscosity / fluid.density;
        if fluid.density >= 200.0 && !(1e-7..2e-4).contains(&thickness) {
            let what = format!(
                "{} Pa s beside {} kg/m3: water has 1e-3 Pa s, which is 1 mPa s or 1 cP, and 1e-6 m2/s over its density",
                Short(fluid.viscosity),
                Short(fluid.density)
            );
            self.odd("fluid.viscosity", what);
        }
        if let Some(heat) = &fluid.heat {
            self.heat_capacity("fluid.heat.heat_capacity", heat.heat_capacity);
        }
        if let Some(heat) = fluid.heat.as_ref().filter(|h| !(100.0..=3000.0).contains(&h.initial_temperature))
        {
            let what = format!("{} K: temperatures are in kelvin", heat.initial_temperature);
            self.odd("fluid.heat.initial_temperature", what);
        }
        let mut fastest = 0.0_f64;
        for (i, boundary) in fluid.boundaries.iter().enumerate() {
            let (Flow::Velocity(velocity) | Flow::SuperficialVelocity(velocity)) = &boundary.flow else {
                continue;
            };
            let velocity: Vector<2> = velocity.vector();
            fastest = fastest.max(velocity.norm());
            let Some((share, length)) =
                inward(mesh, &boundary.name, &velocity).filter(|_| velocity.norm() > 0.0)
            else {
                continue;
            };
            let rate = share * velocity.norm() * length;
            self.line(
                "  inflow",
                format!("{} m2/s through {} ({} m long)", Short(rate), boundary.name, Short(length)),
            );
            let key = format!("fluid.boundaries[{i}].flow");
            if share.abs() < 1e-6 {
                self.odd(
                    &key,
                    format!("the velocity points along \"{}\": nothing flows through it", boundary.name),
                );
            } else if share < 0.0 {
                let what = format!(
                    "the velocity points out of the mesh at \"{}\": fluid is sucked off",
                    boundary.name
                );
                self.odd(&key, what);
            }
        }
        let courant = fastest * scene.time.step / edge;
        if fastest > 0.0 {
            self.line("  Courant number", format!("{} of the fastest inflow", Short(courant)));
        }
        if courant > 10.0 {
            let what = format!("the inflow passes {} elements in a step", Short(courant));
            self.odd("time.step", what);
        }
        if grains.is_some() {
            self.walls_inside(scene, mesh, edge);
        }
        if let Some(grains) = grains.filter(|grains| !grains.is_empty()) {
            let (_, diameter) = diameters(grains);
            self.line("  elements", format!("{} diameters wide", Short(edge / diameter)));
            if !(0.5..=20.0).contains(&(edge / diameter)) {
                let what = format!(
                    "elements are {} diameters of the largest grain wide; beds need 1.3 to 2, single grains 4",
                    Short(edge / diameter)
                );
                self.odd("fluid.mesh", what);
            }
            if edge < diameter && grains.len() > 1 && kernel(scene) < 2.0 {
                let what = format!(
                    "is {} where elements are {} diameters of the largest grain wide: the drag law sees grain and gap \
                     apart, and beds resist too much; 2 spreads grains over what it is a mean of (cases/choosing.md)",
                    kernel(scene),
                    Short(edge / diameter)
                );
                self.odd("coupling.kernel", what);
            }
            for (i, boundary) in fluid.boundaries.iter().enumerate() {
                if let Some(share) = unguarded(scene, mesh, boundary, diameter).filter(|share| *share > 0.5) {
                    let what = format!(
                        "no wall of the grains stands along {:.0} % of \"{}\", and grains that pass it end the run: \
                         add `[[walls]]` with `along = \"{}\"`",
                        100.0 * share,
                        boundary.name,
                        boundary.name
                    );
                    self.odd(&format!("fluid.boundaries[{i}]"), what);
                }
            }
        }
    }

    /// Grains in the fluid: how one falls, and when a bed of them is carried.
    fn together(
        &mut self,
        scene: &Scene,
        grains: &Particles<2>,
        mesh: &Mesh<2>,
        interaction: &Interaction<2>,
    ) {
        let Some(grain) = (0..grains.len()).find(|&i| grains.mass[i].is_finite()) else { return };
        let laws = &interaction.laws;
        let (density, gravity) =
            (grains.mass[grain] / grains.volume[grain], scene.gravity.vector::<2>().norm());
        let (least, most) = diameters(grains);
        let step = scene.time.step;
        let inflow = scene.fluid.iter().flat_map(|fluid| &fluid.boundaries).filter_map(|boundary| {
            match &boundary.flow {
                Flow::Velocity(v) | Flow::SuperficialVelocity(v) => Some(v.vector::<2>().norm()),
                _ => None,
            }
        });
        let inflow = inflow.fold(0.0, f64::max);
        // The share of its disc that is solid is that of the first grain.
        let solidity = grains.volume[grain] / (2.0 * grains.radius[grain]).powi(2);
        let of = |diameter: f64| Single { diameter, volume: solidity * diameter * diameter, density };
        if gravity > 0.0 && density != laws.density {
            let smallest = of(least);
            let terminal = smallest.terminal(laws, gravity);
            let relaxation = density / smallest.drag(laws, terminal, 1.0);
            let reynolds = laws.density * least * terminal / laws.viscosity;
            self.line(
                "single grain",
                format!(
                    "falls at {} m/s (Re {}), relaxation time {} s, {} steps",
                    Short(terminal),
                    Short(reynolds),
                    Short(relaxation),
                    Short(relaxation / step)
                ),
            );
            if inflow > terminal && density > laws.density {
                let what = format!(
                    "{} m/s is faster than the smallest grain falls ({} m/s): it is blown out",
                    Short(inflow),
                    Short(terminal)
                );
                self.odd("fluid.boundaries", what);
            }
            let travel = terminal.min(gravity * step).max(grains_speed(grains)) * step / least;
            if travel > 1.0 {
                let what = format!("a grain moves by {} of its diameters in a step", Short(travel));
                self.odd("time.step", what);
            }
        }
        let pieces = &interaction.load.pieces;
        let within = (0..grains.len()).filter(|&i| !pieces.of(i).is_empty());
        let voidages: Vec<f64> = within.map(|i| pieces.mean(i, mesh, &interaction.load.voidage)).collect();
        if voidages.len() < 20 || gravity == 0.0 || density <= laws.density {
            return;
        }
        let voidage = voidages.iter().sum::<f64>() / voidages.len() as f64;
        let fluidised = of(0.5 * (least + most)).minimum_fluidisation(laws, voidage, gravity);
        let share = if inflow > 0.0 {
            format!("; the inflow is {} of it", Short(inflow / fluidised))
        } else {
            String::new()
        };
        self.line(
            "bed",
            format!("voidage {}, minimum fluidisation at {} m/s{share}", Short(voidage), Short(fluidised)),
        );
        if voidage < 0.25 {
            let what =
                format!("the voidage of the bed is {}, where beds of spheres have 0.4", Short(voidage));
            self.odd("grains.solidity", what);
        }
    }

    /// Grains alone: how far they fall in a step.
    fn fall(&mut self, scene: &Scene, grains: Option<&Particles<2>>) {
        let Some(grains) = grains.filter(|grains| !grains.is_empty()) else { return };
        let (least, _) = diameters(grains);
        let (gravity, step) = (scene.gravity.vector::<2>().norm(), scene.time.step);
        let travel = (gravity * step).max(grains_speed(grains)) * step / least;
        self.line("first step", format!("grains move by {} of their diameter", Short(travel)));
        if travel > 1.0 {
            self.odd(
                "time.step",
                format!("a grain moves by {} of its diameters in the first step", Short(travel)),
            );
        }
    }
}

/// Diameters of the smallest and the largest grain, m.
fn diameters(grains: &Particles<2>) -> (f64, f64) {
    let all = grains.radius.iter().map(|radius| 2.0 * radius);
    all.fold((f64::INFINITY, 0.0), |(least, most), d| (least.min(d), most.max(d)))
}

/// Speed of the fastest grain, m/s.
fn grains_speed(grains: &Particles<2>) -> f64 {
    grains.velocity.iter().map(|velocity| velocity.norm()).fold(0.0, f64::max)
}

/// Corners of the box that all grains are in, m.
fn bounds(grains: &Particles<2>) -> [Vector<2>; 2] {
    let (mut lower, mut upper) = (Vector::<2>::repeat(f64::INFINITY), Vector::<2>::repeat(f64::NEG_INFINITY));
    for (at, radius) in grains.position.iter().zip(&grains.radius) {
        let reach = Vector::<2>::repeat(*radius);
        (lower, upper) = (lower.inf(&(at - reach)), upper.sup(&(at + reach)));
    }
    [lower, upper]
}

/// What flows into a box without a way out, m2/s; none if it has one, or if what flows in flows out.
pub fn closed_inflow(scene: &Scene, mesh: &Mesh<2>) -> Option<f64> {
    let fluid = scene.fluid.as_ref()?;
    let (mut total, mut gross) = (0.0, 0.0);
    for boundary in &fluid.boundaries {
        match &boundary.flow {
            Flow::Open { .. } => return None,
            Flow::Velocity(velocity) | Flow::SuperficialVelocity(velocity) => {
                let velocity: Vector<2> = velocity.vector();
                if velocity.norm() == 0.0 {
                    continue;
                }
                let (share, length) = inward(mesh, &boundary.name, &velocity)?;
                total += share * velocity.norm() * length;
                gross += (share * velocity.norm() * length).abs();
            }
            Flow::NoSlip | Flow::Slip => {}
        }
    }
    (total.abs() > 1e-9 * gross).then_some(total)
}
