//! Grains in a fluid, and the phases of their step.

use crate::backend::Immersed;
use crate::closure::Surroundings;
use crate::droplet::surface::Surface;
use crate::droplet::wet::{Taken, taken_within};
use crate::droplet::{Droplet, GrainShare};
use crate::exchange::{OnMesh, Rigid};
use crate::interaction::relative;
use crate::load::GrainLoad;
use crate::motions::Motions;
use crate::parts::{Part, Parts};
use crate::scheme::anchored::Forcing;
use crate::{Error, Fluid, HEAT, Interaction, Notice, Result, StepReport, overlap};
use rayon::prelude::*;
use std::time::Instant;
use voidage_dem::{Dem, Halo, Load};
use voidage_fluid::Vector;
use voidage_fluid::conditions::ScalarCondition;

/// Grains in a fluid. A [scheme](crate::scheme::Scheme) advances it by the phases below.
#[derive(Default)]
pub struct Mixture<const D: usize> {
    /// The grains.
    pub grains: Dem<D>,
    /// The fluid.
    pub fluid: Fluid<D>,
    /// Their exchange.
    pub interaction: Interaction<D>,
    /// What the grains got in the step in hand.
    pub motions: Motions<D>,
    /// What was given and taken in the parts of the step in hand; absent while the step is whole.
    pub(crate) parts: Option<Parts<D>>,
    phase: Phase,
}

/// How far a step has come: what later phases may build on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    /// The last step, or part of a step, is accepted.
    #[default]
    Accepted,
    /// The grains are cut by the mesh.
    Cut,
    /// The laws of the exchange have been evaluated.
    Closed,
    /// The fluid has been solved.
    Solved,
}

/// What the grains take of a droplet with another surface.
fn taken<'a, const D: usize>(
    grains: &'a Dem<D>,
    droplet: Option<&Droplet<D>>,
) -> impl Fn(&Surface<D>, &Vector<D>, f64) -> Taken + use<'a, D> {
    let share = droplet.map_or_else(GrainShare::default, |droplet| droplet.material.choices.grain_share);
    move |surface, centre, radius| taken_within(&grains.particles, surface, (centre, radius), share)
}

impl<const D: usize> Mixture<D> {
    /// Grains in a fluid, before their first step. Of a droplet that holds grains already the rest is liquid.
    pub fn new(grains: Dem<D>, mut fluid: Fluid<D>, interaction: Interaction<D>) -> Self {
        if let Some(droplet) = fluid.live_droplet() {
            let place = (&droplet.state.centre, droplet.state.radius);
            let share = droplet.material.choices.grain_share;
            let taken = taken_within(&grains.particles, droplet.surface(), place, share);
            droplet.hold(taken.volume);
        }
        Self { grains, fluid, interaction, motions: Motions::default(), parts: None, phase: Phase::Accepted }
    }

    /// Refuses a phase that needs an earlier one.
    fn needs(&self, phase: Phase, called: &str, first: &str) -> Result<()> {
        match self.phase >= phase {
            true => Ok(()),
            false => Err(Error::run(Notice::new(
                format!("a scheme called `{called}` before `{first}` of this step"),
                "the phases are cut_grains, evaluate_closures, solve_fluid, move_grains or drive_grains, accept",
            ))),
        }
    }

    /// Pieces of the grains on the mesh and the voidage they make.
    ///
    /// # Errors
    /// A grain lies outside the mesh, and not behind an open boundary.
    pub fn cut_grains(&mut self, report: &mut StepReport) -> Result<()> {
        let start = Instant::now();
        let (particles, fluid) = (&self.grains.particles, &self.fluid);
        let Interaction { laws, load, overlap: cutter, .. } = &mut self.interaction;
        let GrainLoad { pieces, volume, .. } = load;
        cutter.kernel = laws.kernel;
        cutter.cut(&fluid.mesh, &particles.position, &particles.radius, pieces, volume)?;
        let swallowed = self.cut_by_droplet();
        let (particles, fluid) = (&self.grains.particles, &self.fluid);
        let Interaction { overlap: cutter, .. } = &mut self.interaction;
        if !cutter.outside().is_empty() {
            self.check_outside()?;
        }
        let Interaction { load, .. } = &mut self.interaction;
        let GrainLoad { pieces, voidage, volume, .. } = load;
        volume.iter_mut().zip(&particles.volume).for_each(|(inside, whole)| *inside *= whole);
        let volume = overlap::voidage(&fluid.mesh, pieces, volume, &fluid.nodal_volume, voidage);
        let exact = particles.volume.iter().sum::<f64>() - swallowed;
        report.solid_volume_defect = Some(relative((volume - exact).abs(), exact));
        self.find_appearing();
        report.phases.overlap += start.elapsed().as_secs_f64();
        self.phase = Phase::Cut;
        Ok(())
    }

