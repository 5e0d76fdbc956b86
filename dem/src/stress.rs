//! Stress of the grains, coordination and fabric, from the contacts of the last sub-step.

use crate::{Dem, Partner, Vector};
use nalgebra::SMatrix;

/// What the contacts that carry a force make of each grain, and of all together.
#[derive(Clone, Debug, PartialEq)]
pub struct Stress<const D: usize> {
    /// Sum over the contacts of each grain of `arm f^T`, arm from its centre to the contact and f the force on it, N
    /// m (N in the plane). Over the volume of the grain it is its mean stress, positive in tension; over a volume
    /// that holds many grains the sum is the mean stress of all that is in it (J. Christoffersen, M. M. Mehrabadi, S.
    /// Nemat-Nasser, J. Appl. Mech. 48, 339, 1981).
    pub moment: Vec<SMatrix<f64, D, D>>,
    /// Contacts of each grain.
    pub coordination: Vec<u32>,
    /// Mean of `n n^T` over the contacts, n their normals: its trace is 1; zero without contacts.
    pub fabric: SMatrix<f64, D, D>,
}

impl<const D: usize> Dem<D> {
    /// Stress, coordination and fabric.
    pub fn stress(&self) -> Stress<D> {
        let grains = self.particles.len();
        let mut stress = Stress {
            moment: vec![SMatrix::zeros(); grains],
            coordination: vec![0; grains],
            fabric: SMatrix::zeros(),
        };
        let mut contacts = 0.0;
        for (contact, _) in self.carriers() {
            let mut add = |grain: u32, arm: Vector<D>, force: Vector<D>| {
                stress.moment[grain as usize] += arm * force.transpose();
                stress.coordination[grain as usize] += 1;
            };
            let radius = |grain: u32| self.particles.radius[grain as usize];
            add(contact.grain, contact.normal * radius(contact.grain), -contact.force);
            if let Partner::Grain(other) = contact.partner {
                add(other, -contact.normal * radius(other), contact.force);
            }
            stress.fabric += contact.normal * contact.normal.transpose();
            contacts += 1.0;
        }
        if contacts > 0.0 {
            stress.fabric /= contacts;
        }
        stress
    }
}
