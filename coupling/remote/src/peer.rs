//! The solver's side of a run: what a fluid solver in its own process needs, in any language.

use crate::protocol::{Greeting, Header, Kind, numbers_for_text, write_text};
use crate::token::Token;
use crate::transport::{self, Address, Channel, Event, Frame, LOOK, Loan, Pulse};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use voidage_coupling::error::{Notice, PeerError};

/// How long a solver that fails waits for the run to read why.
const LINGER: Duration = Duration::from_secs(1);

/// Longest payload of the setup of a run, numbers.
pub(crate) const LONGEST_SETUP: usize = 1 << 23;

/// Time between two signs of life while a request is being answered.
const BEAT: Duration = Duration::from_millis(200);

/// The connection of a fluid solver to its run. Requests come by [`Peer::receive`], each gets one answer; meanwhile
/// heartbeats go out from a thread of their own.
pub struct Peer {
    channel: Box<dyn Channel>,
    heart: Heart,
    /// Number of the run.
    run: u64,
    /// Header of the request in hand, which the answer repeats.
    request: Header,
    /// When it came.
    arrived: Instant,
}

impl Peer {
    /// Connects to a run, waiting so long for it to be there, and returns its setup, a JSON text
    /// ([`crate::protocol::Setup`]). `solver` is the name and version to present oneself with, `token` the word that
    /// the run asks for.
    ///
    /// # Errors
    /// There is no such run, it is of another version, or it asks for another token.
    pub fn connect(
        address: &Address,
        solver: &str,
        token: &Token,
        wait: Duration,
    ) -> Result<(Self, String), PeerError> {
        let mut channel = transport::connect(address, wait)?;
        channel.allow(LONGEST_SETUP);
        let heart = Heart::start(channel.pulse());
        let mut peer = Self { channel, heart, run: 0, request: Header::default(), arrived: Instant::now() };
        let greeting = serde_json::json!(Greeting::new(solver, token)).to_string();
        peer.answer_text(Kind::Hello, &greeting)?;
        let answer = transport::receive(&mut *peer.channel, wait.max(LOOK), || Ok(()));
        let setup = answer.map_err(|error| match error {
            PeerError::Gone => PeerError::channel(Notice::new(
                format!("the run at {address} takes no solver that greets with {token:?}"),
                "give both the same with --token, or in VOIDAGE_TOKEN",
            )),
            other => other,
        })?;
        if setup.kind() != Kind::Hello {
            return Err(PeerError::protocol(format!("{:?} instead of a hello", setup.kind())));
        }
        peer.run = setup.header().run;
        peer.channel.allow(usize::MAX);
        Ok((peer, setup.text()?))
    }

    /// Ends this process, with exit code 1, when the run is gone while a request is being answered: nobody waits for
    /// the answer, and a solve may be long.
    pub fn end_with_run(&self) {
        self.heart.ends.store(true, Ordering::Relaxed);
    }

    /// Waits for a request, at most for this time; `None` if there is none yet.
    ///
    /// # Errors
    /// The run is gone, or sent what is no frame of this run.
    pub fn receive(&mut self, wait: Duration) -> Result<Option<Frame>, PeerError> {
        let start = Instant::now();
        loop {
            let left = wait.saturating_sub(start.elapsed());
            match self.channel.poll(left.min(LOOK))? {
                Event::Frame(frame) if frame.header().run != self.run => {
                    let other = frame.header().run;
                    return Err(PeerError::protocol(format!("a frame of the run {other:x}")));
                }
                Event::Frame(frame) => {
                    self.request = *frame.header();
                    self.arrived = Instant::now();
                    // Nobody waits for an answer to a goodbye, and the run may be gone before it has been read.
                    self.heart.beat(frame.kind() != Kind::Bye);
                    return Ok(Some(*frame));
                }
                Event::Heartbeat | Event::Nothing if left.is_zero() => return Ok(None),
                Event::Heartbeat | Event::Nothing => {}
            }
        }
    }

    /// Memory for the payload of an answer.
    ///
    /// # Errors
    /// There is not enough of it.
    pub fn loan(&mut self, length: usize) -> Result<Loan, PeerError> {
        self.channel.loan(length)
    }

    /// Answers the request in hand. Of the header, kind, columns and length count; the rest is that of the request.
    ///
    /// # Errors
    /// The run is gone.
    pub fn answer(&mut self, header: &Header, payload: Loan) -> Result<(), PeerError> {
        self.heart.beat(false);
        let Header { generation, step, iteration, time, .. } = self.request;
        let dt = self.arrived.elapsed().as_secs_f64();
        let header = Header { run: self.run, generation, step, iteration, time, dt, ..*header };
        self.channel.send(&header, payload)
    }

