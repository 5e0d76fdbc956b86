//! Grains as they were before a step on trial.

use crate::energy::Energy;
use crate::memory::Memory;
use crate::{Particles, Vector};

/// What a step changes; buffers are kept from one save to the next.
#[derive(Default)]
pub(crate) struct Saved<const D: usize> {
    time: f64,
    position: Vec<Vector<D>>,
    velocity: Vec<Vector<D>>,
    spin: Vec<f64>,
    angle: Vec<f64>,
    temperature: Vec<f64>,
    /// Means over the last step, which the next one may start from, N.
    pub contact_force: Vec<Vector<D>>,
    /// The same, W.
    pub contact_heat: Vec<f64>,
    /// The budget of energy.
    pub energy: Energy,
    /// With cohesion only: contacts have ages, which a step on trial must not count.
    memory: Option<Memory<D>>,
}

impl<const D: usize> Saved<D> {
    pub fn save(&mut self, time: f64, particles: &Particles<D>, memory: Option<&Memory<D>>) {
        self.time = time;
        self.position.clone_from(&particles.position);
        self.velocity.clone_from(&particles.velocity);
        if let Some(rotation) = &particles.rotation {
            self.spin.clone_from(&rotation.spin);
            self.angle.clone_from(&rotation.angle);
        }
        if let Some(heat) = &particles.heat {
            self.temperature.clone_from(&heat.temperature);
        }
        self.memory = memory.cloned();
    }

    /// Puts the grains back and returns the time.
    pub fn restore(&self, particles: &mut Particles<D>, memory: &mut Memory<D>) -> f64 {
        particles.position.clone_from(&self.position);
        particles.velocity.clone_from(&self.velocity);
        if let Some(rotation) = &mut particles.rotation {
            rotation.spin.clone_from(&self.spin);
            rotation.angle.clone_from(&self.angle);
        }
        if let Some(heat) = &mut particles.heat {
            heat.temperature.clone_from(&self.temperature);
        }
        if let Some(before) = &self.memory {
            memory.clone_from(before);
        }
        self.time
    }
}
