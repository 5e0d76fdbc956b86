//! Sweeps: each contact solved by itself, batch after batch.

use super::Problem;
use super::batches::{Exact, RollingBatch, TileBatches};
use super::constants::SCHEDULE;
use super::increments::Increments;
use super::lanes::{Eight, LANES};
use super::tiles::{NOTHING, over_colours, over_tiles};
use crate::contact::{Contact, Law};
use crate::momentum::Momentum;
use crate::team::Team;
use std::array::from_fn;
use std::cell::RefCell;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use std::time::Instant;

impl<const D: usize> Problem<D> {
    /// So many sweeps of the awake tiles, counted from the start of the solve, with momentum if there is a pace.
    pub(super) fn sweep<L: Law>(&mut self, sweeps: Range<usize>, strong: bool, pace: &mut Option<Momentum>) {
        if sweeps.is_empty() {
            return;
        }
        let start = Instant::now();
        self.cost.sweeps += sweeps.len();
        self.cost.relaxations += sweeps.len() * self.awake.contacts;
        self.cost.asleep += sweeps.len() * (self.contacts.len() - self.awake.contacts);
        self.start_increments::<L>();
        self.begin::<L>();
        self.order_awake();
        let Self { bodies, awake, batches, increments, trend, .. } = self;
        let (bodies, awake, batches, increments) = (&*bodies, &*awake, &*batches, &*increments);
        let (step, lags) = (AtomicU32::new(0), AtomicBool::new(false));
        let momentum = pace.is_some();
        let task = |colour: usize, k: usize| {
            let beta = momentum.then(|| f32::from_bits(step.load(Relaxed)));
            let tile = awake.order[awake.firsts[colour] + k] as usize;
            let mut batches = batches[tile].lock().expect("a tile in a panic");
            let sums = if lags.load(Relaxed) {
                batches.follow_bounds(SCHEDULE.follow);
                sweep_tile::<L, D, true>(&mut batches, increments, beta)
            } else {
                sweep_tile::<L, D, false>(&mut batches, increments, beta)
            };
            (0..2).for_each(|a| increments.sums[tile][a].set(sums[a]));
        };
        let threads = if awake.contacts > SCHEDULE.shared { rayon::current_num_threads() } else { 1 };
        Team::run(threads, &awake.counts, task, |team| {
            for sweep in sweeps {
                lags.store(strong && sweep >= SCHEDULE.lagging, Relaxed);
                trend.count(|i| increments.velocity(bodies, i));
                if let Some(pace) = pace {
                    step.store((pace.beta as f32).to_bits(), Relaxed);
                }
                (0..awake.counts.len()).for_each(|colour| team.phase(colour));
                if let Some(pace) = pace {
                    let of = |tile: &u32, a: usize| increments.sums[*tile as usize][a].get();
                    let sum = |a: usize| awake.order.iter().map(|tile| of(tile, a)).sum();
                    pace.update(sum(0), sum(1));
                }
            }
        });
        self.end::<L>();
        self.cost.sweeps_s += start.elapsed().as_secs_f64();
    }

    /// Impulses and velocities become the base of a run.
    fn begin<L: Law>(&mut self) {
        self.increments.next_run();
        let exact = Exact { bodies: &self.bodies, cohesion: &self.cohesion, rolling: &self.rolling };
        let (tiles, awake, increments) = (&self.tiles, &self.awake.tiles, &self.increments);
        let build = |contacts: &mut [Contact<D>], batches: &mut [Mutex<TileBatches<D>>], tile: usize| {
            if awake[tile] {
                let batches = own(batches);
                batches.build(contacts, &exact.of(tiles.contacts(tile)), increments);
                batches.share_bodies(increments);
            }
            NOTHING
        };
        over_colours(tiles, &mut self.contacts, &mut self.batches, SCHEDULE.passes, build);
        let begin = |contacts: &mut [Contact<D>], batches: &mut [Mutex<TileBatches<D>>], tile: usize| {
            if awake[tile] {
                own(batches).begin::<L>(contacts, &exact.of(tiles.contacts(tile)), &increments.units());
            }
            NOTHING
        };
        let all = 0..tiles.len();
        over_tiles(all, &tiles.starts, &mut self.contacts, &mut self.batches, SCHEDULE.passes, &begin);
    }

