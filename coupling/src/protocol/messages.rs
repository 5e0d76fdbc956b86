//! The frames of a step: the grains, and the fluid at the grains.
//!
//! A message knows its header and length, so that the payload can be borrowed from shared memory, and then writes itself
//! there.

use super::columns::{only_if, wrong};
use super::text::{numbers_for_text, write_text};
use super::{
    ACCEPT, Column, HEAT, Header, Kind, Layout, MOVES, MotionPlaces, PiecePlaces, SOLUTION, STEP,
    STEP_CONTINUITY, STEP_HEAT, read_text,
};
use crate::backend::{FluidReport, FluidStep, GrainLoad, Immersed};
use crate::error::PeerError;
use voidage_fluid::Vector;
use voidage_fluid::conditions::Condition;
use voidage_fluid::exchange::AtBodies;
use voidage_fluid::flow::Report;

// ------------------------------------------------------------------------------------------------ step

/// The grains of a step.
pub struct StepMessage<'a, const D: usize> {
    step: &'a FluidStep<'a, D>,
    layout: Layout,
    pieces: Option<PiecePlaces>,
    motion: Option<MotionPlaces>,
    /// The end of all of them.
    end: usize,
    conditions: String,
}

impl<'a, const D: usize> StepMessage<'a, D> {
    /// A step; `conditions` is their text if they must travel, else empty.
    pub fn new(step: &'a FluidStep<'a, D>, conditions: String) -> Self {
        let (layout, pieces) = match &step.grains {
            None => (Layout::new(D, 0, &[], 0), None),
            Some(Immersed { position, load, .. }) => {
                let heat = only_if(load.heat.is_some(), STEP_HEAT);
                let continuity = only_if(load.continuity.is_some(), STEP_CONTINUITY);
                let layout = Layout::new(D, position.len(), &[STEP, heat, continuity], 0);
                (layout, Some(PiecePlaces::new(&layout, load.pieces.len(), load.voidage.len())))
            }
        };
        let end = pieces.as_ref().map_or(layout.end(), |places| places.voidage.end);
        let motion = step.motion.map(|motion| MotionPlaces::new(D, motion.points.len(), end));
        let end = motion.as_ref().map_or(end, |places| places.velocity.end);
        Self { step, layout, pieces, motion, end, conditions }
    }

    /// Its header; `accept` accepts the solution before, `iteration` counts the solutions of this step.
    pub fn header(&self, accept: bool, iteration: u32) -> Header {
        let length = self.end + numbers_for_text(&self.conditions);
        let count = |range: fn(&PiecePlaces) -> usize| self.pieces.as_ref().map_or(0, range) as u64;
        let moving = self.step.motion.map_or(0, |motion| motion.points.len() as u64);
        Header {
            pieces: count(|places| places.cell.len()),
            nodes: moving.max(count(|places| places.voidage.len())),
            flags: if accept { ACCEPT } else { 0 } | if self.motion.is_some() { MOVES } else { 0 },
            step: self.step.number,
            iteration,
            time: self.step.time,
            dt: self.step.dt,
            text: self.conditions.len() as u64,
            ..self.layout.describe(Kind::Step, length)
        }
    }

    /// Writes the payload.
    pub fn write(&self, payload: &mut [f64]) {
        write_text(&self.conditions, payload);
        if let Some((places, motion)) = self.motion.as_ref().zip(self.step.motion.as_ref()) {
            places.write(motion, payload);
        }
        let Some(grains) = &self.step.grains else { return };
        let (layout, load) = (&self.layout, grains.load);
        layout.put_vectors(payload, Column::Position, grains.position);
        layout.put(payload, Column::Radius, grains.radius);
        layout.put(payload, Column::Volume, &load.volume);
        layout.put(payload, Column::Drag, &load.drag);
        layout.put(payload, Column::Mobility, &load.mobility);
        layout.put_vectors(payload, Column::Velocity, &load.velocity);
        if let Some(heat) = &load.heat {
            layout.put(payload, Column::HeatCoefficient, &heat.coefficient);
            layout.put(payload, Column::HeatMobility, &heat.mobility);
            layout.put(payload, Column::Temperature, &heat.temperature);
        }
        if let Some(law) = &load.continuity {
            layout.put(payload, Column::ContinuityMobility, &law.mobility);
            layout.put_vectors(payload, Column::ContinuityVelocity, &law.velocity);
        }
        if let Some(places) = &self.pieces {
            places.write(&load.pieces, &load.voidage, payload);
        }
    }
}

