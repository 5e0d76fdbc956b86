//! A fluid solver in another process, seen from the grains.

use crate::launch::Process;
use crate::protocol::{
    Greeting, Header, Kind, MeshMessage, Setup, StateMessage, StepMessage, longest_solution,
    numbers_for_text, read_solution, write_text,
};
use crate::token::Token;
use crate::transport::{self, Channel, Frame};
use std::time::{Duration, Instant};
use voidage_coupling::backend::{FluidBackend, FluidStep, Solution};
use voidage_coupling::error::{Error, Notice, PeerError, Result};
use voidage_fluid::Mesh;
use voidage_fluid::conditions::Condition;
use voidage_fluid::flow::State;
use voidage_fluid::transport::Scalar;

/// How long a solver may take to start: FEniCSx compiles its forms, and a person types a command.
const START: Duration = Duration::from_secs(120);

/// Longest text of an error of a solver, numbers.
const LONGEST_ERROR: usize = 1 << 13;

/// A fluid solver in another process.
pub struct RemoteFluid<const D: usize> {
    /// The process, if it was started here. Before the channel, because it ends by a farewell through it.
    process: Option<Process>,
    channel: Box<dyn Channel>,
    /// Its name in errors.
    name: String,
    /// Longest silence.
    timeout: Duration,
    /// Run, generation, step and iteration of the last frame.
    last: Header,
    /// Nodes of the mesh.
    nodes: usize,
    scalars: Vec<Scalar>,
    /// What the solver must greet with.
    token: Token,
    /// Whether the last solution is accepted and the solver does not know it yet.
    accepted: bool,
    /// The conditions that the solver has.
    conditions: Vec<Condition<D>>,
}

impl<const D: usize> RemoteFluid<D> {
    /// Waits for the solver at the other end of a channel, which greets with the token, and tells it the setup. `name`
    /// stands in errors, `timeout` is the longest silence.
    ///
    /// # Errors
    /// No solver comes, or one of another version.
    pub fn new(
        channel: Box<dyn Channel>,
        process: Option<Process>,
        name: String,
        (timeout, token): (Duration, Token),
        setup: &Setup<D>,
    ) -> Result<Self> {
        let id =
            blake3::hash(format!("{:?} {}", std::time::SystemTime::now(), std::process::id()).as_bytes());
        let run = u64::from_le_bytes(std::array::from_fn(|i| id.as_bytes()[i]));
        let last = Header { run, ..Header::default() };
        let (conditions, scalars) = (setup.model.conditions.clone(), setup.model.scalars.clone());
        let (nodes, accepted) = (0, false);
        let mut remote =
            Self { channel, process, name, timeout, last, nodes, scalars, token, accepted, conditions };
        remote.greet(setup).map_err(|error| remote.explain(error))?;
        Ok(remote)
    }

    fn greet(&mut self, setup: &Setup<D>) -> Result<(), PeerError> {
        let hello = self.receive(START.max(self.timeout))?;
        let greeting = Greeting::read(hello.header(), hello.payload())?;
        if !self.token.admits(&greeting) {
            return Err(PeerError::protocol(format!(
                "\"{}\" has not the token of this run",
                greeting.solver
            )));
        }
        self.name = format!("{} ({})", self.name, greeting.solver);
        let text = serde_json::to_string(setup).map_err(|error| PeerError::channel(error.to_string()))?;
        let length = numbers_for_text(&text) as u64;
        let header = Header { text: text.len() as u64, length, ..Header::new(Kind::Hello) };
        self.send(header, |payload| write_text(&text, payload))
    }

    fn receive(&mut self, silence: Duration) -> Result<Frame, PeerError> {
        let process = &mut self.process;
        transport::receive(&mut *self.channel, silence, || process.as_mut().map_or(Ok(()), Process::look))
    }

    fn send(&mut self, header: Header, write: impl FnOnce(&mut [f64])) -> Result<(), PeerError> {
        let mut payload = self.channel.loan(header.length as usize)?;
        write(payload.payload_mut());
        let Header { run, generation, .. } = self.last;
        self.channel.send(&Header { run, generation, ..header }, payload)
    }