    /// A last sweep in double precision over the awake tiles: what single contacts decide is then exact.
    pub(super) fn polish<L: Law>(&mut self) {
        let start = Instant::now();
        let exact = Exact { bodies: &self.bodies, cohesion: &self.cohesion, rolling: &self.rolling };
        let (tiles, awake) = (&self.tiles, &self.awake.tiles);
        let polish = |contacts: &mut [Contact<D>], batches: &mut [Mutex<TileBatches<D>>], tile: usize| {
            if awake[tile] {
                own(batches).polish::<L>(contacts, &exact.of(tiles.contacts(tile)));
            }
            NOTHING
        };
        over_colours(tiles, &mut self.contacts, &mut self.batches, SCHEDULE.passes, polish);
        self.cost.sweeps_s += start.elapsed().as_secs_f64();
    }

    /// What the run has changed goes to impulses and velocities.
    fn end<L: Law>(&mut self) {
        self.forget_increments();
        let exact = Exact { bodies: &self.bodies, cohesion: &self.cohesion, rolling: &self.rolling };
        let (tiles, awake, increments) = (&self.tiles, &self.awake.tiles, &self.increments);
        let end = |contacts: &mut [Contact<D>], batches: &mut [Mutex<TileBatches<D>>], tile: usize| {
            if awake[tile] {
                own(batches).end::<L>(contacts, &exact.of(tiles.contacts(tile)), increments);
            }
            NOTHING
        };
        over_colours(tiles, &mut self.contacts, &mut self.batches, SCHEDULE.passes, end);
    }
}

/// The first of some tiles, which nobody else has.
pub(super) fn own<const D: usize>(batches: &mut [Mutex<TileBatches<D>>]) -> &mut TileBatches<D> {
    batches[0].get_mut().expect("a tile in a panic")
}

thread_local! {
    /// What the tile in hand has changed of the velocities of its bodies.
    static BODIES: RefCell<Vec<[f32; 4]>> = const { RefCell::new(vec![]) };
}

/// One pass over a tile, on a copy of its bodies: sum of the squares of the changes, and of what they have of the step
/// before them, with its sign turned.
fn sweep_tile<L: Law, const D: usize, const LAGS: bool>(
    tile: &mut TileBatches<D>,
    increments: &Increments,
    beta: Option<f32>,
) -> [f64; 2] {
    BODIES.with_borrow_mut(|bodies| {
        tile.take(increments, beta, bodies);
        let sums = on_this_processor::<L, D, LAGS>(tile, bodies, beta.unwrap_or(0.0));
        tile.give(increments, bodies);
        sums
    })
}

/// By vector units where there are any.
fn on_this_processor<L: Law, const D: usize, const LAGS: bool>(
    tile: &mut TileBatches<D>,
    bodies: &mut [[f32; 4]],
    beta: f32,
) -> [f64; 2] {
    #[cfg(target_arch = "x86_64")]
    if let Some(unit) = pulp::x86::V3::try_new() {
        struct Sweep<'a, L, const D: usize, const LAGS: bool>(
            pulp::x86::V3,
            &'a mut TileBatches<D>,
            &'a mut [[f32; 4]],
            f32,
            std::marker::PhantomData<L>,
        );
        impl<L: Law, const D: usize, const LAGS: bool> pulp::NullaryFnOnce for Sweep<'_, L, D, LAGS> {
            type Output = [f64; 2];
            #[inline(always)]
            fn call(self) -> [f64; 2] {
                relax::<super::lanes::Avx, L, D, LAGS>(self.0, self.1, self.2, self.3)
            }
        }
        return unit.vectorize(Sweep::<L, D, LAGS>(unit, tile, bodies, beta, std::marker::PhantomData));
    }
    relax::<super::lanes::Portable, L, D, LAGS>((), tile, bodies, beta)
}

