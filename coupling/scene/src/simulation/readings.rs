//! The columns of the series that the fields do not show.

use super::{Simulation, chimney};
use crate::Scene;
use crate::network::Network;
use crate::probes;
use crate::recorder::{Reading, column_name};
use voidage_coupling::droplet::Droplet;
use voidage_coupling::{Fluid, System, TEMPERATURE};
use voidage_dem::{Motion, Passed};
use voidage_fluid::Vector;
use voidage_fluid::balance::Balance;

impl Simulation {
    /// Columns of the series that the view does not show: how the last step went, and what passed the boundary in it;
    /// zeros before the first, so that the columns are always the same.
    pub fn readings(&self) -> Vec<Reading> {
        let (mut readings, last) = (Vec::<Reading>::new(), &self.last);
        if let Some(grains) = self.coupled.grains() {
            let step = last.grains.unwrap_or_default();
            readings.extend([
                ("contacts".into(), step.contacts as f64),
                ("contact_sweeps".into(), step.sweeps as f64),
                ("contact_residual".into(), step.residual),
                ("substeps".into(), step.substeps as f64),
            ]);
            if self.output.energy {
                let (energy, kinetic) = (grains.energy(), grains.particles.kinetic_energy());
                readings.push(("kinetic_energy_J_per_m".into(), kinetic));
                let terms = energy.terms().into_iter();
                readings.extend(terms.map(|(name, term)| (format!("energy_{name}_J_per_m").into(), term)));
                readings.push(("energy_defect".into(), energy.defect(kinetic)));
            }
            for (name, walls) in &self.bodies {
                let force: Vector<2> = walls.iter().map(|wall| grains.wall_force()[*wall]).sum();
                for (axis, force) in ["x", "y"].iter().zip(force.iter()) {
                    readings.push((format!("wall_force_{name}_{axis}_N_per_m").into(), *force));
                }
            }
            for (name, walls) in &self.bodies {
                if walls.iter().all(|wall| grains.walls()[*wall].pivot(0.0).is_some()) {
                    let torque: f64 = walls.iter().map(|wall| grains.wall_torque()[*wall]).sum();
                    readings.push((format!("wall_torque_{name}_N").into(), torque));
                }
            }
            readings.extend_from_slice(self.network.as_ref().map_or(&[], Network::readings));
        }
        self.passage_readings(&mut readings);
        if let Some(fluid) = self.coupled.fluid() {
            let report = last.fluid.unwrap_or_default();
            readings.push(("linear_iterations".into(), report.flow_iterations as f64));
            self.boundary_readings(fluid, &mut readings);
            self.remesh_readings(fluid, &mut readings);
            if let Some(droplet) = &fluid.droplet {
                droplet_readings(droplet, (self.last_length(), self.surface), &mut readings);
                if let (Some(grains), Some(interaction)) = (self.coupled.grains(), self.coupled.interaction())
                {
                    let bed = (&interaction.laws, self.surface);
                    chimney::readings(droplet, &grains.particles, bed, &mut readings);
                }
            }
        }
        if let Some(interaction) = self.coupled.interaction() {
            let agreement = last.agreement.unwrap_or_default();
            readings.extend([
                ("fluid_solves".into(), agreement.solves as f64),
                ("step_parts".into(), agreement.parts as f64),
                ("coupling_disagreement".into(), agreement.disagreement),
                ("carried_impulse_share".into(), agreement.carried),
                ("grains".into(), interaction.force.len() as f64),
                ("grains_left".into(), interaction.departed as f64),
                ("mass_left_kg_per_m".into(), interaction.departed_mass),
                ("solid_inflow_m2_per_s".into(), last.appeared.unwrap_or_default() / self.last_length()),
                ("solid_volume_defect".into(), last.solid_volume_defect.unwrap_or_default()),
                ("momentum_exchange_defect".into(), last.momentum_exchange_defect.unwrap_or_default()),
            ]);
            if interaction.load.heat.is_some() {
                let defect = last.energy_exchange_defect.unwrap_or_default();
                readings.push(("fluid_to_grain_heat_W_per_m".into(), interaction.heat.iter().sum()));
                readings.push(("energy_exchange_defect".into(), defect));
            }
        }
        if !self.output.probes.is_empty() {
            readings.extend(probes::readings(&self.output.probes, &self.view()));
        }
        readings
    }

