//! Impulses of the last sub-step by the identity of their contacts: the warm start of the next one.

use crate::space::Vector;
use serde::{Deserialize, Serialize};

/// Marks the partner of a contact as a wall.
pub(crate) const WALL: u32 = 1 << 31;

/// Contacts sorted by owner: the grain of the smaller number, or the grain that meets a wall.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Memory<const D: usize> {
    /// Length of the sub-step that these impulses belong to, s.
    pub h: f64,
    starts: Vec<u32>,
    partner: Vec<u32>,
    /// On the partner, N s.
    impulse: Vec<Vector<D>>,
    /// Time that a contact has lasted, s; empty without cohesion.
    age: Vec<f64>,
    /// Rolling moment on the partner over the effective radius, N s; empty without resistance to rolling.
    rolling: Vec<f64>,
}

/// What is kept of contacts beside their impulses.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beside {
    pub ages: bool,
    pub rolling: bool,
}

/// One contact by its identity.
#[derive(Clone, Copy)]
pub(crate) struct Record<const D: usize> {
    /// Number of the first grain.
    pub i: u32,
    /// Number of the second, or `WALL` + number of the wall.
    pub j: u32,
    /// On the second, N s.
    pub impulse: Vector<D>,
    pub age: f64,
    /// Rolling moment on the second over the effective radius, N s.
    pub rolling: f64,
}

impl<const D: usize> Record<D> {
    /// Sorted so that the first is the owner.
    fn sorted(mut self) -> Self {
        if self.j < self.i {
            std::mem::swap(&mut self.i, &mut self.j);
            self.impulse = -self.impulse;
            self.rolling = -self.rolling;
        }
        self
    }
}

impl<const D: usize> Memory<D> {
    /// Impulse on the second grain, age and rolling impulse of a contact; zero if it is new.
    pub fn find(&self, i: u32, j: u32) -> (Vector<D>, f64, f64) {
        let (owner, partner, sign) = if i < j { (i, j, 1.0) } else { (j, i, -1.0) };
        let Some(&[first, end]) =
            self.starts.get(owner as usize..owner as usize + 2).and_then(|s| s.first_chunk())
        else {
            return (Vector::zeros(), 0.0, 0.0);
        };
        for k in first as usize..end as usize {
            if self.partner[k] == partner {
                let rolling = self.rolling.get(k).map_or(0.0, |q| q * sign);
                return (self.impulse[k] * sign, self.age.get(k).copied().unwrap_or(0.0), rolling);
            }
        }
        (Vector::zeros(), 0.0, 0.0)
    }

    /// Whether these can be the contacts of so many grains and walls.
    pub fn fits(&self, grains: usize, walls: usize) -> bool {
        let count = self.partner.len();
        let starts = match (self.starts.first(), self.starts.last()) {
            (Some(&first), Some(&last)) => {
                self.starts.len() == grains + 1 && (first, last as usize) == (0, count)
            }
            _ => count == 0,
        };
        let partner = |&j: &u32| match j & WALL {
            0 => (j as usize) < grains,
            _ => ((j ^ WALL) as usize) < walls,
        };
        starts
            && self.starts.is_sorted()
            && self.partner.iter().all(partner)
            && self.impulse.len() == count
            && [&self.age, &self.rolling].iter().all(|beside| [0, count].contains(&beside.len()))
            && self.h.is_finite()
            && self.impulse.iter().flatten().chain(&self.age).chain(&self.rolling).all(|x| x.is_finite())
    }