    /// Answers that a mesh or a state has been taken.
    ///
    /// # Errors
    /// The run is gone.
    pub fn done(&mut self) -> Result<(), PeerError> {
        let payload = self.loan(0)?;
        let kind = self.request.kind()?;
        self.answer(&Header::new(kind), payload)
    }

    /// Answers that the request cannot be fulfilled, and why: the user will read it.
    ///
    /// # Errors
    /// The run is gone.
    pub fn fail(&mut self, text: &str) -> Result<(), PeerError> {
        self.answer_text(Kind::Error, text)
    }

    /// Waits until the run has read the last answer, which its goodbye says: shared memory that it has not opened yet
    /// goes with this process.
    pub fn linger(&mut self) {
        // A run that is gone reads nothing.
        let _ = self.receive(LINGER);
    }

    fn answer_text(&mut self, kind: Kind, text: &str) -> Result<(), PeerError> {
        let length = numbers_for_text(text);
        let mut payload = self.loan(length)?;
        write_text(text, payload.payload_mut());
        self.answer(&Header { text: text.len() as u64, length: length as u64, ..Header::new(kind) }, payload)
    }
}

/// A thread that sends heartbeats while it is told to.
struct Heart {
    beats: Arc<AtomicBool>,
    /// Whether the process ends with the run.
    ends: Arc<AtomicBool>,
    stops: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Heart {
    fn start(pulse: Pulse) -> Self {
        let [beats, ends, stops]: [Arc<AtomicBool>; 3] = Default::default();
        let (may_beat, must_end, must_stop) = (beats.clone(), ends.clone(), stops.clone());
        let thread = thread::spawn(move || {
            while !must_stop.load(Ordering::Relaxed) {
                thread::park_timeout(BEAT);
                let answering = || may_beat.load(Ordering::Relaxed);
                // The answer may have gone out, and the run ended, since the first look.
                if answering() && !pulse() && answering() && must_end.load(Ordering::Relaxed) {
                    end();
                }
            }
        });
        Self { beats, ends, stops, thread: Some(thread) }
    }

    fn beat(&self, on: bool) {
        self.beats.store(on, Ordering::Relaxed);
    }
}

/// Ends the process.
fn end() {
    eprintln!("the run is gone, in the middle of a request: it was killed, or the connection broke");
    // What runs at the exit of a process may wait for the thread that solves.
    thread::spawn(|| {
        thread::sleep(2 * BEAT);
        std::process::abort();
    });
    std::process::exit(1);
}

impl Drop for Heart {
    fn drop(&mut self) {
        self.stops.store(true, Ordering::Relaxed);
        self.beat(false);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // It only ends early by a panic, which has been printed.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// It once ended with exit code 1, at times: the goodbye counted as a request.
    #[test]
    fn a_solver_that_has_read_a_goodbye_outlives_the_run() -> Result<(), PeerError> {
        for address in [Address::unique(), Address::any_port()] {
            let wait = Duration::from_secs(5);
            let (mut run, address) = transport::listen(&address, wait, &Token::default())?;
            let say = |run: &mut dyn Channel, kind, text: &str| {
                let length = numbers_for_text(text);
                let mut payload = run.loan(length)?;
                write_text(text, payload.payload_mut());
                run.send(
                    &Header { text: text.len() as u64, length: length as u64, ..Header::new(kind) },
                    payload,
                )
            };
            let (tell, told) = std::sync::mpsc::channel();
            let solver = thread::spawn(move || {
                let (mut peer, _) = Peer::connect(&address, "a test", &Token::default(), wait)?;
                peer.end_with_run();
                let last = peer.receive(wait)?.map(|frame| frame.kind());
                let _ = tell.send(());
                // Long enough for the thread that looks after the run.
                thread::sleep(4 * BEAT);
                Ok::<_, PeerError>(last)
            });
            transport::receive(&mut *run, wait, || Ok(()))?;
            say(&mut *run, Kind::Hello, "{}")?;
            say(&mut *run, Kind::Bye, "")?;
            let _ = told.recv();
            drop(run);
            let last = solver.join().expect("no panic")?;
            assert_eq!(last, Some(Kind::Bye));
        }
        Ok(())
    }
}