    /// What of the grains a droplet has in its water; returns their volume there, m2. What the gas still had to give to
    /// grains that are wholly there becomes the business of the droplet.
    fn cut_by_droplet(&mut self) -> f64 {
        let Interaction { wet, overlap, carried, .. } = &mut self.interaction;
        let Some(droplet) = self.fluid.live_droplet() else {
            *wet = None;
            return 0.0;
        };
        let wet = wet.get_or_insert_default();
        droplet.begin();
        let (centre, radius) = (droplet.state.centre, droplet.state.radius);
        let share = droplet.material.choices.grain_share;
        wet.cut(&self.grains.particles, droplet.surface(), (&centre, radius), share);
        let swallowed = overlap.outside().iter().map(|grain| *grain as usize);
        let swallowed: Vec<usize> = swallowed.filter(|grain| wet.swallows(*grain)).collect();
        overlap.find(|grain| wet.swallows(grain));
        if let Some(carried) = carried {
            for grain in swallowed {
                let (impulse, heat) = carried.take(grain);
                droplet.inherit(&impulse, heat);
            }
            // It is no longer between grains and gas.
            carried.change();
        }
        wet.solid()
    }

    /// Drag and heat-transfer coefficients, added mass and lift in a solution of the fluid or a motion of the grains over
    /// `dt`, with the fluid that the grains have met last and the present velocities of the grains. The law by which the
    /// water of a droplet holds them follows the first call after the grains have been cut.
    ///
    /// # Errors
    /// The grains have not been cut.
    pub fn evaluate_closures(&mut self, dt: f64, report: &mut StepReport) -> Result<()> {
        self.needs(Phase::Cut, "evaluate_closures", "cut_grains")?;
        let start = Instant::now();
        let first = self.phase == Phase::Cut;
        let particles = &self.grains.particles;
        let Interaction { laws, load, at, voidage: means, .. } = &mut self.interaction;
        let (pieces, voidage, mesh) = (&load.pieces, &load.voidage, &self.fluid.mesh);
        means.par_iter_mut().enumerate().with_min_len(256).for_each(|(i, mean)| {
            // A grain that has left the mesh is alone.
            *mean = if pieces.of(i).is_empty() { 1.0 } else { pieces.mean(i, mesh, voidage) };
        });
        let around = |i: usize| Surroundings {
            slip: (at.velocity[i] - particles.velocity[i]).norm(),
            voidage: means[i],
            diameter: 2.0 * particles.radius[i],
            density: laws.density,
            viscosity: laws.viscosity,
        };
        // Solid volume of each grain in the mesh, and the share of it that this is.
        let inside = |i: usize| (load.volume[i], load.volume[i] / particles.volume[i]);
        load.drag.par_iter_mut().enumerate().with_min_len(256).for_each(|(i, gamma)| {
            let around = around(i);
            let volume = laws.per.in_drag(inside(i), around.diameter);
            *gamma = volume * laws.drag.coefficient(&around, laws.voidage_function);
        });
        if let (Some(heat), Some(thermal)) = (&mut load.heat, &laws.thermal) {
            heat.coefficient.par_iter_mut().enumerate().with_min_len(256).for_each(|(i, coefficient)| {
                let around = around(i);
                let volume = laws.per.in_heat(inside(i), around.diameter);
                *coefficient = volume * laws.heat.coefficient(&around, thermal, laws.voidage_function);
            });
        }
        self.add_unsteady(dt);
        let particles = &self.grains.particles;
        let Interaction { wet, .. } = &mut self.interaction;
        if let (true, Some(droplet), Some(wet)) = (first, &mut self.fluid.droplet, wet) {
            let water = &droplet.material.water;
            let liquid = droplet.material.choices.inside.of(droplet.state.liquid / droplet.volume());
            wet.evaluate_closures(particles, (water, liquid), &droplet.state.velocity);
            // Now, as the grains that its surface has come to cut are hot: the water cools them in the step.
            let (state, temperature) = (&droplet.state, droplet.material.temperature);
            let (place, moved) = ((&state.centre, state.radius), (&state.way, temperature, dt));
            droplet.taken_in = wet.taken_in(particles, droplet.surface(), place, moved);
        }
        match self.interaction.sticks_below.is_empty() {
            true => self.interaction.cohesive.clear(),
            false => self.find_cohesive(),
        }
        report.phases.closure += start.elapsed().as_secs_f64();
        self.phase = self.phase.max(Phase::Closed);
        Ok(())
    }