    /// All contacts by the numbers of their grains.
    pub fn records(&self) -> impl Iterator<Item = Record<D>> + '_ {
        self.starts.windows(2).zip(0..).flat_map(move |(ends, i)| {
            (ends[0] as usize..ends[1] as usize).map(move |k| Record {
                i,
                j: self.partner[k],
                impulse: self.impulse[k],
                age: self.age.get(k).copied().unwrap_or(0.0),
                rolling: self.rolling.get(k).copied().unwrap_or(0.0),
            })
        })
    }

    /// Keeps the contacts between grains that are marked, by their new numbers.
    pub fn retain(&mut self, keep: &[bool]) {
        let mut next = 0;
        let number: Vec<Option<u32>> = keep
            .iter()
            .map(|&keep| {
                let number = keep.then_some(next);
                next += u32::from(keep);
                number
            })
            .collect();
        let mut records = Vec::new();
        for r in self.records() {
            let other = if r.j & WALL != 0 { Some(r.j) } else { number[r.j as usize] };
            if let (Some(i), Some(j)) = (number[r.i as usize], other) {
                records.push(Record { i, j, ..r });
            }
        }
        let h = self.h;
        let beside = Beside { ages: !self.age.is_empty(), rolling: !self.rolling.is_empty() };
        self.store(next as usize, h, beside, || records.iter().copied());
    }

    /// Makes room for so many grains; those that are new have no contacts.
    pub fn extend(&mut self, grains: usize) {
        // Where nothing was stored yet, nothing is found.
        if let Some(&end) = self.starts.last() {
            self.starts.resize(grains + 1, end);
        }
    }

    /// Keeps the given contacts; `records` may be walked twice.
    pub fn store<I>(&mut self, grains: usize, h: f64, beside: Beside, records: impl Fn() -> I)
    where
        I: Iterator<Item = Record<D>>,
    {
        self.h = h;
        self.starts.clear();
        self.starts.resize(grains + 1, 0);
        let mut count = 0;
        for r in records() {
            self.starts[r.sorted().i as usize] += 1;
            count += 1;
        }
        let mut sum = 0;
        for s in &mut self.starts {
            sum += *s;
            *s = sum;
        }
        crate::reserve(&mut self.partner, count);
        crate::reserve(&mut self.impulse, count);
        self.partner.resize(count, 0);
        self.impulse.resize(count, Vector::zeros());
        self.age.resize(if beside.ages { count } else { 0 }, 0.0);
        self.rolling.resize(if beside.rolling { count } else { 0 }, 0.0);
        for r in records() {
            let r = r.sorted();
            let s = &mut self.starts[r.i as usize];
            *s -= 1;
            let k = *s as usize;
            self.partner[k] = r.j;
            self.impulse[k] = r.impulse;
            if beside.ages {
                self.age[k] = r.age;
            }
            if beside.rolling {
                self.rolling[k] = r.rolling;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: Beside = Beside { ages: true, rolling: true };

    #[test]
    fn contacts_of_grains_that_leave_are_forgotten_and_the_others_keep_theirs() {
        let p = Vector::<2>::new(1.0, 2.0);
        let records = [
            Record { i: 0, j: 1, impulse: p, age: 4.0, rolling: 0.4 },
            Record { i: 1, j: 3, impulse: p * 2.0, age: 5.0, rolling: 0.5 },
            Record { i: 3, j: WALL + 1, impulse: p * 3.0, age: 6.0, rolling: 0.6 },
            Record { i: 2, j: 3, impulse: p * 4.0, age: 7.0, rolling: 0.7 },
        ];
        let mut memory = Memory::default();
        memory.store(4, 0.5, ALL, || records.into_iter());
        memory.retain(&[false, true, true, true]);
        assert_eq!(memory.h, 0.5);
        assert_eq!(memory.find(0, 2), (p * 2.0, 5.0, 0.5));
        assert_eq!(memory.find(2, WALL + 1), (p * 3.0, 6.0, 0.6));
        assert_eq!(memory.find(2, 1), (-p * 4.0, 7.0, -0.7));
        assert_eq!(memory.find(0, 1), (Vector::zeros(), 0.0, 0.0));
        memory.retain(&[true, true, false]);
        assert_eq!(memory.find(0, 1), (Vector::zeros(), 0.0, 0.0));
    }

    #[test]
    fn contacts_are_found_from_either_side() {
        let p = Vector::<2>::new(1.0, 2.0);
        let records = [
            Record { i: 3, j: 1, impulse: p, age: 4.0, rolling: 0.4 },
            Record { i: 1, j: WALL + 7, impulse: p * 2.0, age: 0.0, rolling: 0.0 },
            Record { i: 0, j: 1, impulse: p * 3.0, age: 1.0, rolling: 0.1 },
        ];
        let mut memory = Memory::default();
        memory.store(5, 1.0, ALL, || records.into_iter());
        assert_eq!(memory.find(3, 1), (p, 4.0, 0.4));
        assert_eq!(memory.find(1, 3), (-p, 4.0, -0.4));
        assert_eq!(memory.find(1, WALL + 7), (p * 2.0, 0.0, 0.0));
        assert_eq!(memory.find(0, 1), (p * 3.0, 1.0, 0.1));
        assert_eq!(memory.find(2, 4), (Vector::zeros(), 0.0, 0.0));
        assert_eq!(memory.find(9, 14), (Vector::zeros(), 0.0, 0.0));
    }

    #[test]
    fn contacts_fit_their_grains_and_walls_or_are_refused() {
        let good = {
            let mut memory = Memory::<2>::default();
            let record = |j| Record { i: 0, j, impulse: Vector::<2>::new(1.0, 2.0), age: 0.5, rolling: 0.25 };
            memory.store(2, 1e-3, ALL, || [record(1), record(WALL)].into_iter());
            memory
        };
        assert!(good.fits(2, 1) && Memory::<2>::default().fits(7, 0));
        assert!(!good.fits(3, 1) && !good.fits(1, 1) && !good.fits(2, 0));
        type Forge = fn(&mut Memory<2>);
        let forge: [Forge; 10] = [
            |m| m.partner[0] = 2,
            |m| m.partner[1] = WALL + 1,
            |m| m.starts[1] = 9,
            |m| m.starts[2] = 1,
            |m| _ = m.impulse.pop(),
            |m| _ = m.age.pop(),
            |m| _ = m.rolling.pop(),
            |m| m.rolling[1] = f64::INFINITY,
            |m| m.impulse[0][1] = f64::NAN,
            |m| m.h = f64::INFINITY,
        ];
        for (k, forge) in forge.iter().enumerate() {
            let mut bad = good.clone();
            forge(&mut bad);
            assert!(!bad.fits(2, 1), "{k}");
        }
    }
}