/// What a step brings; its numbers lie in the payload.
pub struct StepParts<const D: usize> {
    /// The columns of the grains; none without grains.
    pub layout: Layout,
    /// Pieces and voidage; absent without grains.
    pub pieces: Option<PiecePlaces>,
    /// The motion of the mesh; absent while it stands still.
    pub motion: Option<MotionPlaces>,
    /// The conditions, if they are new.
    pub conditions: Option<Vec<Condition<D>>>,
}

/// Finds the parts of a step.
///
/// # Errors
/// Columns are missing or do not fit, the conditions cannot be read.
pub fn read_step<const D: usize>(header: &Header, payload: &[f64]) -> Result<StepParts<D>, PeerError> {
    let required = if header.rows == 0 && header.mask == 0 { &[] } else { STEP };
    let layout = Layout::of(header, D, required, &[STEP_HEAT, STEP_CONTINUITY], 0)?;
    let pieces = PiecePlaces::of(header, &layout)?;
    let end = pieces.as_ref().map_or(layout.end(), |places| places.voidage.end);
    let motion = MotionPlaces::of(header, D, end)?;
    let end = motion.as_ref().map_or(end, |places| places.velocity.end);
    let text = read_text(header, payload)?;
    if end + numbers_for_text(&text) > payload.len() {
        return wrong("columns and text of a step overlap".into());
    }
    if text.is_empty() {
        return Ok(StepParts { layout, pieces, motion, conditions: None });
    }
    match serde_json::from_str(&text) {
        Ok(conditions) => Ok(StepParts { layout, pieces, motion, conditions: Some(conditions) }),
        Err(error) => wrong(format!("the conditions of a step: {error}")),
    }
}

impl<const D: usize> GrainLoad<D> {
    /// Copies the columns of a step; pieces and voidage stay as they are. Returns positions (m) and radii (m) beside.
    pub fn copy_columns(
        &mut self,
        layout: &Layout,
        payload: &[f64],
        position: &mut Vec<Vector<D>>,
        radius: &mut Vec<f64>,
    ) {
        layout.get_vectors(payload, Column::Position, position);
        layout.get(payload, Column::Radius, radius);
        layout.get(payload, Column::Volume, &mut self.volume);
        layout.get(payload, Column::Drag, &mut self.drag);
        layout.get(payload, Column::Mobility, &mut self.mobility);
        layout.get_vectors(payload, Column::Velocity, &mut self.velocity);
        if layout.range(Column::ContinuityMobility).is_some() {
            let law = self.continuity.get_or_insert_default();
            layout.get(payload, Column::ContinuityMobility, &mut law.mobility);
            layout.get_vectors(payload, Column::ContinuityVelocity, &mut law.velocity);
        } else {
            self.continuity = None;
        }
        if layout.range(Column::HeatCoefficient).is_some() {
            let heat = self.heat.get_or_insert_default();
            layout.get(payload, Column::HeatCoefficient, &mut heat.coefficient);
            layout.get(payload, Column::HeatMobility, &mut heat.mobility);
            layout.get(payload, Column::Temperature, &mut heat.temperature);
        } else {
            self.heat = None;
        }
    }
}

// -------------------------------------------------------------------------------------------- solution

/// Numbers of a report without the force.
const REPORT: usize = 7;

impl<const D: usize> FluidReport<D> {
    /// Numbers that it takes, behind the columns of a solution.
    pub const NUMBERS: usize = REPORT + D;