    /// The part of added mass and lift in the drag and the forcing of the grains, in a step of `dt`.
    fn add_unsteady(&mut self, dt: f64) {
        let Self { grains, fluid, interaction, .. } = self;
        let Interaction { laws, load, voidage, felt, .. } = interaction;
        let GrainLoad { pieces, volume, drag, added, known, .. } = load;
        if laws.unsteady.is_none() {
            added.clear();
            known.clear();
            felt.clear();
            return;
        }
        let particles = &grains.particles;
        added.resize(particles.len(), 0.0);
        known.resize(particles.len(), Vector::zeros());
        let flow = (&fluid.on_mesh(), fluid.mesh_velocity());
        let columns = (drag.par_iter_mut(), added.par_iter_mut(), known.par_iter_mut()).into_par_iter();
        columns.enumerate().with_min_len(256).for_each(|(i, (drag, added, known))| {
            let around = Surroundings {
                slip: 0.0,
                voidage: voidage[i],
                diameter: 2.0 * particles.radius[i],
                density: laws.density,
                viscosity: laws.viscosity,
            };
            let grain = (volume[i], particles.velocity[i]);
            (*added, *known) = laws.unsteady.of((pieces, i), flow, grain, &around, dt);
            *drag += *added / dt;
            if *drag == 0.0 {
                *known = Vector::zeros();
            }
        });
    }

    /// Contacts of a grain stick where scalars of the fluid, as means over its pieces at the last accepted step, are
    /// below their bounds (vapour in Henry et al., Eq. 18). In the water of a droplet they have the value of its
    /// surface. Grains that have left the mesh may stick.
    fn find_cohesive(&mut self) {
        let Interaction { load, sticks_below, cohesive, wet, .. } = &mut self.interaction;
        let (pieces, mesh, scalars) = (&load.pieces, &self.fluid.mesh, &self.fluid.accepted.scalars);
        let surface = self.fluid.droplet.as_ref().and_then(|droplet| {
            self.fluid.conditions.iter().find(|condition| condition.boundary == droplet.boundary)
        });
        let dry = |grain: usize| {
            let share = wet.as_ref().map_or(0.0, |wet| wet.share(grain));
            sticks_below.iter().all(|(scalar, bound)| {
                let gas = pieces.mean(grain, mesh, &scalars[*scalar]);
                let water = match surface.map(|surface| surface.scalar(*scalar)) {
                    Some(ScalarCondition::Value(value)) => value.at(0),
                    // Nothing is dry in water.
                    _ if wet.as_ref().is_some_and(|wet| wet.swallows(grain)) => return false,
                    _ => gas,
                };
                (1.0 - share) * gas + share * water < *bound
            })
        };
        cohesive.clear();
        cohesive.resize(pieces.grains(), true);
        cohesive.par_iter_mut().enumerate().with_min_len(256).for_each(|(grain, sticks)| {
            let gone = pieces.of(grain).is_empty() && wet.as_ref().is_none_or(|wet| !wet.swallows(grain));
            *sticks = gone || dry(grain);
        });
    }

    /// Round the droplet cohesion falls off, where the laws say so.
    fn halo(&self) -> Option<Halo<D>> {
        let length = self.interaction.halo?;
        let state = &self.fluid.droplet.as_ref().filter(|droplet| !droplet.state.gone)?.state;
        Some(Halo { centre: state.centre, radius: state.radius, length: length * state.radius })
    }

