//! The loop in which a fluid solver of this crate answers the requests of a run in another process.

use crate::peer::Peer;
use crate::protocol::{
    Kind, Setup, SolutionMessage, StepLayout, dimension, read_mesh, read_state, read_step,
};
use crate::token::Token;
use crate::transport::{Address, Frame, LOOK};
use std::time::Duration;
use voidage_coupling::backend::{FluidBackend, FluidStep, Immersed, RustFluid, Solution};
use voidage_coupling::error::{Error, PeerError, Result};
use voidage_fluid::conditions::Condition;
use voidage_fluid::points::Points;
use voidage_fluid::{Mesh, MeshMotion};

/// Serves a run with the Rust solver until it says goodbye, or ends this process when the run is gone. `wait` is how
/// long the run may take to be there, `token` the word that it asks for.
///
/// # Errors
/// There is no such run, it is gone, or the solver failed (which the run has been told).
pub fn serve(address: &Address, token: &Token, wait: Duration) -> Result<()> {
    let solver = concat!("rust ", env!("CARGO_PKG_VERSION"));
    let (mut peer, text) = Peer::connect(address, solver, token, wait)?;
    peer.end_with_run();
    let outcome = match dimension(&text)? {
        2 => {
            let Setup { model, .. } = Setup::<2>::parse(&text)?;
            let conditions = model.conditions.clone();
            Server::new(RustFluid::<2, 3>::new(model), conditions).run(&mut peer)
        }
        other => Err(Error::run(format!("scenes in {other} dimensions are not built yet"))),
    };
    match outcome {
        Err(Error::Peer(PeerError::Gone)) => {
            Err(Error::run(format!("the run at {address} is gone: it was killed, or the connection broke")))
        }
        Err(error) => {
            // If the run cannot be told either, the first error is the cause.
            if peer.fail(&error.to_string()).is_ok() {
                peer.linger();
            }
            Err(error)
        }
        Ok(()) => Ok(()),
    }
}

fn no_mesh() -> PeerError {
    PeerError::protocol("a step or a state before the mesh")
}

/// A solver and what it is given.
struct Server<const D: usize, F> {
    backend: F,
    mesh: Option<Mesh<D>>,
    conditions: Vec<Condition<D>>,
    points: Points<D>,
    solution: Solution<D>,
}

impl<const D: usize, F: FluidBackend<D>> Server<D, F> {
    fn new(backend: F, conditions: Vec<Condition<D>>) -> Self {
        Self { backend, mesh: None, conditions, points: Points::default(), solution: Solution::default() }
    }

    fn run(&mut self, peer: &mut Peer) -> Result<()> {
        loop {
            let Some(frame) = peer.receive(LOOK)? else { continue };
            match frame.kind() {
                Kind::Mesh => {
                    let (mesh, fields) = read_mesh(frame.header(), frame.payload())?;
                    let mesh = self.mesh.insert(mesh);
                    self.backend.set_mesh(mesh, frame.header().generation, &fields)?;
                    peer.done()?;
                }
                Kind::State => {
                    let mesh = self.mesh.as_ref().ok_or_else(no_mesh)?;
                    let fields = read_state(frame.header(), frame.payload(), mesh.points.len())?;
                    self.backend.set_mesh(mesh, frame.header().generation, &fields)?;
                    peer.done()?;
                }
                Kind::Step => self.solve(&frame, peer)?,
                Kind::Bye => return Ok(()),
                other => return Err(PeerError::protocol(format!("{other:?} is no request")).into()),
            }
        }
    }

    fn accept(&mut self, frame: &Frame) {
        if frame.header().accepts() {
            self.backend.accept();
        }
    }

    fn solve(&mut self, frame: &Frame, peer: &mut Peer) -> Result<()> {
        self.accept(frame);
        let header = frame.header();
        let StepLayout { points, source, motion, conditions } = read_step(header, frame.payload())?;
        self.conditions = conditions.unwrap_or(std::mem::take(&mut self.conditions));
        let mesh = self.mesh.as_ref().ok_or_else(no_mesh)?;
        if let Some((place, voidage)) = &points {
            place.fill(header.scalars, mesh.cell_count(), frame.payload(), &mut self.points)?;
            if voidage.len() != mesh.points.len() {
                let (values, nodes) = (voidage.len(), mesh.points.len());
                return Err(PeerError::protocol(format!("voidage at {values} of {nodes} nodes")).into());
            }
        }
        let [places, velocity] = motion.as_ref().map_or_else(Default::default, |at| at.read(frame.payload()));
        let step = FluidStep {
            number: header.step,
            time: header.time,
            dt: header.dt,
            immersed: points.map(|(_, voidage)| Immersed {
                points: &self.points,
                voidage: &frame.payload()[voidage],
                source: source.map(|source| &frame.payload()[source]),
            }),
            conditions: &self.conditions,
            motion: motion.is_some().then_some(MeshMotion { points: &places, velocity: &velocity }),
        };
        self.backend.solve(&step, &mut self.solution)?;
        let message = SolutionMessage::new(&self.solution);
        let header = message.header();
        let mut payload = peer.loan(header.length as usize)?;
        message.write(payload.payload_mut());
        Ok(peer.answer(&header, payload)?)
    }
}