    /// Sends a request and waits for an answer of a kind.
    fn ask(
        &mut self,
        header: Header,
        write: impl FnOnce(&mut [f64]),
        kind: Kind,
    ) -> Result<Frame, PeerError> {
        let longest = match kind {
            Kind::Solution => longest_solution(D, (self.nodes, self.scalars.len(), self.conditions.len())),
            _ => 0,
        };
        self.channel.allow(longest.max(LONGEST_ERROR));
        self.send(header, write)?;
        let answer = self.receive(self.timeout)?;
        match answer.kind() {
            Kind::Error => return Err(PeerError::Failed(Notice::read(&answer.text()?))),
            other if other != kind => {
                return Err(PeerError::protocol(format!("{other:?} instead of {kind:?}")));
            }
            _ => {}
        }
        let (theirs, ours) = (answer.header(), (header.step, header.iteration));
        if theirs.run != self.last.run || (theirs.step, theirs.iteration) != ours {
            let text = format!("the answer to step {}, solution {}", theirs.step, theirs.iteration);
            return Err(PeerError::protocol(text));
        }
        Ok(answer)
    }

    /// What the user reads: who, what, and what the solver's log says last.
    fn explain(&mut self, error: PeerError) -> Error {
        let log = match (&error, &mut self.process) {
            // What a solver says of itself needs no log.
            (PeerError::Failed(_), _) | (_, None) => String::new(),
            (_, Some(process)) => process.last_words(&error),
        };
        let Notice { what, help } = error.notice();
        let others = self.channel.turned_away();
        let others = others.map_or(String::new(), |why| format!("\nturned away before: {why}"));
        Error::run(Notice::new(format!("fluid solver {}: {what}{others}{log}", self.name), help))
    }

    fn ask_to_start(&mut self, mesh: &Mesh<D>, generation: u32, fields: &State<D>) -> Result<(), PeerError> {
        self.accepted = false;
        if self.last.generation == generation {
            let message = StateMessage::new(fields);
            self.ask(message.header(), |payload| message.write(payload), Kind::State)?;
        } else {
            (self.last.generation, self.nodes) = (generation, mesh.points.len());
            let message = MeshMessage::new(mesh, fields);
            self.ask(message.header(), |payload| message.write(payload), Kind::Mesh)?;
        }
        Ok(())
    }

    fn ask_to_solve(&mut self, step: &FluidStep<'_, D>, out: &mut Solution<D>) -> Result<(), PeerError> {
        let text = if self.conditions == step.conditions {
            String::new()
        } else {
            self.conditions = step.conditions.to_vec();
            serde_json::json!(step.conditions).to_string()
        };
        let again = self.last.step == step.number && !self.accepted;
        self.last.iteration = if again { self.last.iteration + 1 } else { 0 };
        self.last.step = step.number;
        let start = Instant::now();
        let message = StepMessage::new(step, text);
        let header = message.header(self.accepted, self.last.iteration);
        self.accepted = false;
        let answer = self.ask(header, |payload| message.write(payload), Kind::Solution)?;
        let counts = (self.nodes, self.scalars.len(), step.conditions.len());
        read_solution(answer.header(), answer.payload(), counts, out)?;
        if let Some(place) = out.not_finite(&self.scalars) {
            return Err(PeerError::protocol(format!(
                "in step {}, {place} is not finite: the solver diverges",
                step.number
            )));
        }
        out.transport_s = (start.elapsed().as_secs_f64() - answer.header().dt).max(0.0);
        Ok(())
    }
}

impl<const D: usize> FluidBackend<D> for RemoteFluid<D> {
    fn set_mesh(&mut self, mesh: &Mesh<D>, generation: u32, fields: &State<D>) -> Result<()> {
        self.ask_to_start(mesh, generation, fields).map_err(|error| self.explain(error))
    }

    fn solve(&mut self, step: &FluidStep<'_, D>, out: &mut Solution<D>) -> Result<()> {
        self.ask_to_solve(step, out).map_err(|error| self.explain(error))
    }

    fn accept(&mut self) {
        self.accepted = true;
    }
}

impl<const D: usize> Drop for RemoteFluid<D> {
    fn drop(&mut self) {
        // A solver that is gone needs no farewell.
        let _ = self.send(Header::new(Kind::Bye), |_| {});
    }
}