    /// One solution of the fluid from its last accepted state.
    ///
    /// # Errors
    /// The laws have not been evaluated; the solver failed.
    pub fn solve_fluid(&mut self, dt: f64, report: &mut StepReport) -> Result<()> {
        self.needs(Phase::Closed, "solve_fluid", "evaluate_closures")?;
        let start = Instant::now();
        let Self { fluid, interaction, .. } = self;
        if let (Some(droplet), Some(wet)) = (&mut fluid.droplet, &interaction.wet) {
            let grains = (&interaction.load, &interaction.at);
            droplet.immerse(wet.immersion(droplet.surface(), &droplet.stream(), grains));
        }
        let Interaction { load, points, laws, appearing, overlap, .. } = interaction;
        let rigid = Rigid { fluid: fluid.on_mesh(), density: laws.density, dt };
        load.fill_points(&rigid, (HEAT, fluid.scalars.len()), points);
        let before = report.phases;
        let source = appearing.source(dt, (&fluid.mesh, &fluid.nodal_volume), overlap)?;
        let immersed = Immersed { points, voidage: &load.voidage, source: source.as_deref() };
        fluid.solve(dt, Some(immersed), report)?;
        interaction.receive(&OnMesh { mesh: &fluid.mesh, fields: &fluid.solution.fields });
        report.phases.exchange += start.elapsed().as_secs_f64() - report.phases.of_solver_since(&before);
        self.phase = Phase::Solved;
        Ok(())
    }

    /// Contacts and motion of the grains over `dt` under the forces and heat of the fluid. Further motions before the next
    /// [`Self::accept`] go on from there: the means over the step are those over all of them.
    pub fn move_grains(&mut self, dt: f64, report: &mut StepReport) {
        let start = Instant::now();
        let before = (self.motions.time() > 0.0).then(|| self.grains.means());
        let halo = self.halo();
        let Interaction { force, heat, cohesive, wet, .. } = &mut self.interaction;
        let load = match (&self.fluid.droplet, wet) {
            (Some(droplet), Some(wet)) => {
                Load { cohesive, halo, ..wet.add((force, heat), (&[], &[]), &droplet.stream()) }
            }
            _ => Load { force, heat, cohesive, halo, ..Load::default() },
        };
        let moved = self.grains.step(dt, &load);
        self.report_motion(moved, start, report);
        let share = self.book_moved(dt);
        if let Some(before) = before {
            self.grains.go_on_from(&before, share);
        }
    }

    /// What drag and added mass felt of the motion of each grain in a step that [`Self::drive_grains`] made in one motion,
    /// m/s: without added mass the mean velocity. The force on a grain was its forcing less gamma times it.
    pub fn felt(&self) -> &[Vector<D>] {
        let felt = &self.interaction.felt;
        if felt.is_empty() { self.grains.mean_velocity() } else { felt }
    }

    /// The same under a forcing of the fluid with implicit drag and heat transfer: the force on a grain is
    /// forcing.force - gamma v, and its heat forcing.heat - hA T, with v that it [felt](Self::felt) and the mean
    /// temperature over the step. Contacts are solved with the mass m + gamma dt.
    ///
    /// # Errors
    /// The laws have not been evaluated.
    pub fn drive_grains(&mut self, dt: f64, forcing: &Forcing<D>, report: &mut StepReport) -> Result<()> {
        self.needs(Phase::Closed, "drive_grains", "evaluate_closures")?;
        let start = Instant::now();
        let before = (self.motions.time() > 0.0).then(|| self.grains.means());
        let halo = self.halo();
        let Interaction { load, cohesive, wet, felt, .. } = &mut self.interaction;
        let transfer = load.heat.as_ref().map_or(&[][..], |heat| &heat.coefficient);
        let Forcing { force, heat } = forcing;
        let steady = load.without_added(force, &self.grains.particles.velocity, dt);
        let (force, drag) = steady.as_ref().map_or((force, &load.drag), |(force, drag)| (force, drag));
        let mut acting = match (&self.fluid.droplet, wet) {
            (Some(droplet), Some(wet)) => {
                Load { cohesive, halo, ..wet.add((force, heat), (drag, transfer), &droplet.stream()) }
            }
            _ => Load { force, drag, heat, transfer, cohesive, halo, ..Load::default() },
        };
        acting.added = &load.added;
        let moved = self.grains.step(dt, &acting);
        felt.clear();
        if let Some((_, drag)) = &steady {
            let (mean, end) = (self.grains.mean_velocity(), &self.grains.particles.velocity);
            felt.extend((0..mean.len()).map(|i| {
                let inertia = load.added[i] / dt;
                let whole = drag[i] + inertia;
                if whole > 0.0 { (mean[i] * drag[i] + end[i] * inertia) / whole } else { mean[i] }
            }));
        }
        self.report_motion(moved, start, report);
        let share = self.book_driven(dt, forcing);
        if let Some(before) = before {
            self.grains.go_on_from(&before, share);
        }
        Ok(())
    }