    /// Writes it to the last numbers of a payload.
    pub fn write(&self, payload: &mut [f64]) {
        let start = payload.len() - Self::NUMBERS;
        let (report, numbers) = (&self.solver, &mut payload[start..]);
        numbers[..REPORT].copy_from_slice(&[
            report.flow_iterations as f64,
            report.heat_iterations as f64,
            report.residual,
            f64::from(report.factored),
            report.heat_s,
            report.flow_s,
            self.heat,
        ]);
        // A force that is not known travels as what is no number.
        let force = self.force.unwrap_or_else(|| Vector::repeat(f64::NAN));
        numbers[REPORT..].copy_from_slice(force.as_slice());
    }
}

/// The fluid at the grains.
pub struct SolutionMessage<'a, const D: usize> {
    at: &'a AtBodies<D>,
    report: &'a FluidReport<D>,
    layout: Layout,
}

impl<'a, const D: usize> SolutionMessage<'a, D> {
    /// A solution; `at` is empty without grains.
    pub fn new(at: &'a AtBodies<D>, report: &'a FluidReport<D>) -> Self {
        let rows = at.velocity.len();
        let heat = only_if(!at.temperature.is_empty(), HEAT);
        Self { at, report, layout: Layout::new(D, rows, &[SOLUTION, heat], 0) }
    }

    /// Its header.
    pub fn header(&self) -> Header {
        self.layout.describe(Kind::Solution, self.layout.end() + FluidReport::<D>::NUMBERS)
    }

    /// Writes the payload.
    pub fn write(&self, payload: &mut [f64]) {
        let layout = &self.layout;
        layout.put_vectors(payload, Column::Velocity, &self.at.velocity);
        layout.put_vectors(payload, Column::PressureGradient, &self.at.pressure_gradient);
        layout.put(payload, Column::Temperature, &self.at.temperature);
        self.report.write(payload);
    }
}

/// Reads a solution for `grains` grains into `at`.
///
/// # Errors
/// Columns are missing, of another length, or hold what is not finite.
pub fn read_solution<const D: usize>(
    header: &Header,
    payload: &[f64],
    (grains, heat): (usize, bool),
    at: &mut AtBodies<D>,
) -> Result<FluidReport<D>, PeerError> {
    let layout = Layout::of(header, D, SOLUTION, &[HEAT], 0)?;
    if layout.rows != grains {
        return wrong(format!("a solution for {} grains, there are {grains}", layout.rows));
    }
    if heat && grains > 0 && layout.range(Column::Temperature).is_none() {
        return wrong("a solution without temperature".into());
    }
    let Some(numbers) = payload.get(layout.end()..layout.end() + REPORT + D) else {
        return wrong("a solution without report".into());
    };
    layout.get_vectors(payload, Column::Velocity, &mut at.velocity);
    layout.get_vectors(payload, Column::PressureGradient, &mut at.pressure_gradient);
    at.temperature.clear();
    if heat {
        layout.get(payload, Column::Temperature, &mut at.temperature);
    }
    for column in [Column::Velocity, Column::PressureGradient, Column::Temperature] {
        let values = layout.range(column).map_or(&[][..], |range| &payload[range]);
        if let Some(place) = values.iter().position(|value| !value.is_finite()) {
            let (grain, name) = (place / column.width(D), column.name());
            return wrong(format!("{name} = {} at grain {grain}: the solver diverges", values[place]));
        }
    }
    let solver = Report {
        flow_iterations: numbers[0] as usize,
        heat_iterations: numbers[1] as usize,
        residual: numbers[2],
        factored: numbers[3] != 0.0,
        heat_s: numbers[4],
        flow_s: numbers[5],
    };
    let force = Some(Vector::from_column_slice(&numbers[REPORT..]))
        .filter(|force: &Vector<D>| force.iter().all(|component| component.is_finite()));
    Ok(FluidReport { solver, force, heat: numbers[6], transport_s: 0.0 })
}
