//! What a scene is made of, and its step.

use crate::droplet::wet::Taken;
use crate::scheme::Scheme;
use crate::{Clock, Error, Fluid, Interaction, Mixture, Notice, Result, StepReport};
use std::time::Instant;
use voidage_dem::{Dem, Load, Passage};

/// What a scene is made of. A scene pays nothing for what it does not have.
pub enum System<const D: usize> {
    /// Grains alone, with their clock.
    Grains(Box<Dem<D>>, Clock),
    /// A fluid alone.
    Fluid(Box<Fluid<D>>),
    /// Grains in a fluid.
    Mixture(Box<Mixture<D>>),
}

/// The error of a step in which no grain moved, because one would have been thrown out.
fn runaway<const D: usize>(system: &System<D>, grain: u32, speed: f64) -> Error {
    let grains = match system {
        System::Grains(grains, _) => Some(&**grains),
        System::Mixture(mixture) => Some(&mixture.grains),
        System::Fluid(_) => None,
    };
    let id = grains.map_or(0, |grains| grains.particles.id[grain as usize]);
    Error::run(Notice::new(
        format!(
            "grain {id} would go at {speed:.1e} m/s in this step: the forces on it are out of all proportion"
        ),
        "look at the fields of the fluid at this grain, at `time.step`, and at the numbers of the scene",
    ))
}

/// A system beside the scheme that advances it, if grains and fluid act on each other.
pub struct Coupled<const D: usize> {
    /// The system.
    pub system: System<D>,
    scheme: Box<dyn Scheme<D>>,
    /// Sources and sinks of grains; absent without.
    pub passage: Option<Box<Passage<D>>>,
}

impl<const D: usize> Coupled<D> {
    /// A system with its scheme; grains or fluid alone do not use it.
    pub fn new(system: System<D>, scheme: Box<dyn Scheme<D>>) -> Self {
        Self { system, scheme, passage: None }
    }

    /// One step of `dt`: the mesh moves, grains and fluid move, and the domain is remeshed if it is time.
    ///
    /// # Errors
    /// The fluid solver failed or a grain left the mesh; the state is then that before the step (before the part that
    /// failed, where a scheme does a step in parts), except that the grains' hints and load columns may be those of the
    /// failed step.
    pub fn step(&mut self, dt: f64) -> Result<StepReport> {
        let done = self.take_step(dt);
        if done.is_err() {
            self.place_mesh();
        }
        done
    }

    fn take_step(&mut self, dt: f64) -> Result<StepReport> {
        let mut report = StepReport::default();
        let waiting = self.feed(dt)?;
        self.advance_mesh(dt, &mut report)?;
        match &mut self.system {
            System::Grains(grains, clock) => {
                let start = Instant::now();
                let moved = grains.step(dt, &Load::default());
                report.grains = Some(moved);
                report.phases.contacts += start.elapsed().as_secs_f64();
                // Grains of which one runs away have not moved.
                if moved.runaway.is_none() {
                    let taken =
                        self.passage.as_mut().map_or(vec![], |passage| passage.take(grains, dt, |_| false));
                    if !taken.is_empty() {
                        grains.retain(&taken.iter().map(|taken| !taken).collect::<Vec<_>>());
                    }
                    *clock = Clock { time: clock.time + dt, steps: clock.steps + 1 };
                }
            }
            System::Fluid(fluid) => {
                if let Some(droplet) = fluid.live_droplet() {
                    droplet.begin();
                }
                fluid.solve(dt, None, &mut report)?;
                if fluid.turns_over(dt, |_, _, _| Taken::default())?.is_some() {
                    fluid.renew(&mut report)?;
                    fluid.solve(dt, None, &mut report)?;
                }
                fluid.accept(dt)?;
                fluid.clock.steps += 1;
            }
            System::Mixture(mixture) => {
                let renewed = std::mem::take(&mut report);
                mixture.begin_step();
                report = self.scheme.step(mixture, dt)?;
                if let Some((grain, speed)) = report.grains.and_then(|grains| grains.runaway) {
                    return Err(runaway(&self.system, grain, speed));
                }
                report.remeshed |= renewed.remeshed;
                report.phases.remesh += renewed.phases.remesh;
                let passage = self.passage.as_mut();
                let taken = passage
                    .map_or(vec![], |p| p.take(&mixture.grains, dt, |grain| mixture.is_outside(grain)));
                mixture.dismiss(&taken);
            }
        }
        if let Some((grain, speed)) = report.grains.and_then(|grains| grains.runaway) {
            return Err(runaway(&self.system, grain, speed));
        }
        report.waiting = waiting;
        self.remesh(&mut report)?;
        Ok(report)
    }

