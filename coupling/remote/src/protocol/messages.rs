//! The frames of a step: point terms, and what the fluid answers.
//!
//! A message knows its header and length, so that the payload can be borrowed from shared memory, and then writes
//! itself there.

use super::blocks::{BALANCE, BODY, REPORT, STEP, lay, width};
use super::columns::{PAD, POINT_SCALAR, POINTS, Table, TableLayout, wrong};
use super::mesh::fields_at;
use super::text::{numbers_for_text, write_text};
use super::{ACCEPT, APPEARS, Header, IMMERSED, Kind, MOVES, MotionLayout, read_text};
use std::ops::Range;
use voidage_coupling::backend::{FluidStep, Solution};
use voidage_coupling::error::PeerError;
use voidage_fluid::Vector;
use voidage_fluid::balance::{Balance, moments};
use voidage_fluid::body::BodyAnswer;
use voidage_fluid::conditions::Condition;
use voidage_fluid::flow::Report;

// ------------------------------------------------------------------------------------------------ step

/// What a step brings.
pub struct StepMessage<'a, const D: usize> {
    step: &'a FluidStep<'a, D>,
    points: Option<TableLayout>,
    conditions: String,
}

impl<'a, const D: usize> StepMessage<'a, D> {
    /// A step; `conditions` is their text if they must travel, else empty.
    pub fn new(step: &'a FluidStep<'a, D>, conditions: String) -> Self {
        let points = step.immersed.map(|immersed| TableLayout::of(immersed.points, 0));
        Self { step, points, conditions }
    }

    /// Flags and counts.
    fn counts(&self) -> Header {
        let FluidStep { immersed, motion, .. } = self.step;
        let flag = |there: bool, flag: u32| if there { flag } else { 0 };
        let source = immersed.is_some_and(|immersed| immersed.source.is_some());
        let moving = motion.map_or(0, |motion| motion.points.len());
        let voidage = immersed.map_or(0, |immersed| immersed.voidage.len());
        Header {
            nodes: moving.max(voidage) as u64,
            flags: flag(motion.is_some(), MOVES) | flag(immersed.is_some(), IMMERSED) | flag(source, APPEARS),
            ..Header::new(Kind::Step)
        }
    }

    /// Where what is behind the points lies.
    fn blocks(&self) -> [Range<usize>; STEP.len()] {
        lay(&STEP, &self.counts(), D, self.points.map_or(0, |place| place.end()))
    }

    /// Its header; `accept` accepts the solution before, `iteration` counts the solutions of this step.
    pub fn header(&self, accept: bool, iteration: u32) -> Header {
        let [.., last] = self.blocks();
        let counts = self.counts();
        let header = Header {
            flags: counts.flags | if accept { ACCEPT } else { 0 },
            step: self.step.number,
            iteration,
            time: self.step.time,
            dt: self.step.dt,
            text: self.conditions.len() as u64,
            length: (last.end + numbers_for_text(&self.conditions)) as u64,
            ..counts
        };
        match (&self.points, self.step.immersed) {
            (Some(place), Some(immersed)) => place.describe(immersed.points.scalars(), header),
            _ => header,
        }
    }

    /// Writes the payload.
    pub fn write(&self, payload: &mut [f64]) {
        write_text(&self.conditions, payload);
        let [voidage, source, points, velocity] = self.blocks();
        if let Some(motion) = &self.step.motion {
            MotionLayout { points, velocity }.write(motion, payload);
        }
        if let (Some(place), Some(immersed)) = (&self.points, self.step.immersed) {
            place.write(immersed.points, payload);
            payload[voidage].copy_from_slice(immersed.voidage);
            payload[source].copy_from_slice(immersed.source.unwrap_or_default());
        }
    }
}

/// What a step brings; its numbers lie in the payload.
pub struct StepLayout<const D: usize> {
    /// Point terms and voidage; absent without grains.
    pub points: Option<(TableLayout, Range<usize>)>,
    /// The nodal source of the equation of mass; absent where no solid volume comes in.
    pub source: Option<Range<usize>>,
    /// The motion of the mesh; absent while it stands still.
    pub motion: Option<MotionLayout>,
    /// The conditions, if they are new.
    pub conditions: Option<Vec<Condition<D>>>,
}

/// Finds the parts of a step.
///
/// # Errors
/// Columns do not fit, the conditions cannot be read.
pub fn read_step<const D: usize>(header: &Header, payload: &[f64]) -> Result<StepLayout<D>, PeerError> {
    let points = match header.immerses() {
        true => Some(TableLayout::read(header, (&POINTS, &POINT_SCALAR), D, 0)?),
        false => None,
    };
    let blocks = lay(&STEP, header, D, points.map_or(0, |place| place.end()));
    for (range, block) in blocks.iter().zip(&STEP) {
        if range.end as u64 > header.length {
            let (name, end, length) = (block.entry.name, range.end, header.length);
            return wrong(format!("the {name} of a step up to {end} in {length} numbers"));
        }
    }
    let [voidage, source, places, velocity] = blocks;
    let source = header.appears().then_some(source);
    if source.is_some() && points.is_none() {
        return wrong("a source of mass without grains".into());
    }
    let end = velocity.end;
    let points = points.map(|place| (place, voidage));
    let motion = header.moves().then_some(MotionLayout { points: places, velocity });
    let text = read_text(header, payload)?;
    if end + numbers_for_text(&text) > payload.len() {
        return wrong("columns and text of a step overlap".into());
    }
    if text.is_empty() {
        return Ok(StepLayout { points, source, motion, conditions: None });
    }
    match serde_json::from_str(&text) {
        Ok(conditions) => Ok(StepLayout { points, source, motion, conditions: Some(conditions) }),
        Err(error) => wrong(format!("the conditions of a step: {error}")),
    }
}

