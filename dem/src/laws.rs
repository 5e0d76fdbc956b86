//! Coefficients of restitution, friction and rolling resistance at a contact, by what meets there.

use crate::settings::{Pair, Side};
use crate::{Material, Wall};

/// Restitution, friction, rolling resistance.
pub(crate) type Law = [f64; 3];

/// Tables by pairs of materials, and by material and wall.
pub(crate) struct Laws {
    count: usize,
    grains: Vec<Law>,
    walls: Vec<Law>,
}

/// Two materials meet with the smaller coefficients.
pub(crate) fn between(a: &Material, b: &Material) -> Law {
    [a.restitution.min(b.restitution), a.friction.min(b.friction), a.rolling.min(b.rolling)]
}

impl Laws {
    /// The tables; none without pairs, so that scenes without them look nothing up.
    pub fn new<const D: usize>(materials: &[Material], walls: &[Wall<D>], pairs: &[Pair]) -> Option<Self> {
        if pairs.is_empty() {
            return None;
        }
        let count = materials.len();
        let grains = materials.iter().flat_map(|a| materials.iter().map(|b| between(a, b))).collect();
        let own = |wall: &Wall<D>| [wall.restitution, wall.friction, wall.rolling];
        let walls = walls.iter().flat_map(|wall| std::iter::repeat_n(own(wall), count)).collect();
        let mut laws = Self { count, grains, walls };
        for pair in pairs {
            let a = pair.material as usize;
            let places = match pair.other {
                Side::Material(b) => {
                    [Some((false, a * count + b as usize)), Some((false, b as usize * count + a))]
                }
                Side::Wall(wall) => [Some((true, wall as usize * count + a)), None],
            };
            for (of_walls, place) in places.into_iter().flatten() {
                let law = if of_walls { &mut laws.walls[place] } else { &mut laws.grains[place] };
                law[0] = pair.restitution.unwrap_or(law[0]);
                law[1] = pair.friction.unwrap_or(law[1]);
                law[2] = pair.rolling.unwrap_or(law[2]);
            }
        }
        Some(laws)
    }

    pub fn of_grains(&self, a: u8, b: u8) -> Law {
        self.grains[a as usize * self.count + b as usize]
    }

    pub fn of_wall(&self, wall: u32, material: u8) -> Law {
        self.walls[wall as usize * self.count + material as usize]
    }

    pub fn have_friction(&self) -> bool {
        self.grains.iter().chain(&self.walls).any(|law| law[1] > 0.0)
    }

    pub fn have_rolling(&self) -> bool {
        self.grains.iter().chain(&self.walls).any(|law| law[2] > 0.0)
    }
}
