//! Discs and spheres by non-smooth contact dynamics (Moreau-Jean steps), with heat.
//!
//! One sub-step of length h, for grains of mass m under forces F, gravity g and implicit drag gamma:
//!
//! 1. walls are placed; free velocities (m v + h (F + m g)) / (m + gamma h);
//! 2. contacts that may close are found ([`Settings::max_travel`] bounds how far a grain goes);
//! 3. impulses p with 0 <= p_n, u_n + gap/h >= 0, complementary, and |p_t| <= mu p_n (Coulomb), by Gauss-Seidel,
//!    warm from the last sub-step, and, on request, by an interior-point method where that stalls;
//! 4. velocities v = free + sum of p / (m + gamma h), positions x += h v;
//! 5. heat through the contacts that carry force.
//!
//! Results are the same bit for bit on any number of threads.

mod approach;
mod band;
mod bodies;
mod bonds;
mod coarse;
mod contact;
mod dem;
mod energy;
mod error;
mod heat;
mod interior;
mod laws;
mod memory;
mod momentum;
mod neighbours;
pub mod packing;
mod parallel;
mod particles;
mod passage;
mod penetration;
mod period;
mod rebound;
mod repair;
mod rolling;
mod saved;
mod scene;
mod search;
mod settings;
mod solver;
mod space;
mod stress;
mod team;
mod velocity_bounds;
mod walls;

pub use bonds::{Bond, Bonds};
pub use dem::{Contact, ContactForce, Dem, Means, Partner, State};
pub use energy::Energy;
pub use error::{Error, Result, Rounded};
pub use heat::Conduction;
pub use particles::retain;
pub use particles::{Heat, Material, Particles, Rotation};
pub use passage::{Fed, Mouth, Passage, PassageState, Passed, Rate, Sink, Source};
pub use period::Period;
pub use settings::{Acceleration, Cohesion, Cost, Halo, Load, Pair, Settings, Side, StepReport};
pub use space::{Vector, ball, inertia};
pub use stress::Stress;
pub use walls::{Motion, Wall};

/// Room for `len` items; when the buffer must grow, an eighth more, so that counts that waver do not allocate and
/// little memory lies idle (doubling would cost up to twice).
pub(crate) fn reserve<T>(buffer: &mut Vec<T>, len: usize) {
    if buffer.capacity() < len {
        buffer.reserve_exact(len + len / 8 + 16 - buffer.len());
    }
}
