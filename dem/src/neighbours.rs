//! Who can touch whom: a hierarchical cell grid, cut into coloured tiles.
//!
//! Level 0 has the finest cells, each level doubles the width, and a grain lives on the finest level whose
//! cells are as wide as its interaction range. A pair on one level lies in neighbouring cells of that level;
//! a pair across levels lies in neighbouring cells of the coarser one. So 1:100 mixtures cost no more than
//! the sum of their levels.
//!
//! Tiles are blocks of cells, at least three wide, of the level up to which almost all grains live. A contact belongs
//! to the tile of its first grain and reaches at most one cell out of it, so two tiles of one colour (2^D colours)
//! never share a grain and can be swept in parallel with the same result as one after the other.
//!
//! The few grains on coarser levels are wide: their contacts make one more tile with a colour of its own, and each of
//! them is a zone of velocities by itself, beside those that are the cells of tiles. So a heavy disc on a bed of fine
//! grains neither makes the tiles of the bed as wide as itself, nor lets all of the bed look for contacts as far as it
//! falls.
//!
//! The cells of a level are numbered block by block, so that the grains of a tile lie together in memory.
//!
//! Along a periodic axis the grid covers the domain, and pairs across its sides make one more tile.
//!
//! Positions outside the grid are clamped to its border cells: clamping keeps neighbours neighbours, so a
//! grain that flies away costs speed at worst.

use crate::period::Period;
use crate::space::{Vector, stencil};
use crate::velocity_bounds::SKIN;
use across::Across;
use wide::Wide;

mod across;
#[cfg(test)]
mod tests;
mod wide;
mod zones;

/// Slots (places in cell order) of a range of cells, and the grains in them.
pub(crate) struct Grid<const D: usize> {
    origin: Vector<D>,
    /// 1 / width of the finest cells.
    inverse: f64,
    levels: usize,
    /// Coarsest cells along each axis.
    dims: Vec<i64>,
    /// First cell of each level.
    first: Vec<usize>,
    /// First slot of each cell, and the end.
    starts: Vec<u32>,
    /// Slot -> grain.
    pub grain_of: Vec<u32>,
    /// Level whose cells tiles are made of, the largest radius of its grains, m, and cells along a tile.
    base: usize,
    largest: f64,
    tile: i64,
    /// Tiles in the order of their colours, and the first tile of each colour.
    pub tiles: Vec<Tile<D>>,
    pub colours: Vec<usize>,
    /// Grains on levels above the base, in the order of their slots, the last ones; and pairs of them that may meet.
    wide: Vec<Wide<D>>,
    wide_pairs: Vec<[u32; 2]>,
    period: Period<D>,
    /// Pairs that may meet across periodic sides.
    across: Vec<Across>,
    cell_of: Vec<u32>,
    later: Vec<[i64; D]>,
    around: Vec<[i64; D]>,
}

/// A set of contacts that one thread sweeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Tile<const D: usize> {
    /// Those of the grains in a block of cells.
    Block([i64; D]),
    /// Those of the grains on levels above the base.
    Wide,
    /// Those across periodic sides.
    Across,
}

/// More levels than any sensible mixture needs.
const MAX_LEVELS: usize = 12;
/// Grains per tile aimed at: its contacts and bodies stay in the first-level cache.
const GRAINS_PER_TILE: f64 = 100.0;
/// Share of all contacts that grains above the level of the tiles may have: their tile is swept by one thread.
const FEW: f64 = 0.01;
/// Binary logarithm of the cells along a block.
const fn block(dimensions: usize) -> u32 {
    if dimensions == 2 { 3 } else { 2 }
}

impl<const D: usize> Default for Grid<D> {
    fn default() -> Self {
        Self {
            origin: Vector::zeros(),
            inverse: 1.0,
            levels: 1,
            dims: vec![],
            first: vec![],
            starts: vec![],
            grain_of: vec![],
            base: 0,
            largest: 0.0,
            tile: 3,
            tiles: vec![],
            colours: vec![],
            wide: vec![],
            wide_pairs: vec![],
            period: Period::default(),
            across: vec![],
            cell_of: vec![],
            later: vec![],
            around: vec![],
        }
    }
}