    /// What passed sources and sinks.
    fn passage_readings(&self, readings: &mut Vec<Reading>) {
        let Some(passage) = &self.coupled.passage else { return };
        if let System::Grains(grains, _) = &self.coupled.system {
            readings.push(("grains".into(), grains.particles.len() as f64));
        }
        let mut add = |kind: &str, name: &str, passed: &Passed| {
            let name = column_name(name);
            readings.extend([
                (format!("{kind}_{name}_grains").into(), passed.grains as f64),
                (format!("{kind}_{name}_mass_kg_per_m").into(), passed.mass),
                (format!("{kind}_{name}_mass_flow_kg_per_s_per_m").into(), passed.last / self.last_length()),
            ]);
        };
        for (source, fed) in passage.sources.iter().zip(&passage.state().fed) {
            add("source", &source.name, &fed.passed);
        }
        for (sink, taken) in passage.sinks.iter().zip(&passage.state().taken) {
            add("sink", &sink.name, taken);
        }
        for (source, fed) in passage.sources.iter().zip(&passage.state().fed) {
            readings
                .push((format!("source_{}_waiting", column_name(&source.name)).into(), fed.waiting as f64));
        }
    }

    /// What interpolation to new meshes has changed since time zero, where the domain is remeshed.
    fn remesh_readings(&self, fluid: &Fluid<2>, readings: &mut Vec<Reading>) {
        let Some(remesher) = &fluid.remesher else { return };
        let (changed, (density, capacity)) = (&remesher.changed, self.gas);
        for (axis, velocity) in ["x", "y"].iter().zip(changed.velocity.iter()) {
            readings.push((format!("remesh_momentum_{axis}_N_s_per_m").into(), density * velocity));
        }
        for (k, scalar) in fluid.scalars.iter().enumerate() {
            let change = changed.scalars.get(k).copied().unwrap_or_default();
            readings.push(match scalar.as_str() {
                TEMPERATURE => ("remesh_heat_J_per_m".into(), capacity * change),
                other => (format!("remesh_{other}_m2").into(), change),
            });
        }
    }

    /// What passed each part of the boundary of the mesh in the last step; no numbers where the solver does not compute
    /// it.
    fn boundary_readings(&self, fluid: &Fluid<2>, readings: &mut Vec<Reading>) {
        let steps = self.last.fluid.is_some();
        let none = Balance {
            flux: if steps { f64::NAN } else { 0.0 },
            force: Vector::repeat(if steps { f64::NAN } else { 0.0 }),
            torque: vec![if steps { f64::NAN } else { 0.0 }],
            scalars: vec![if steps { f64::NAN } else { 0.0 }; fluid.scalars.len()],
            convected: vec![if steps { f64::NAN } else { 0.0 }; fluid.scalars.len()],
        };
        // A droplet that has vanished keeps its columns, with zeros.
        let gone = fluid.droplet.as_ref().filter(|droplet| droplet.state.gone);
        let nothing = Balance::none(fluid.scalars.len());
        let parts = fluid.conditions.iter().enumerate().map(|(part, condition)| {
            (&condition.boundary, fluid.solution.balances.get(part).unwrap_or(&none))
        });
        for (name, balance) in parts.chain(gone.map(|droplet| (&droplet.boundary, &nothing))) {
            let turning = self.turning.as_ref().filter(|(part, _)| part == name);
            let name = column_name(name);
            readings.push((format!("flux_{name}_m2_per_s").into(), balance.flux));
            for (axis, force) in ["x", "y"].iter().zip(balance.force.iter()) {
                readings.push((format!("force_{name}_{axis}_N_per_m").into(), *force));
            }
            if let Some((_, motion @ Motion::Table { centre, .. })) = turning {
                // That of the balance is about the origin.
                let (centre, force) = (motion.carry(*centre, self.time()), balance.force);
                let torque = balance.torque[0] - (centre.x * force.y - centre.y * force.x);
                readings.push((format!("torque_{name}_N").into(), torque));
            }
            for (k, scalar) in fluid.scalars.iter().enumerate() {
                let (given, convected) = match scalar.as_str() {
                    TEMPERATURE => (format!("heat_{name}_W_per_m"), format!("convected_heat_{name}_W_per_m")),
                    other => {
                        (format!("{other}_{name}_m2_per_s"), format!("convected_{other}_{name}_m2_per_s"))
                    }
                };
                readings.push((given.into(), balance.scalars[k]));
                readings.push((convected.into(), balance.convected[k]));
            }
        }
    }
}