    /// How far a droplet moved in a step of `dt` over the diameter of the smallest grain in its water, and how much of
    /// the limit of stability its absorption of hot grains takes, both without unit; zero without a droplet, or grains
    /// in it.
    pub(crate) fn droplet_reach(&mut self, dt: f64) -> (f64, f64) {
        let Self { fluid, interaction, .. } = self;
        let (Some(wet), Some(droplet)) = (&interaction.wet, fluid.live_droplet()) else { return (0.0, 0.0) };
        droplet.absorption = droplet.absorption_rate();
        (droplet.travel(dt) / wet.smallest(), droplet.absorption * dt)
    }

    /// A place where a cell of the mesh would turn over if the last solution of the fluid, which was over `dt`, were
    /// accepted, if there is one: a droplet moves the mesh.
    pub(crate) fn turns_over(&mut self, dt: f64) -> Result<Option<Vector<D>>> {
        let Self { grains, fluid, .. } = self;
        fluid.turns_over(dt, taken(grains, fluid.droplet.as_deref()))
    }

    /// Makes the last solution of the fluid the accepted one and moves the clock: the end of a step.
    ///
    /// # Errors
    /// The fluid has not been solved.
    pub fn accept(&mut self, dt: f64, report: &mut StepReport) -> Result<()> {
        self.accept_part(Part::whole(dt), report)?;
        self.end_step(report);
        Ok(())
    }

    /// A step begins: nothing of one that was not ended counts.
    pub fn begin_step(&mut self) {
        self.motions.begin();
        self.parts = None;
        self.interaction.open = None;
    }

    /// A part of a step of `dt` begins: the mesh goes to where it is at its end.
    pub fn begin_part(&mut self, dt: f64) {
        self.move_mesh(|motion, time, points| motion.advance(time, dt, points));
    }

    /// Counts a step whose parts have all been accepted. What grains, walls and boundaries got in it is now the mean over
    /// them.
    pub fn end_step(&mut self, report: &mut StepReport) {
        self.interaction.close(report);
        if let Some(parts) = self.parts.take() {
            parts.put(self);
        }
        self.fluid.clock.steps += 1;
    }

    /// Accepts the last solution of the fluid, which was over a part of a step, and the motions of the grains since the
    /// part before.
    ///
    /// # Errors
    /// The fluid has not been solved.
    pub fn accept_part(&mut self, part: Part, report: &mut StepReport) -> Result<()> {
        self.needs(Phase::Solved, "accept", "solve_fluid")?;
        let Part { dt, whole } = part;
        let moved = self.motions.time();
        if moved > 0.0 {
            self.interaction.force.clone_from(&self.motions.force);
            self.interaction.heat.clone_from(&self.motions.heat);
        }
        let mut parts = self.parts.take().or_else(|| (dt < whole).then(Parts::default));
        if let Some(parts) = &mut parts {
            parts.add(self, dt / whole, moved / whole);
        }
        let Self { grains, fluid, interaction, .. } = self;
        if let (Some(droplet), Some(wet)) = (&mut fluid.droplet, &interaction.wet) {
            let moved = (grains.mean_velocity(), grains.mean_temperature());
            droplet.settle(dt, |stream, before| wet.settle(moved, stream, before));
        }
        fluid.accept_around(dt, taken(grains, fluid.droplet.as_deref()))?;
        if let Some(wet) = &interaction.wet {
            interaction.overlap.moved(&fluid.mesh);
            if let Some(droplet) = fluid.live_droplet() {
                droplet.count_passed(&grains.particles, wet);
            }
        }
        if let Some(parts) = &mut parts {
            parts.add_droplet(fluid.droplet.as_deref(), dt / whole);
        }
        self.parts = parts;
        self.interaction.balance((dt, moved), report);
        self.motions.begin();
        let appearing = &mut self.interaction.appearing;
        *report.appeared.get_or_insert_default() += appearing.volume();
        appearing.settle(dt);
        self.phase = Phase::Accepted;
        Ok(())
    }
}