impl<const D: usize> Grid<D> {
    /// Sorts grains into cells; pairs closer than the sum of their radii with skins + `reach` will be met. Along
    /// periodic axes all positions lie in the domain.
    pub fn build(&mut self, position: &[Vector<D>], radius: &[f64], reach: f64, period: &Period<D>) {
        let n = position.len();
        self.period = *period;
        if self.later.is_empty() {
            (self.later, self.around) = (stencil(true), stencil(false));
        }
        let (small, large) = radius.iter().fold((f64::MAX, 0f64), |(lo, hi), &r| (lo.min(r), hi.max(r)));
        let span = |radius: f64| 2.0 * radius * (1.0 + SKIN) + reach;
        self.choose_cells(position, span(small), span(large));
        self.first.clear();
        let mut cells = 0;
        for level in 0..self.levels {
            self.first.push(cells);
            let blocks: i64 = self.level_dims(level).iter().map(|d| blocks::<D>(*d)).product();
            cells += (blocks as usize) << (D as u32 * block(D));
        }
        self.starts.clear();
        self.starts.resize(cells + 1, 0);
        self.cell_of.resize(n, 0);
        for i in 0..n {
            let level = self.level_of(span(radius[i]));
            let q = self.locate(&position[i]).map(|q| q >> level);
            let cell = self.cell(level, &q);
            self.cell_of[i] = cell as u32;
            self.starts[cell] += 1;
        }
        // Counting sort, filled from the back so that grains of one cell keep the order of their numbers.
        let mut sum = 0;
        for s in &mut self.starts {
            sum += *s;
            *s = sum;
        }
        self.grain_of.resize(n, 0);
        for i in (0..n).rev() {
            let s = &mut self.starts[self.cell_of[i] as usize];
            *s -= 1;
            self.grain_of[*s as usize] = i as u32;
        }
        self.base = self.choose_base();
        let narrow = &self.grain_of[..self.first_wide()];
        self.largest = narrow.iter().fold(0.0, |most: f64, &i| most.max(radius[i as usize]));
        self.cut_tiles(n);
        self.gather_wide(position, radius, reach);
        self.gather_across(position, radius, reach);
    }

    /// The first slot of a wide grain: the levels lie one behind the other.
    fn first_wide(&self) -> usize {
        self.first.get(self.base + 1).map_or(self.grain_of.len(), |cell| self.starts[*cell] as usize)
    }

    /// Origin, width of cells and number of levels; at most about two cells per grain.
    fn choose_cells(&mut self, position: &[Vector<D>], finest: f64, coarsest: f64) {
        if position.is_empty() {
            // No grain gives a width: one cell, wherever walls are.
            (self.origin, self.inverse, self.levels) = (Vector::zeros(), 1.0, 1);
            self.dims.clear();
            self.dims.resize(D, 1);
            return;
        }
        let (mut low, mut high) = robust_box(position);
        for axis in 0..D {
            if let Some(sides) = self.period.sides()[axis] {
                [low[axis], high[axis]] = sides;
            }
        }
        let most = 2.0 * position.len() as f64 + 64.0;
        let extent = high - low;
        let mut width = coarsest;
        let count = |width: f64| extent.iter().map(|e| (e / width).floor() + 1.0).product::<f64>();
        while count(width) > most {
            width *= 1.25;
        }
        self.levels = ((coarsest / finest).log2().round() as usize).clamp(1, MAX_LEVELS);
        while self.levels > 1 && count(width) * (1u64 << (D * (self.levels - 1))) as f64 > most {
            self.levels -= 1;
        }
        self.dims.clear();
        self.dims.extend(extent.iter().map(|e| (e / width).floor() as i64 + 1));
        self.origin = low;
        self.inverse = (1u64 << (self.levels - 1)) as f64 / width;
    }