// -------------------------------------------------------------------------------------------- solution

/// Numbers of the balance of a part of the boundary.
fn numbers_of_balance(dimension: usize, scalars: usize) -> usize {
    width(&BALANCE, dimension, scalars)
}

/// Numbers that answer for a body: its velocity and its vapour.
fn numbers_of_body(dimension: usize) -> usize {
    width(&BODY, dimension, 0)
}

/// The longest payload of a solution for a mesh of `nodes` nodes, with `scalars` scalars and so many parts of the
/// boundary.
pub fn longest_solution(dimension: usize, (nodes, scalars, parts): (usize, usize, usize)) -> usize {
    let columns = dimension + 1 + scalars;
    let of_part = numbers_of_balance(dimension, scalars) + numbers_of_body(dimension);
    nodes.next_multiple_of(PAD) * columns + parts * of_part + REPORT.len()
}

/// The answer of the fluid: fields, the balances of the parts of the boundary, the bodies, and the report behind them.
pub struct SolutionMessage<'a, const D: usize> {
    solution: &'a Solution<D>,
    layout: TableLayout,
}

impl<'a, const D: usize> SolutionMessage<'a, D> {
    /// A solution.
    pub fn new(solution: &'a Solution<D>) -> Self {
        Self { solution, layout: TableLayout::of(&solution.fields, 0) }
    }

    /// Its header.
    pub fn header(&self) -> Header {
        let Solution { fields, balances, bodies, .. } = self.solution;
        let numbers =
            balances.len() * numbers_of_balance(D, fields.scalars.len()) + bodies.len() * numbers_of_body(D);
        let length = (self.layout.end() + numbers + REPORT.len()) as u64;
        let header = Header { parts: balances.len() as u64, length, ..Header::new(Kind::Solution) };
        self.layout.describe(fields.scalars(), header)
    }

    /// Writes the payload.
    pub fn write(&self, payload: &mut [f64]) {
        self.layout.write(&self.solution.fields, payload);
        let balances = self.solution.balances.iter().flat_map(|balance| {
            let Balance { flux, force, torque, scalars, convected } = balance;
            let numbers = force.iter().chain(torque).chain(scalars).chain(convected);
            std::iter::once(flux).chain(numbers).copied()
        });
        let bodies = self.solution.bodies.iter();
        let bodies =
            bodies.flat_map(|body| body.velocity.iter().copied().chain(std::iter::once(body.vapour)));
        let report = &self.solution.report;
        let report: [f64; REPORT.len()] = [
            report.flow_iterations as f64,
            report.scalar_iterations as f64,
            report.residual,
            f64::from(report.factored),
            report.scalars_s,
            report.flow_s,
        ];
        let numbers = balances.chain(bodies).chain(report);
        payload[self.layout.end()..].iter_mut().zip(numbers).for_each(|(to, number)| *to = number);
    }
}

/// Reads a solution for a mesh of `nodes` nodes, with `scalars` scalars and so many parts of the boundary.
///
/// # Errors
/// Columns are missing or of another length.
pub fn read_solution<const D: usize>(
    header: &Header,
    payload: &[f64],
    (nodes, scalars, parts): (usize, usize, usize),
    out: &mut Solution<D>,
) -> Result<(), PeerError> {
    if header.rows as usize != nodes || header.scalars.count_ones() as usize != scalars {
        let (rows, columns) = (header.rows, header.scalars.count_ones());
        return wrong(format!(
            "a solution of {rows} nodes and {columns} scalars, there are {nodes} and {scalars}"
        ));
    }
    if header.parts != 0 && header.parts as usize != parts {
        return wrong(format!("balances of {} parts of the boundary, there are {parts}", header.parts));
    }
    let place = fields_at(header, payload, 0, &mut out.fields)?;
    let width = numbers_of_balance(D, scalars);
    let end = place.end() + header.parts as usize * width;
    // Between the balances and the report, which is the end, lie the bodies.
    let rest = (header.length as usize)
        .checked_sub(end + REPORT.len())
        .filter(|_| payload.len() as u64 >= header.length);
    let Some(bodies) = rest.filter(|rest| rest % numbers_of_body(D) == 0) else {
        return wrong("a solution without report".into());
    };
    let (bodies, report) = payload[end..header.length as usize].split_at(bodies);
    out.balances.clear();
    out.balances.extend(payload[place.end()..end].chunks_exact(width).map(|numbers| {
        let (flux, numbers) = (numbers[0], &numbers[1..]);
        let (force, numbers) = numbers.split_at(D);
        let (torque, numbers) = numbers.split_at(moments(D));
        let (given, convected) = numbers.split_at(scalars);
        Balance {
            flux,
            force: Vector::from_column_slice(force),
            torque: torque.to_vec(),
            scalars: given.to_vec(),
            convected: convected.to_vec(),
        }
    }));
    out.bodies.clear();
    out.bodies.extend(bodies.chunks_exact(numbers_of_body(D)).map(|numbers| BodyAnswer {
        velocity: Vector::from_column_slice(&numbers[..D]),
        vapour: numbers[D],
    }));
    out.report = Report {
        flow_iterations: report[0] as usize,
        scalar_iterations: report[1] as usize,
        residual: report[2],
        factored: report[3] != 0.0,
        scalars_s: report[4],
        flow_s: report[5],
    };
    Ok(())
}