/// The bodies that the walls of a scene make up, in the order of their first walls.
pub(super) fn bodies(scene: &Scene) -> Vec<(String, Vec<usize>)> {
    let mut bodies: Vec<(String, Vec<usize>)> = Vec::new();
    for (number, wall) in scene.walls.iter().enumerate() {
        let name = column_name(wall.body());
        match bodies.iter_mut().find(|(known, _)| *known == name) {
            Some((_, walls)) => walls.push(number),
            None => bodies.push((name, vec![number])),
        }
    }
    bodies
}

/// The part of the boundary of the mesh that turns about a centre, and how it moves.
pub(super) fn turning(scene: &Scene) -> Option<(String, Motion<2>)> {
    let motion = scene.fluid.as_ref()?.mesh_motion.as_ref()?;
    let table = motion.table.as_ref().filter(|table| !table.centre.is_empty())?;
    let (centre, rows) = (table.centre.vector(), table.rows.clone());
    Some((motion.boundary.clone()?, Motion::Table { centre, rows }))
}

/// Where a droplet is and what it does; `surface` is the height of the bed at time zero, m.
fn droplet_readings(droplet: &Droplet<2>, (dt, surface): (f64, f64), readings: &mut Vec<Reading>) {
    let (state, exchanged, material) = (&droplet.state, &droplet.exchanged, &droplet.material);
    let [x, y] = [state.centre[0], state.centre[1]];
    let missed = droplet.momentum_defect();
    readings.extend([
        ("droplet_x_m".into(), x),
        ("droplet_y_m".into(), y),
        ("droplet_depth_m".into(), surface - (y - state.radius)),
        ("droplet_velocity_x_m_per_s".into(), state.velocity[0]),
        ("droplet_velocity_y_m_per_s".into(), state.velocity[1]),
        ("droplet_radius_m".into(), state.radius),
        ("droplet_liquid_kg_per_m".into(), droplet.mass()),
        ("vaporisation_kg_per_s_per_m".into(), exchanged.vaporisation),
        ("droplet_gas_force_x_N_per_m".into(), exchanged.gas_force[0]),
        ("droplet_gas_force_y_N_per_m".into(), exchanged.gas_force[1]),
        ("droplet_grain_force_x_N_per_m".into(), exchanged.grain_force[0]),
        ("droplet_grain_force_y_N_per_m".into(), exchanged.grain_force[1]),
        ("droplet_grain_pressure_force_x_N_per_m".into(), -exchanged.pressed[0]),
        ("droplet_grain_pressure_force_y_N_per_m".into(), -exchanged.pressed[1]),
        ("droplet_gas_heat_W_per_m".into(), exchanged.gas_heat),
        ("droplet_grain_heat_W_per_m".into(), exchanged.grain_heat),
        ("droplet_lifetime_s".into(), {
            let rate = exchanged.vaporisation;
            if rate == 0.0 { 0.0 } else { droplet.mass() / rate }
        }),
        ("droplet_absorption_number".into(), droplet.absorption * dt),
        ("droplet_volume_defect_m2".into(), state.volume),
        ("droplet_water_defect_kg_per_m".into(), {
            material.water.density * (state.first - state.boiled - state.liquid)
        }),
        ("droplet_momentum_defect_x_N_s_per_m".into(), missed.x),
        ("droplet_momentum_defect_y_N_s_per_m".into(), missed.y),
        ("droplet_heat_defect_J_per_m".into(), droplet.heat_defect()),
    ]);
}