    /// The lowest level above which grains have few contacts, if each has as many as fit around it.
    fn choose_base(&self) -> usize {
        let grains = |level: usize| {
            let end = self.first.get(level + 1).map_or(self.starts.len() - 1, |cell| *cell);
            (self.starts[end] - self.starts[self.first[level]]) as f64
        };
        let most = (0..self.levels).rev().max_by(|a, b| grains(*a).total_cmp(&grains(*b))).unwrap_or(0);
        let mut wide = 0.0;
        for level in (most + 1..self.levels).rev() {
            wide += grains(level) * ((D - 1) as f64 * (level - most) as f64).exp2();
            if wide > FEW * self.grain_of.len() as f64 {
                return level;
            }
        }
        most
    }

    fn cut_tiles(&mut self, n: usize) {
        let dims = self.level_dims(self.base);
        let cells = dims.iter().product::<i64>() as f64;
        let per_cell = n as f64 / cells;
        let wide = (GRAINS_PER_TILE / per_cell.max(1e-3)).powf(1.0 / D as f64);
        self.tile = 1 << wide.log2().round().clamp(2.0, 4.0) as u32;
        let counts: [i64; D] = std::array::from_fn(|a| dims[a].div_euclid(self.tile) + 1);
        self.tiles.clear();
        self.colours.clear();
        for colour in 0..1usize << D {
            self.colours.push(self.tiles.len());
            let tiles = &mut self.tiles;
            each_cell(&[0; D], &counts, |t| {
                if (0..D).all(|a| t[a] & 1 == (colour >> a & 1) as i64) {
                    tiles.push(Tile::Block(*t));
                }
            });
        }
        self.colours.push(self.tiles.len());
        if self.base + 1 < self.levels {
            self.tiles.push(Tile::Wide);
            self.colours.push(self.tiles.len());
        }
        if !self.period.is_none() {
            self.tiles.push(Tile::Across);
            self.colours.push(self.tiles.len());
        }
    }

    fn level_of(&self, range: f64) -> usize {
        let mut level = 0;
        while level + 1 < self.levels && range * self.inverse > (1u64 << level) as f64 {
            level += 1;
        }
        level
    }

    /// Cells along each axis on a level.
    fn level_dims(&self, level: usize) -> [i64; D] {
        std::array::from_fn(|a| self.dims[a] << (self.levels - 1 - level))
    }

    /// Coordinates of the finest cell of a point. (A cast saturates, so NaN and overflow end in a border cell.)
    fn locate(&self, x: &Vector<D>) -> [i64; D] {
        let s = self.levels - 1;
        std::array::from_fn(|a| {
            let q = ((x[a] - self.origin[a]) * self.inverse).floor() as i64;
            q.clamp(0, (self.dims[a] << s) - 1)
        })
    }

    fn cell(&self, level: usize, q: &[i64; D]) -> usize {
        let (s, bits) = (self.levels - 1 - level, block(D));
        let (mut outer, mut inner) = (0, 0);
        for a in (0..D).rev() {
            outer = outer * blocks::<D>(self.dims[a] << s) + (q[a] >> bits);
            inner = (inner << bits) + (q[a] & ((1 << bits) - 1));
        }
        self.first[level] + ((outer << (D as u32 * bits)) + inner) as usize
    }

    fn slots(&self, cell: usize) -> std::ops::Range<usize> {
        self.starts[cell] as usize..self.starts[cell + 1] as usize
    }

    /// Calls `f(slot)` for all slots in so many cells around a point (and in its own) on every level, and around its
    /// images beyond periodic sides.
    pub fn around(&self, x: &Vector<D>, cells: i64, mut f: impl FnMut(usize)) {
        let widest = (1u64 << (self.levels - 1)) as f64 / self.inverse;
        self.images(x, cells as f64 * widest, |image| self.around_image(image, cells, &mut f));
    }

    fn around_image(&self, x: &Vector<D>, cells: i64, mut f: &mut impl FnMut(usize)) {
        let finest = self.locate(x);
        for level in 0..self.levels {
            let home = finest.map(|q| q >> level.max(self.base));
            let (s, dims) = (self.base.saturating_sub(level), self.level_dims(level.max(self.base)));
            let low = std::array::from_fn(|a| (home[a] - cells).max(0) << s);
            let high = std::array::from_fn(|a| (home[a] + 1 + cells).min(dims[a]) << s);
            each_cell(&low, &high, |q| self.slots(self.cell(level, q)).for_each(&mut f));
        }
    }

