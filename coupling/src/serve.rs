//! The loop in which a fluid solver of this crate answers the requests of a run in another process.

use crate::backend::{FluidBackend, FluidStep, GrainLoad, Immersed, RustFluid};
use crate::error::{Error, PeerError, Result};
use crate::peer::Peer;
use crate::protocol::{
    FieldsMessage, Kind, Setup, SolutionMessage, StepParts, dimension, read_fields, read_mesh, read_step,
};
use crate::transport::{Address, Frame, LOOK};
use std::sync::Arc;
use std::time::Duration;
use voidage_fluid::conditions::Condition;
use voidage_fluid::exchange::AtBodies;
use voidage_fluid::{Mesh, MeshMotion, Vector};

/// Serves a run with the Rust solver until it says goodbye, or ends this process when the run is gone. `wait` is how long the run may take to be there.
///
/// # Errors
/// There is no such run, it is gone, or the solver failed (which the run has been told).
pub fn serve(address: &Address, wait: Duration) -> Result<()> {
    let solver = concat!("rust ", env!("CARGO_PKG_VERSION"));
    let (mut peer, text) = Peer::connect(address, solver, wait)?;
    peer.end_with_run();
    let outcome = match dimension(&text)? {
        2 => {
            let setup = Setup::<2>::parse(&text)?;
            let Setup { properties, heat, numerics, conditions, .. } = setup;
            let backend = RustFluid::<2, 3>::new(properties, heat, numerics, conditions.clone());
            Server::new(backend, conditions).run(&mut peer)
        }
        other => Err(Error::Run(format!("scenes in {other} dimensions are not built yet"))),
    };
    match outcome {
        Err(Error::Peer(PeerError::Gone)) => {
            Err(Error::Run(format!("the run at {address} is gone: it was killed, or the connection broke")))
        }
        Err(error) => {
            // If the run cannot be told either, the first error is the cause.
            let _ = peer.fail(&error.to_string());
            Err(error)
        }
        Ok(()) => Ok(()),
    }
}

fn no_mesh() -> PeerError {
    PeerError::Protocol("a step or a state before the mesh".into())
}

/// A solver and what it needs of the grains.
struct Server<const D: usize, F> {
    backend: F,
    mesh: Option<Arc<Mesh<D>>>,
    conditions: Vec<Condition<D>>,
    load: GrainLoad<D>,
    position: Vec<Vector<D>>,
    radius: Vec<f64>,
    at: AtBodies<D>,
}

impl<const D: usize, F: FluidBackend<D>> Server<D, F> {
    fn new(backend: F, conditions: Vec<Condition<D>>) -> Self {
        let (load, at) = (GrainLoad::default(), AtBodies::default());
        Self { backend, mesh: None, conditions, load, position: Vec::new(), radius: Vec::new(), at }
    }

    fn run(&mut self, peer: &mut Peer) -> Result<()> {
        loop {
            let Some(frame) = peer.receive(LOOK)? else { continue };
            match frame.kind() {
                Kind::Mesh => {
                    let (mesh, fields) = read_mesh(frame.header(), frame.payload())?;
                    let mesh = self.mesh.insert(Arc::new(mesh));
                    self.backend.start(mesh, &fields)?;
                    peer.done()?;
                }
                Kind::State => {
                    let mesh = self.mesh.as_ref().ok_or_else(no_mesh)?;
                    let fields = read_fields(frame.header(), frame.payload(), mesh.points.len())?;
                    self.backend.start(mesh, &fields)?;
                    peer.done()?;
                }
                Kind::Step => self.solve(&frame, peer)?,
                Kind::Fields => {
                    self.accept(&frame);
                    let fields = self.backend.fields()?;
                    let message = FieldsMessage::new(&fields);
                    let header = message.header(Kind::Fields);
                    let mut payload = peer.loan(header.length as usize)?;
                    message.write(payload.payload_mut());
                    peer.answer(&header, payload)?;
                }
                Kind::Bye => return Ok(()),
                other => return Err(PeerError::Protocol(format!("{other:?} is no request")).into()),
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
        let StepParts { layout, pieces, motion, conditions } = read_step(header, frame.payload())?;
        self.conditions = conditions.unwrap_or(std::mem::take(&mut self.conditions));
        if let Some(places) = &pieces {
            let mesh = self.mesh.as_ref().ok_or_else(no_mesh)?;
            self.load.copy_columns(&layout, frame.payload(), &mut self.position, &mut self.radius);
            self.load.pieces = places.read(frame.payload(), mesh.cell_count())?;
            self.load.voidage.clear();
            self.load.voidage.extend(&frame.payload()[places.voidage.clone()]);
            if self.load.voidage.len() != mesh.points.len() {
                let (values, nodes) = (self.load.voidage.len(), mesh.points.len());
                return Err(PeerError::Protocol(format!("voidage at {values} of {nodes} nodes")).into());
            }
        }
        let [points, velocity] = motion.as_ref().map_or_else(Default::default, |at| at.read(frame.payload()));
        let Self { backend, conditions, position, radius, load, at, .. } = self;
        let step = FluidStep {
            number: header.step,
            time: header.time,
            dt: header.dt,
            grains: pieces.is_some().then_some(Immersed { position, radius, load }),
            conditions,
            motion: motion.is_some().then_some(MeshMotion { points: &points, velocity: &velocity }),
        };
        let report = backend.solve(&step, at)?;
        let message = SolutionMessage::new(at, &report);
        let header = message.header();
        let mut payload = peer.loan(header.length as usize)?;
        message.write(payload.payload_mut());
        Ok(peer.answer(&header, payload)?)
    }
}