/// Solves each contact of a tile exactly for the velocities that those before it have left, and moves its bodies.
#[inline(always)]
pub(super) fn relax<E: Eight, L: Law, const D: usize, const LAGS: bool>(
    unit: E::Unit,
    tile: &mut TileBatches<D>,
    bodies: &mut [[f32; 4]],
    beta: f32,
) -> [f64; 2] {
    let (beta, zero) = (E::all(unit, beta), E::all(unit, 0.0));
    let (mut squares, mut turn) = (zero, zero);
    for (k, x) in tile.batches.iter_mut().enumerate() {
        let load = |from: &_| E::load(unit, from);
        let side =
            |side: usize| E::columns(unit, from_fn::<_, LANES, _>(|l| &bodies[x.bodies[side][l] as usize]));
        let [mut i, mut j] = [side(0), side(1)];
        let frame = frame::<E, D>(unit, x.normal.each_ref().map(load));
        let mut u: [E; D] =
            from_fn(|a| (0..D).fold(load(&x.speed[a]), |sum, b| (j[b] - i[b]).mul_add(frame[a][b], sum)));
        let spins = L::SPIN && D == 2;
        if spins {
            u[1] = u[1] - (i[D] + j[D]);
        }
        let before = x.change.each_ref().map(load);
        let last = x.last.each_ref().map(load);
        let base = x.base.each_ref().map(load);
        let start: [E; D] = from_fn(|a| beta.mul_add(before[a] - last[a], before[a]));
        let mut after = [zero; D];
        after[0] = u[0].neg_mul_add(load(&x.mass[0]), start[0]).max(-base[0]);
        if L::FRICTION {
            let mu = load(&x.friction);
            let mut more = mu * after[0];
            if LAGS {
                more = mu.where_above(E::all(unit, SCHEDULE.strong as f32), load(&tile.lags[k]), more);
            }
            let up = more + load(&x.room);
            if L::ROLLING {
                let rolling = &mut tile.rolling[k];
                let [share_i, share_j] = rolling.share.each_ref().map(load);
                let speed = i[D].neg_mul_add(share_i, j[D].mul_add(share_j, load(&rolling.speed)));
                let (rolled, before_last) = (load(&rolling.change), load(&rolling.last));
                let begun = beta.mul_add(rolled - before_last, rolled);
                let more_rolling = load(&rolling.resistance) * after[0];
                let [up_rolling, low_rolling] = rolling.room.each_ref().map(|room| more_rolling + load(room));
                let limits = [[up, more + base[1]], [up_rolling, low_rolling]];
                let [t, q] = rub_and_roll(unit, rolling, [start[1], begun], [u[1], speed], limits);
                after[1] = t;
                let turned = q - begun;
                (squares, turn) = (turned.mul_add(turned, squares), turned.neg_mul_add(q - rolled, turn));
                (rolling.last, rolling.change) = (rolling.change, q.store());
                let [turning_i, turning_j] = x.turning.each_ref().map(load);
                i[D] = (turned * share_i).neg_mul_add(turning_i, i[D]);
                j[D] = (turned * share_j).mul_add(turning_j, j[D]);
            } else {
                let mass = load(&x.mass[1]);
                let free = from_fn(|a| if a == 0 { zero } else { u[a].neg_mul_add(mass, start[a]) });
                let cut = within(free, base, more, up);
                (1..D).for_each(|a| after[a] = cut[a]);
            }
        }
        let change: [E; D] = from_fn(|a| after[a] - start[a]);
        for a in 0..D {
            squares = change[a].mul_add(change[a], squares);
            turn = change[a].neg_mul_add(after[a] - before[a], turn);
        }
        (x.last, x.change) = (x.change, after.map(E::store));
        let [mass_i, mass_j] = x.mobility.each_ref().map(load);
        for b in 0..D {
            let push = (1..D).fold(change[0] * frame[0][b], |sum, a| change[a].mul_add(frame[a][b], sum));
            i[b] = push.neg_mul_add(mass_i, i[b]);
            j[b] = push.mul_add(mass_j, j[b]);
        }
        if spins {
            let [turning_i, turning_j] = x.turning.each_ref().map(load);
            i[D] = change[1].neg_mul_add(turning_i, i[D]);
            j[D] = change[1].neg_mul_add(turning_j, j[D]);
        }
        for (side, columns) in [i, j].into_iter().enumerate() {
            for (l, row) in E::rows(columns).into_iter().enumerate() {
                bodies[x.bodies[side][l] as usize] = row;
            }
        }
    }
    [squares.store().sum(), turn.store().sum()]
}