    /// Whether the grain of a slot is wider than the cells of tiles.
    pub fn is_wide(&self, slot: usize) -> bool {
        slot >= self.first_wide()
    }

    /// Width of the cells of tiles, m.
    pub fn width(&self) -> f64 {
        (1u64 << self.base) as f64 / self.inverse
    }

    /// Calls `f(zone, slot, Some(slots))` for the slots of one tile with others that they may touch, each
    /// pair once; and before that `f(zone, slot, None)` once for each slot.
    pub fn each_in_tile(&self, tile: usize, mut f: impl FnMut(usize, usize, Option<std::ops::Range<usize>>)) {
        let t = match self.tiles[tile] {
            Tile::Block(t) => t,
            Tile::Wide => return self.each_of_wide(f),
            Tile::Across => return self.each_across(f),
        };
        let dims = self.level_dims(self.base);
        for level in 0..=self.base {
            let s = self.base - level;
            let low = std::array::from_fn(|a| (t[a] * self.tile) << s);
            let high = std::array::from_fn(|a| ((t[a] + 1) * self.tile).min(dims[a]) << s);
            each_cell(&low, &high, |q| {
                let own = self.slots(self.cell(level, q));
                let zone = self.zone(&q.map(|q| q >> s));
                own.clone().for_each(|a| f(zone, a, None));
                self.each_pair(level, q, self.base, |a, others| f(zone, a, Some(others)));
            });
        }
    }

    /// Calls `f` for the slots of a cell, with each other and with those around it on its level and coarser ones up to
    /// `most`.
    fn each_pair(
        &self,
        level: usize,
        q: &[i64; D],
        most: usize,
        mut f: impl FnMut(usize, std::ops::Range<usize>),
    ) {
        let own = self.slots(self.cell(level, q));
        if own.is_empty() {
            return;
        }
        own.clone().for_each(|a| f(a, a + 1..own.end));
        for l in level..=most {
            let dims = self.level_dims(l);
            let home = q.map(|q| q >> (l - level));
            let offsets = if l == level { &self.later } else { &self.around };
            for offset in offsets {
                if let Some(p) = inside(&home, offset, &dims) {
                    let others = self.slots(self.cell(l, &p));
                    if !others.is_empty() {
                        own.clone().for_each(|a| f(a, others.clone()));
                    }
                }
            }
        }
    }
}

/// Blocks along an axis of so many cells.
fn blocks<const D: usize>(cells: i64) -> i64 {
    ((cells - 1) >> block(D)) + 1
}

fn inside<const D: usize>(q: &[i64; D], offset: &[i64; D], dims: &[i64; D]) -> Option<[i64; D]> {
    let p: [i64; D] = std::array::from_fn(|a| q[a] + offset[a]);
    (0..D).all(|a| p[a] >= 0 && p[a] < dims[a]).then_some(p)
}

/// Calls `f` for every cell of a box `low <= q < high`, first axis fastest.
fn each_cell<const D: usize>(low: &[i64; D], high: &[i64; D], mut f: impl FnMut(&[i64; D])) {
    if (0..D).any(|a| low[a] >= high[a]) {
        return;
    }
    let mut q = *low;
    loop {
        f(&q);
        let mut axis = 0;
        loop {
            q[axis] += 1;
            if q[axis] < high[axis] {
                break;
            }
            q[axis] = low[axis];
            axis += 1;
            if axis == D {
                return;
            }
        }
    }
}

/// Bounding box of the points, cut at six standard deviations from the mean, so that a few grains far away
/// do not spread the cells thin.
fn robust_box<const D: usize>(position: &[Vector<D>]) -> (Vector<D>, Vector<D>) {
    let count = position.len().max(1) as f64;
    let mean = position.iter().sum::<Vector<D>>() / count;
    let variance = position.iter().map(|x| (x - mean).component_mul(&(x - mean))).sum::<Vector<D>>() / count;
    let far = variance.map(|v| 6.0 * v.sqrt());
    let (low, high) = position.iter().fold((mean, mean), |(lo, hi), x| (lo.inf(x), hi.sup(x)));
    (low.sup(&(mean - far)), high.inf(&(mean + far)))
}