    /// Lets grains in by the sources, at the start of a step of `dt`; the source that has most grains without a place,
    /// and how many.
    fn feed(&mut self, dt: f64) -> Result<Option<(usize, u64)>> {
        let Some(mut passage) = self.passage.take() else { return Ok(None) };
        let waiting = self.feed_from(&mut passage, dt);
        self.passage = Some(passage);
        waiting
    }

    fn feed_from(&mut self, passage: &mut Passage<D>, dt: f64) -> Result<Option<(usize, u64)>> {
        let mut waiting = None;
        for k in 0..passage.sources.len() {
            let Some(grains) = self.grains() else { break };
            let drawn = passage.draw(k, grains, dt)?;
            let late = passage.state().fed[k].waiting;
            if late > waiting.map_or(0, |(_, most)| most) {
                waiting = Some((k, late));
            }
            if drawn.is_empty() {
                continue;
            }
            match &mut self.system {
                System::Grains(grains, _) => grains.add(drawn)?,
                System::Mixture(mixture) => mixture.add(&passage.sources[k].name, drawn)?,
                System::Fluid(_) => {}
            }
        }
        if let Some(grains) = self.grains() {
            passage.begin(&grains.particles);
        }
        Ok(waiting)
    }

    /// Advances by another scheme from now on.
    pub fn set_scheme(&mut self, scheme: Box<dyn Scheme<D>>) {
        self.scheme = scheme;
    }

    /// Time and steps.
    pub fn clock(&self) -> Clock {
        match &self.system {
            System::Grains(_, clock) => *clock,
            System::Fluid(fluid) => fluid.clock,
            System::Mixture(mixture) => mixture.fluid.clock,
        }
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.clock().time
    }

    /// Steps done.
    pub fn steps(&self) -> u64 {
        self.clock().steps
    }

    /// Sets time and number of steps, at a restart.
    pub fn set_time(&mut self, time: f64, steps: u64) {
        match &mut self.system {
            System::Grains(_, clock) => *clock = Clock { time, steps },
            System::Fluid(fluid) => fluid.clock = Clock { time, steps },
            System::Mixture(mixture) => mixture.fluid.clock = Clock { time, steps },
        }
    }

    /// Grains and fluid, if both are there.
    pub fn mixture(&self) -> Option<&Mixture<D>> {
        if let System::Mixture(mixture) = &self.system { Some(mixture) } else { None }
    }

    /// The same, to change between two steps.
    pub fn mixture_mut(&mut self) -> Option<&mut Mixture<D>> {
        if let System::Mixture(mixture) = &mut self.system { Some(mixture) } else { None }
    }

    /// The grains, if there are any.
    pub fn grains(&self) -> Option<&Dem<D>> {
        match &self.system {
            System::Grains(grains, _) => Some(grains),
            System::Fluid(_) => None,
            System::Mixture(mixture) => Some(&mixture.grains),
        }
    }

    /// The same, to change between two steps.
    pub fn grains_mut(&mut self) -> Option<&mut Dem<D>> {
        match &mut self.system {
            System::Grains(grains, _) => Some(grains),
            System::Fluid(_) => None,
            System::Mixture(mixture) => Some(&mut mixture.grains),
        }
    }

    /// The fluid, if there is one.
    pub fn fluid(&self) -> Option<&Fluid<D>> {
        match &self.system {
            System::Grains(..) => None,
            System::Fluid(fluid) => Some(fluid),
            System::Mixture(mixture) => Some(&mixture.fluid),
        }
    }

    /// The same, to change between two steps.
    pub fn fluid_mut(&mut self) -> Option<&mut Fluid<D>> {
        match &mut self.system {
            System::Grains(..) => None,
            System::Fluid(fluid) => Some(fluid),
            System::Mixture(mixture) => Some(&mut mixture.fluid),
        }
    }

    /// The exchange of grains and fluid, if both are there.
    pub fn interaction(&self) -> Option<&Interaction<D>> {
        self.mixture().map(|mixture| &mixture.interaction)
    }

    /// The same, to change between two steps.
    pub fn interaction_mut(&mut self) -> Option<&mut Interaction<D>> {
        self.mixture_mut().map(|mixture| &mut mixture.interaction)
    }
}
