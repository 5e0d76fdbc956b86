//! The contact network as a run records it: forces, gaps, heat and ages of the contacts, and the stress of the grains.

use crate::Output;
use crate::recorder::Reading;
use std::collections::BTreeMap;
use voidage_coupling::Coupled;
use voidage_dem::{Dem, Partner, Vector};

/// Contacts by the numbers for life of both grains, or of a grain and the number of a wall behind [`OF_WALLS`].
type Identity = (u64, u64);

/// First number of walls in an [`Identity`].
const OF_WALLS: u64 = 1 << 32;

/// Times since which contacts carry a force, s.
pub(crate) type Since = BTreeMap<Identity, f64>;

/// What of the contacts of the last sub-step is recorded.
#[derive(Clone, Debug, Default)]
pub struct Network {
    /// Both ends of each contact, one after the other, m: the centres of two grains, or that of a grain and where it
    /// meets a wall.
    pub ends: Vec<Vector<2>>,
    /// Force along the normal, N per metre of depth, positive where it presses; all columns of contacts have each
    /// value twice, for both ends.
    pub normal_force: Vec<f64>,
    /// Amount of the force across the normal, N per metre of depth.
    pub tangential_force: Vec<f64>,
    /// What the contact allowed the gap to close by in the sub-step, m.
    pub gap: Vec<f64>,
    /// Amount of the heat through the contact, W per metre of depth.
    pub heat: Vec<f64>,
    /// Time since which the contact has carried a force, in whole steps, s.
    pub age: Vec<f64>,
    /// Stress of the grains, where it is asked for.
    pub stress: Option<StressColumns>,
}

/// Stress and coordination of the grains, and the stress at the nodes of the mesh.
#[derive(Clone, Debug, Default)]
pub struct StressColumns {
    /// Mean stress in the disc of each grain, Pa, positive in tension: xx, xy, yx, yy.
    pub of_grains: [Vec<f64>; 4],
    /// Contacts of each grain that carry a force.
    pub coordination: Vec<f64>,
    /// Stress of the grains per volume of grains and fluid at the nodes, Pa, averaged as the voidage is; empty
    /// without a fluid.
    pub at_nodes: [Vec<f64>; 4],
    readings: Vec<Reading>,
}

/// Names of the components of a stress, in order.
pub(crate) const COMPONENTS: [&str; 4] = ["xx", "xy", "yx", "yy"];

/// Adds a step to the times since which contacts carry a force.
pub(crate) fn age(since: &mut Since, grains: &Dem<2>, start: f64) {
    // Contacts that are not known now have not gone.
    if !grains.knows_contacts() {
        return;
    }
    let now = grains.carriers().map(|(contact, _)| {
        let identity = identity(grains, contact.grain, contact.partner);
        (identity, since.get(&identity).copied().unwrap_or(start))
    });
    *since = now.collect();
}

fn identity(grains: &Dem<2>, grain: u32, partner: Partner) -> Identity {
    let id = |i: u32| u64::from(grains.particles.id[i as usize]);
    match partner {
        Partner::Grain(other) => (id(grain).min(id(other)), id(grain).max(id(other))),
        Partner::Wall(wall) => (id(grain), OF_WALLS + u64::from(wall)),
    }
}

impl Network {
    /// The network as it is, of what `output` asks for.
    pub(crate) fn new(output: &Output, coupled: &Coupled<2>, since: &Since) -> Option<Self> {
        let grains = coupled.grains().filter(|_| output.contacts || output.stress)?;
        let mut network = Self::default();
        if output.contacts {
            network.list(grains, since);
        }
        network.stress = output.stress.then(|| StressColumns::new(grains, coupled));
        Some(network)
    }

    fn list(&mut self, grains: &Dem<2>, since: &Since) {
        let time = grains.time();
        for (contact, heat) in grains.carriers() {
            let centre = grains.particles.position[contact.grain as usize];
            let end = match contact.partner {
                // The image that the grain touches.
                Partner::Grain(other) => {
                    grains.settings().period.image(grains.particles.position[other as usize], &centre)
                }
                Partner::Wall(_) => centre + contact.normal * grains.particles.radius[contact.grain as usize],
            };
            let normal = contact.force.dot(&contact.normal);
            let across = (contact.force - contact.normal * normal).norm();
            let identity = identity(grains, contact.grain, contact.partner);
            let age = since.get(&identity).map_or(0.0, |start| time - start);
            self.ends.extend([centre, end]);
            let columns = [
                (&mut self.normal_force, normal),
                (&mut self.tangential_force, across),
                (&mut self.gap, contact.gap),
                (&mut self.heat, heat.abs()),
                (&mut self.age, age),
            ];
            columns.into_iter().for_each(|(column, value)| column.extend([value; 2]));
        }
    }

    /// Columns of the time series.
    pub(crate) fn readings(&self) -> &[Reading] {
        self.stress.as_ref().map_or(&[], |stress| &stress.readings)
    }
}

impl StressColumns {
    fn new(grains: &Dem<2>, coupled: &Coupled<2>) -> Self {
        let mut stress = grains.stress();
        if !grains.knows_contacts() {
            stress.moment.iter_mut().for_each(|moment| moment.fill(f64::NAN));
        }
        let particles = &grains.particles;
        let area: Vec<f64> = particles.radius.iter().map(|r| std::f64::consts::PI * r * r).collect();
        let part = |k: usize| stress.moment.iter().map(move |moment| moment[(k / 2, k % 2)]);
        let of_grains: [Vec<f64>; 4] =
            std::array::from_fn(|k| part(k).zip(&area).map(|(moment, area)| moment / area).collect());
        let mut at_nodes: [Vec<f64>; 4] = Default::default();
        if let (Some(interaction), Some(fluid)) = (coupled.interaction(), coupled.fluid()) {
            let nodal = &fluid.nodal_volume;
            let pieces = &interaction.load.pieces;
            // Before the first cut no contact is known either.
            let cut = !pieces.is_empty();
            for (k, column) in at_nodes.iter_mut().enumerate().filter(|_| cut) {
                let moments: Vec<f64> = part(k).collect();
                voidage_coupling::overlap::density(&fluid.mesh, pieces, &moments, nodal, column);
            }
        }
        let all: f64 = area.iter().sum();
        // At the start nothing is known of contacts.
        let known = |value: f64| if grains.knows_contacts() { value } else { f64::NAN };
        let mut readings: Vec<Reading> = COMPONENTS
            .iter()
            .enumerate()
            .map(|(k, name)| {
                let sum = part(k).fold(0.0, |sum, moment| sum + moment);
                (format!("grain_stress_{name}_Pa").into(), known(sum / all))
            })
            .collect();
        let touching: f64 = stress.coordination.iter().map(|n| f64::from(*n)).sum();
        readings.push(("coordination_number".into(), known(touching / particles.len() as f64)));
        for (k, name) in [(0, "xx"), (1, "xy"), (3, "yy")] {
            readings.push((format!("fabric_{name}").into(), known(stress.fabric[(k / 2, k % 2)])));
        }
        let coordination = stress.coordination.iter().map(|n| known(f64::from(*n))).collect();
        Self { of_grains, coordination, at_nodes, readings }
    }
}
