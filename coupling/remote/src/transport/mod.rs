//! Channels that carry frames between two processes: shared memory ([`shared`]) and TCP ([`tcp`]).
//!
//! The grains [`listen`], the fluid solver [`connect`]s; then both [`Channel::loan`] memory for a payload, write their
//! columns there, and [`Channel::send`] it. A [`Frame`] keeps the memory it was received in: it is read in place.

mod address;
mod frame;
pub mod shared;
pub mod tcp;
#[cfg(test)]
mod tests;

pub use address::Address;
pub use frame::{Frame, Loan};

use crate::protocol::Header;
use crate::token::Token;
use std::time::{Duration, Instant};
use voidage_coupling::error::{Notice, PeerError};

/// Longest single wait: between two the other process is looked after, and signals may be.
pub const LOOK: Duration = Duration::from_millis(100);

/// What came of waiting for a frame.
pub enum Event {
    /// A frame.
    Frame(Box<Frame>),
    /// The other process is busy and says so.
    Heartbeat,
    /// Nothing in this time, and the other process is there as far as one can tell.
    Nothing,
}

/// Sends a sign of life each time it is called, and says whether the other process is there as far as one can tell; any
/// thread may.
pub type Pulse = Box<dyn Fn() -> bool + Send>;

/// One end of a connection between grains and fluid.
pub trait Channel: Send {
    /// Memory for a payload of so many numbers. Its content is undefined.
    ///
    /// # Errors
    /// There is not enough of it.
    fn loan(&mut self, length: usize) -> Result<Loan, PeerError>;

    /// Sends a frame. The header's length must be that of the payload.
    ///
    /// # Errors
    /// The other process is gone.
    fn send(&mut self, header: &Header, payload: Loan) -> Result<(), PeerError>;

    /// Waits for a frame, at most for this time (and not much longer than [`LOOK`]).
    ///
    /// # Errors
    /// The other process is gone, or sent what is no frame.
    fn poll(&mut self, wait: Duration) -> Result<Event, PeerError>;

    /// What sends heartbeats beside.
    fn pulse(&self) -> Pulse;

    /// The longest payload that the other process may send next, numbers. A longer one is refused before memory is
    /// taken for it; where the other process brings that memory itself, this changes nothing.
    fn allow(&mut self, _numbers: usize) {}

    /// Why the last of those was turned away who came in the place of the fluid solver.
    fn turned_away(&self) -> Option<&str> {
        None
    }
}

/// The channel of the grains at an address, and the address that the solver must be given. With TCP port 0 means any,
/// `silence` is the longest time that the solver may take nothing of a frame or be on its way with one, and those are
/// turned away whose first frame is no hello with the token.
///
/// # Errors
/// The address is in use, or there is no shared memory.
pub fn listen(
    address: &Address,
    silence: Duration,
    token: &Token,
) -> Result<(Box<dyn Channel>, Address), PeerError> {
    match address {
        Address::Shared(run) => Ok((Box::new(shared::Shared::create(run)?), address.clone())),
        Address::Tcp(place) => {
            let (channel, place) = tcp::Tcp::listen(place, silence.max(LOOK), token.clone())?;
            Ok((Box::new(channel), Address::Tcp(place)))
        }
    }
}

/// The channel of a solver to the grains at an address, waiting so long for them to be there.
///
/// # Errors
/// Nobody is there in time.
pub fn connect(address: &Address, wait: Duration) -> Result<Box<dyn Channel>, PeerError> {
    let start = Instant::now();
    loop {
        let attempt: Result<Option<Box<dyn Channel>>, PeerError> = match address {
            Address::Shared(run) => shared::Shared::open(run).map(|open| open.map(|c| Box::new(c) as _)),
            Address::Tcp(place) => {
                tcp::Tcp::connect(place, wait.max(LOOK)).map(|open| open.map(|c| Box::new(c) as _))
            }
        };
        match attempt? {
            Some(channel) => return Ok(channel),
            None if start.elapsed() >= wait => {
                let seconds = wait.as_secs_f64();
                return Err(PeerError::channel(Notice::new(
                    format!("no run listens at {address} after {seconds} s"),
                    format!("start `voidage run SCENE --fluid attach:{address}` first"),
                )));
            }
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    }
}

/// Waits for a frame until there has been no sign of life for `silence`. `look` is called about every 100 ms.
///
/// # Errors
/// Those of [`Channel::poll`] and `look`, and silence.
pub fn receive(
    channel: &mut dyn Channel,
    silence: Duration,
    mut look: impl FnMut() -> Result<(), PeerError>,
) -> Result<Frame, PeerError> {
    let mut heard = Instant::now();
    loop {
        match channel.poll(LOOK.min(silence))? {
            Event::Frame(frame) => return Ok(*frame),
            Event::Heartbeat => heard = Instant::now(),
            Event::Nothing if heard.elapsed() >= silence => {
                return Err(PeerError::Silent { seconds: silence.as_secs_f64() });
            }
            Event::Nothing => {
                let Err(error) = look() else { continue };
                // It may have spoken between the last look at the channel and its end.
                return match channel.poll(Duration::from_millis(1)) {
                    Ok(Event::Frame(frame)) => Ok(*frame),
                    _ => Err(error),
                };
            }
        }
    }
}
