//! The residual of the contacts: their natural map, and what it says of the error.

use super::batches::TileBatches;
use super::tiles::{NOTHING, add, over_tiles};
use super::{FORK, Problem, relative, smaller};
use crate::bodies::Bodies;
use crate::contact::{Contact, Law};
use crate::rolling::Rolling;
use crate::space::Vector;
use std::sync::Mutex;

/// What one look at all contacts tells.
pub(super) struct Look {
    /// Relative natural map.
    pub residual: f64,
    /// Energy that solving each contact by itself would take away, J: the part of the error that varies from grain to
    /// grain.
    pub rough: f64,
    /// Sum of |violation| |impulse|, J.
    pub bound: f64,
    /// Fastest closing of a contact beyond its gap over its smaller radius, 1/s.
    pub closing: f64,
    /// Energy of what rounding of the impulses leaves of the velocities, J.
    pub rounding: f64,
    /// Mean square over the contacts of the speed that the impulse gives over the diameter, 1/s2.
    pub comes_back: f64,
}

impl<const D: usize> Problem<D> {
    /// What the natural map r of the present impulses and velocities says; r / rho is the speed by which a contact is
    /// violated.
    pub(super) fn look<L: Law>(&mut self) -> Look {
        let (bodies, cohesion, radius, rolling) = (&self.bodies, &self.cohesion, &self.radius, &self.rolling);
        let count = self.tiles.len();
        crate::reserve(&mut self.tiles.found, count);
        self.tiles.found.resize_with(count, Default::default);
        let tiles = &self.tiles;
        let tile = |contacts: &mut [Contact<D>], _: &mut [Mutex<TileBatches<D>>], tile: usize| {
            let (mut sums, first) = (NOTHING, tiles.contacts(tile).start);
            for (k, c) in contacts.iter().enumerate() {
                let u = relative::<L, D>(bodies, c);
                let cohesion = if L::COHESION { cohesion[first + k] } else { 0.0 };
                let (rho, [square, size]) = natural_map::<L, D>(bodies, c, &u, cohesion);
                let (r, p) = (square.sqrt(), size.sqrt());
                let mut energies = [0.5 * square / rho, r / rho * (r + p), 0.5 * size / rho];
                let [mut square, mut size] = [square, size];
                if L::ROLLING {
                    let (rho, [map, own]) = rolling_map(bodies, c, cohesion, &rolling[first + k]);
                    let (r, q) = (map.sqrt(), own.sqrt());
                    let more = [0.5 * map / rho, r / rho * (r + q), 0.5 * own / rho];
                    energies = std::array::from_fn(|e| energies[e] + more[e]);
                    (square, size) = (square + map, size + own);
                }
                let turned = 0.5 * p / (rho * smaller(radius, c));
                let closing = -(u.dot(&c.normal) + c.bias) / smaller(radius, c);
                let [rough, bound, carried] = energies;
                sums = add(sums, ([square, size, rough, bound, carried, turned * turned], closing));
            }
            tiles.found[tile].rough.set(sums.0[2]);
            tiles.found[tile].closing.set(sums.1);
            sums
        };
        let ([square, size, rough, bound, carried, turned], closing) =
            over_tiles(0..tiles.len(), &tiles.starts, &mut self.contacts, &mut [], FORK, &tile);
        // Without any impulse all of it is missing.
        let residual = match (square == 0.0, size == 0.0) {
            (true, _) => 0.0,
            (false, true) => 1.0,
            (false, false) => (square / size).sqrt(),
        };
        let rounding = (4.0 * f64::EPSILON).powi(2) * carried;
        let comes_back = turned / self.contacts.len().max(1) as f64;
        Look { residual, rough, bound, closing, rounding, comes_back }
    }
}

/// Rho, kg, and the squares of the natural map and of the impulse with it.
///
/// rho = 1/w_n between equals, half of the heavier mass otherwise: with 1/w_n, near the lighter mass, a heavy lid that
/// falls freely on light grains would look solved.
#[inline(always)]
pub(super) fn natural_map<L: Law, const D: usize>(
    bodies: &Bodies<D>,
    c: &Contact<D>,
    u: &Vector<D>,
    cohesion: f64,
) -> (f64, [f64; 2]) {
    let rho = c.mass_n.max(0.5 * bodies.heavier(c.i as usize, c.j as usize));
    (rho, c.natural_map::<L>(u, rho, cohesion))
}

/// The same of the law of rolling.
#[inline(always)]
pub(super) fn rolling_map<const D: usize>(
    bodies: &Bodies<D>,
    c: &Contact<D>,
    cohesion: f64,
    rolling: &Rolling,
) -> (f64, [f64; 2]) {
    rolling.natural_map(bodies, c.i, c.j, c.impulse.dot(&c.normal) + cohesion)
}
