//! Steps that are done in parts, each of which is accepted.

use crate::Mixture;
use crate::droplet::{Droplet, Exchanged};
use voidage_dem::Vector;
use voidage_fluid::balance::Balance;

/// A part of a step.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// What grains and fluid move by, s.
    pub dt: f64,
    /// The step that this is a part of, s.
    pub whole: f64,
}

impl Part {
    /// A whole step.
    pub fn whole(dt: f64) -> Self {
        Self { dt, whole: dt }
    }
}

/// What is given and taken over a step that is done in parts.
#[derive(Default)]
pub(crate) struct Parts<const D: usize> {
    /// Force of the fluid on each grain, N, and heat, W.
    grains: (Vec<Vector<D>>, Vec<f64>),
    /// Force of the grains on each wall, N, heat of the walls, W, and moment on them, N m.
    walls: (Vec<Vector<D>>, Vec<f64>, Vec<f64>),
    /// The parts of the boundary.
    balances: Vec<Balance<D>>,
    droplet: Option<Exchanged<D>>,
}

/// Adds a column times a share to its sum, which may be empty yet.
fn add<T>(sum: &mut Vec<T>, column: &[T], share: f64)
where
    T: Copy + std::ops::Mul<f64, Output = T> + std::ops::AddAssign,
{
    let part = column.iter().map(|value| *value * share);
    match sum.is_empty() {
        true => sum.extend(part),
        false => sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part),
    }
}

impl<const D: usize> Parts<D> {
    /// Adds a part in which the fluid made a `share` of the step, and the grains a share `moved` of it.
    pub fn add(&mut self, mixture: &Mixture<D>, share: f64, moved: f64) {
        let Mixture { grains, fluid, interaction, .. } = mixture;
        add(&mut self.grains.0, &interaction.force, moved);
        add(&mut self.grains.1, &interaction.heat, moved);
        add(&mut self.walls.0, grains.wall_force(), moved);
        add(&mut self.walls.1, grains.wall_heat(), moved);
        add(&mut self.walls.2, grains.wall_torque(), moved);
        let parts = &fluid.solution.balances;
        self.balances.resize(parts.len(), Balance::none(fluid.scalars.len()));
        for (sum, part) in self.balances.iter_mut().zip(parts) {
            sum.flux += part.flux * share;
            sum.force += part.force * share;
            add(&mut sum.torque, &part.torque, share);
            add(&mut sum.scalars, &part.scalars, share);
            add(&mut sum.convected, &part.convected, share);
        }
    }

    /// Adds what a droplet exchanged in a part that has been accepted.
    pub fn add_droplet(&mut self, droplet: Option<&Droplet<D>>, share: f64) {
        if let Some(droplet) = droplet {
            self.droplet.get_or_insert_with(Exchanged::nothing).add(&droplet.exchanged, share);
        }
    }

    /// Puts the means in the place of what the last part gave.
    pub fn put(self, mixture: &mut Mixture<D>) {
        (mixture.interaction.force, mixture.interaction.heat) = self.grains;
        mixture.grains.set_walls(self.walls.0, self.walls.1, self.walls.2);
        mixture.fluid.solution.balances = self.balances;
        if let (Some(droplet), Some(exchanged)) = (&mut mixture.fluid.droplet, self.droplet) {
            droplet.exchanged = exchanged;
        }
    }
}