/// The normal and unit tangents, as [`tangent`](crate::space::tangent) has them.
#[inline(always)]
fn frame<E: Eight, const D: usize>(unit: E::Unit, n: [E; D]) -> [[E; D]; D] {
    let mut frame = [n; D];
    if D == 2 {
        (frame[1][0], frame[1][1]) = (-n[1], n[0]);
    } else if D == 3 {
        let (one, zero) = (E::all(unit, 1.0), E::all(unit, 0.0));
        let sign = zero.where_above(n[2], -one, one);
        let a = -one / (sign + n[2]);
        let b = n[0] * n[1] * a;
        (frame[1][0], frame[1][1], frame[1][2]) =
            ((sign * n[0] * n[0]).mul_add(a, one), sign * b, -(sign * n[0]));
        (frame[2][0], frame[2][1], frame[2][2]) = (b, (n[1] * n[1]).mul_add(a, sign), -n[1]);
    }
    frame
}

/// Changes of a tangential impulse (behind the first of D numbers) cut so that friction stays within a bound which
/// grows by `more`; `up` is that and the room that there was.
#[inline(always)]
fn within<E: Eight, const D: usize>(change: [E; D], base: [E; D], more: E, up: E) -> [E; D] {
    let mut cut = change;
    if D == 2 {
        cut[1] = change[1].max(-(more + base[1])).min(up);
        return cut;
    }
    let product = |x: &[E; D], y: &[E; D]| (2..D).fold(x[1] * y[1], |sum, a| x[a].mul_add(y[a], sum));
    let all: [E; D] = from_fn(|a| base[a] + change[a]);
    let [square, before] = [product(&change, &change), product(&base, &base)];
    let [size, length] = [product(&all, &all).sqrt(), before.sqrt()];
    // |p0 + d| - |p0| without a difference of large numbers.
    let longer = (product(&all, &change) + product(&base, &change)) / (size + length);
    let (share, most) = ((longer - up) / size, (up + length) / size);
    for a in 1..D {
        // Rounding is relative to the smaller one of p0 and d. What is not cut stays as it is, to the bit.
        let [near, far] = [share.neg_mul_add(all[a], change[a]), all[a].mul_add(most, -base[a])];
        cut[a] = longer.where_above(up, before.where_above(square, near, far), change[a]);
    }
    cut
}

/// [`Rolling::solve`](crate::rolling::Rolling::solve) for changes: those of the tangential impulse and of that of
/// rolling, from `start` and the speeds `u`, which may go up and down as far as the `limits` say.
#[inline(always)]
fn rub_and_roll<E: Eight>(
    unit: E::Unit,
    rolling: &RollingBatch,
    start: [E; 2],
    u: [E; 2],
    limits: [[E; 2]; 2],
) -> [E; 2] {
    let load = |from: &_| E::load(unit, from);
    let zero = E::all(unit, 0.0);
    let [i_r, i_c, i_t] = rolling.inverse.each_ref().map(load);
    let (w_t, w_tr, mass) = (load(&rolling.rub), load(&rolling.coupling), load(&rolling.mass));
    let cut = |x: E, k: usize| x.max(-limits[k][1]).min(limits[k][0]);
    let free = [start[0] - i_c.neg_mul_add(u[1], i_r * u[0]), start[1] - i_c.neg_mul_add(u[0], i_t * u[1])];
    let (t, q) = (cut(free[0], 0), cut(free[1], 1));
    let roll = |t: E| cut(w_tr.mul_add(t - start[0], u[1]).neg_mul_add(mass, start[1]), 1);
    let rub = |q: E| cut(start[0] - w_tr.mul_add(q - start[1], u[0]) / w_t, 0);
    // The three answers: held by friction, held by the resistance to rolling, or by none.
    let [by_friction, by_rolling] = [[t, roll(t)], [rub(q), q]];
    let passed = free[0] - t;
    let beyond = [passed.abs(), (free[1] - q).abs()];
    let slip = w_tr.mul_add(by_friction[1] - start[1], w_t.mul_add(t - start[0], u[0]));
    // Friction is at the side that was passed, and opposes the slip there if it can be held.
    let wrong = slip * passed;
    from_fn(|k| {
        let without = beyond[1].where_above(zero, by_rolling[k], [t, q][k]);
        let both = wrong.where_above(zero, by_rolling[k], by_friction[k]);
        let with = beyond[1].where_above(zero, both, by_friction[k]);
        beyond[0].where_above(zero, with, without)
    })
}
