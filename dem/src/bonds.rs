//! How the contacts that act bind the grains: in how many directions, and whether to something that does not move.

use crate::memory::WALL;
use crate::{Particles, Vector};

/// What holds one grain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bond {
    /// Independent directions among the normals of its contacts, 0 to `D`.
    pub directions: u8,
    /// Whether a chain of contacts leads from it to a wall or to a grain that is held.
    pub grounded: bool,
}

/// The bonds of all grains; buffers are kept from call to call.
#[derive(Clone, Debug, Default)]
pub struct Bonds {
    bonds: Vec<Bond>,
    /// Union-find forest of the chains of contacts.
    parent: Vec<u32>,
    /// First normal of each grain that has one.
    normals: Vec<[f64; 3]>,
}

/// Sine of the angle from which two normals count as two directions.
const DISTINCT: f64 = 0.1;

impl Bonds {
    /// The bond of a grain.
    pub fn of(&self, grain: usize) -> Bond {
        self.bonds[grain]
    }

    pub(crate) fn find<const D: usize>(
        &mut self,
        particles: &Particles<D>,
        contacts: impl Iterator<Item = (u32, u32, Vector<D>, Vector<D>)>,
    ) {
        let n = particles.len();
        self.bonds.clear();
        self.bonds.resize(n, Bond::default());
        self.parent.clear();
        self.parent.extend(0..n as u32);
        self.normals.clear();
        self.normals.resize(n, [0.0; 3]);
        for (i, j, normal, _) in contacts {
            let wall = j & WALL != 0 || particles.held(j as usize);
            self.bind(i as usize, &normal);
            if wall {
                self.bonds[i as usize].grounded = true;
                continue;
            }
            self.bind(j as usize, &normal);
            if particles.held(i as usize) {
                self.bonds[j as usize].grounded = true;
            } else {
                self.join(i, j);
            }
        }
        for i in 0..n {
            let root = self.root(i as u32) as usize;
            self.bonds[root].grounded |= self.bonds[i].grounded;
        }
        for i in 0..n {
            let root = self.root(i as u32) as usize;
            self.bonds[i].grounded = self.bonds[root].grounded;
        }
    }

    /// Counts a normal as a direction of the grain if it differs from those before. In space two normals span a plane;
    /// a third counts when it leaves the plane of the last two.
    fn bind<const D: usize>(&mut self, i: usize, normal: &Vector<D>) {
        let bond = &mut self.bonds[i];
        let normal: [f64; 3] = std::array::from_fn(|a| if a < D { normal[a] } else { 0.0 });
        let kept = &mut self.normals[i];
        match bond.directions {
            0 => (*kept, bond.directions) = (normal, 1),
            1 => {
                let across = cross(kept, &normal);
                if across.iter().map(|x| x * x).sum::<f64>().sqrt() > DISTINCT {
                    (*kept, bond.directions) = (across, 2);
                }
            }
            // `kept` is now orthogonal to the plane of the first two.
            2 if D == 3 => {
                let out: f64 = kept.iter().zip(&normal).map(|(a, b)| a * b).sum();
                if out.abs() > DISTINCT {
                    bond.directions = 3;
                }
            }
            _ => {}
        }
    }

    fn root(&mut self, mut i: u32) -> u32 {
        while self.parent[i as usize] != i {
            let above = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = above;
            i = above;
        }
        i
    }

    /// The smaller number becomes the root: the forest does not depend on the order of the contacts.
    fn join(&mut self, i: u32, j: u32) {
        let (a, b) = (self.root(i), self.root(j));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}

fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Material;

    /// A pair in the air, and a pile of three of which one lies on a wall.
    #[test]
    fn chains_reach_the_ground_or_do_not() {
        let position = (0..6).map(|k| Vector::<2>::new(f64::from(k), 0.0)).collect();
        let particles = Particles::new(position, vec![0.5; 6], vec![0; 6], &[Material::default()]).unwrap();
        let (up, side) = (Vector::<2>::new(0.0, 1.0), Vector::<2>::new(1.0, 0.0));
        let contacts =
            [(0, 1, side, side), (3, 2, up, up), (4, 3, up, up), (4, WALL, -up, up), (3, 2, side, side)];
        let mut bonds = Bonds::default();
        bonds.find(&particles, contacts.into_iter());
        let of = |i: usize| (bonds.of(i).directions, bonds.of(i).grounded);
        assert_eq!([of(0), of(1), of(5)], [(1, false), (1, false), (0, false)]);
        assert_eq!([of(2), of(3), of(4)], [(2, true), (2, true), (1, true)]);
    }
}
