//! The frames over TCP: header and payload as they lie in memory.

use super::{Channel, Event, Frame, LOOK, Loan, Pulse};
use crate::protocol::{Greeting, HEADER_BYTES, Header, Kind};
use crate::token::Token;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use voidage_coupling::error::PeerError;

/// A frame of which a part has been read.
#[derive(Default)]
struct Partial {
    header: Header,
    payload: Vec<f64>,
    /// Bytes read, those of the header first.
    read: usize,
    /// When it was first seen, and whether it was found to be late once.
    since: Option<Instant>,
    late: bool,
}

impl Partial {
    /// Reads on, for a tenth of a second at most; `None` if there is no whole frame then. Its payload may have so many
    /// numbers.
    fn read_on(&mut self, stream: &mut TcpStream, longest: usize) -> Result<Option<Frame>, PeerError> {
        let end = Instant::now() + LOOK;
        let Self { header, payload, read, .. } = self;
        if *read < HEADER_BYTES && !fill(stream, header_bytes_mut(header), 0, read, end)? {
            return Ok(None);
        }
        if payload.is_empty() {
            // Before its length is believed.
            header.kind()?;
            let length = header.length;
            if length > longest as u64 {
                let text =
                    format!("a frame that says it has {length} numbers, where at most {longest} belong");
                return Err(PeerError::protocol(text));
            }
            if payload.try_reserve_exact(length as usize).is_err() {
                return Err(PeerError::channel(format!(
                    "there is no memory for a frame of {length} numbers"
                )));
            }
            payload.resize(length as usize, 0.0);
        }
        if !fill(stream, bytes_mut(payload), HEADER_BYTES, read, end)? {
            return Ok(None);
        }
        let Partial { header, payload, .. } = std::mem::take(self);
        Frame::owned(header, payload).map(Some)
    }

    /// Whether a frame has been on its way for longer than this. A process that was stopped finds it late when it goes
    /// on: it looks once more.
    fn is_late(&mut self, longest: Duration) -> bool {
        if self.read == 0 {
            return false;
        }
        let late = self.since.get_or_insert_with(Instant::now).elapsed() > longest;
        std::mem::replace(&mut self.late, late) && late
    }
}

/// Somebody who has connected and may be the solver.
struct Visitor {
    stream: TcpStream,
    hello: Partial,
    since: Instant,
}

/// Where solvers knock.
struct Door {
    listener: TcpListener,
    token: Token,
    visitors: Vec<Visitor>,
}

/// Visitors at a time; the system keeps further ones waiting.
const VISITORS: usize = 64;
/// How long a visitor may take to greet.
const GREETING: Duration = Duration::from_secs(5);

/// What a look at the visitors has found.
enum Knock {
    /// The solver, and its hello.
    Solver(TcpStream, Box<Frame>),
    /// Somebody has been turned away.
    Other(String),
    Nobody,
}

impl Door {
    /// Lets visitors in, and looks what they say.
    fn look(&mut self) -> Result<Knock, PeerError> {
        while self.visitors.len() < VISITORS {
            match self.listener.accept() {
                Ok((stream, _)) => {
                    // A visitor of whom one would have to wait is none.
                    if stream.set_nonblocking(true).is_ok() {
                        self.visitors.push(Visitor {
                            stream,
                            hello: Partial::default(),
                            since: Instant::now(),
                        });
                    }
                }
                Err(error) if is_wait(&error) => break,
                // Somebody who connects and goes at once is no error of the door.
                Err(error) if error.kind() == ErrorKind::ConnectionAborted => {}
                Err(error) => return Err(broken(error)),
            }
        }
        for k in 0..self.visitors.len() {
            let Visitor { stream, hello, since } = &mut self.visitors[k];
            let greeted = hello.read_on(stream, Greeting::LONGEST).and_then(|frame| {
                let greeting =
                    frame.map(|frame| Greeting::read(frame.header(), frame.payload()).map(|g| (g, frame)));
                greeting.transpose()
            });
            match greeted {
                Ok(Some((greeting, frame))) if self.token.admits(&greeting) => {
                    let Visitor { stream, .. } = self.visitors.swap_remove(k);
                    return Ok(Knock::Solver(stream, Box::new(frame)));
                }
                Ok(Some((greeting, _))) => {
                    self.visitors.swap_remove(k);
                    return Ok(Knock::Other(format!(
                        "\"{}\" has not the token of this run",
                        greeting.solver
                    )));
                }
                // Without a token everybody is believed, also that he is a solver of another version.
                Err(error) if self.token.word().is_none() && hello.header.is_of_another_version() => {
                    return Err(error);
                }
                Err(error) => {
                    self.visitors.swap_remove(k);
                    return Ok(Knock::Other(error.to_string()));
                }
                Ok(None) if since.elapsed() > GREETING => {
                    self.visitors.swap_remove(k);
                    return Ok(Knock::Other(format!("no hello within {} s", GREETING.as_secs())));
                }
                Ok(None) => {}
            }
        }
        Ok(Knock::Nobody)
    }
}

/// An end of a TCP connection.
pub struct Tcp {
    /// Taken away once the solver is there.
    door: Option<Door>,
    /// Why the last visitor was turned away.
    turned_away: Option<String>,
    /// For reading.
    stream: Option<TcpStream>,
    /// For writing: heartbeats must not get into a frame.
    writer: Arc<Mutex<Option<TcpStream>>>,
    /// The hello of the solver, to be received.
    hello: Option<Box<Frame>>,
    partial: Partial,
    /// Longest payload, numbers.
    longest: usize,
    /// Longest time in which the other end takes nothing, or a frame is on its way.
    silence: Duration,
}

impl Tcp {
    fn closed(silence: Duration) -> Self {
        Self {
            door: None,
            turned_away: None,
            stream: None,
            writer: Arc::default(),
            hello: None,
            partial: Partial::default(),
            longest: isize::MAX as usize / 8,
            silence,
        }
    }

    /// Listens at `HOST:PORT`, for one solver that greets with the token; also returns where, with the port that was
    /// chosen for port 0.
    ///
    /// # Errors
    /// The port is in use.
    pub fn listen(place: &str, silence: Duration, token: Token) -> Result<(Self, String), PeerError> {
        let cannot = |error: io::Error| PeerError::channel(format!("cannot listen at tcp:{place}: {error}"));
        let listener = TcpListener::bind(place).map_err(cannot)?;
        listener.set_nonblocking(true).map_err(cannot)?;
        let place = listener.local_addr().map_err(cannot)?.to_string();
        let door = Door { listener, token, visitors: vec![] };
        Ok((Self { door: Some(door), ..Self::closed(silence) }, place))
    }

    /// Connects to the grains at `HOST:PORT`; `None` if nobody listens there yet.
    ///
    /// # Errors
    /// The address cannot be used at all.
    pub fn connect(place: &str, silence: Duration) -> Result<Option<Self>, PeerError> {
        match TcpStream::connect(place) {
            Ok(stream) => {
                let mut channel = Self::closed(silence);
                channel.use_stream(stream).map_err(broken)?;
                Ok(Some(channel))
            }
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => Ok(None),
            Err(error) => Err(PeerError::channel(format!("cannot connect to tcp:{place}: {error}"))),
        }
    }

    fn use_stream(&mut self, stream: TcpStream) -> io::Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(self.silence))?;
        *self.writer.lock().unwrap_or_else(PoisonError::into_inner) = Some(stream.try_clone()?);
        self.stream = Some(stream);
        Ok(())
    }

    /// Waits for the solver to come and greet; others are turned away meanwhile.
    fn accept(&mut self, wait: Duration) -> Result<bool, PeerError> {
        let start = Instant::now();
        while let Some(door) = &mut self.door {
            match door.look()? {
                Knock::Solver(stream, hello) => {
                    self.use_stream(stream).map_err(broken)?;
                    (self.door, self.hello) = (None, Some(hello));
                }
                Knock::Other(why) => self.turned_away = Some(why),
                Knock::Nobody if start.elapsed() >= wait => return Ok(false),
                Knock::Nobody => std::thread::sleep(Duration::from_millis(5)),
            }
        }
        Ok(true)
    }
}

/// Fills a part of a frame that starts at `start`, of which `read` bytes are there; `false` if it takes longer, or goes
/// on beyond `end`.
fn fill(
    stream: &mut TcpStream,
    part: &mut [u8],
    start: usize,
    read: &mut usize,
    end: Instant,
) -> Result<bool, PeerError> {
    while *read < start + part.len() {
        if Instant::now() >= end {
            return Ok(false);
        }
        match stream.read(&mut part[*read - start..]) {
            Ok(0) => return Err(PeerError::Gone),
            Ok(count) => *read += count,
            Err(error) if is_wait(&error) => return Ok(false),
            Err(error) => return Err(broken(error)),
        }
    }
    Ok(true)
}

impl Channel for Tcp {
    fn loan(&mut self, length: usize) -> Result<Loan, PeerError> {
        Ok(Loan::Owned(vec![0.0; length]))
    }

    fn send(&mut self, header: &Header, mut payload: Loan) -> Result<(), PeerError> {
        // Grains that speak first may have a solver that has just connected.
        self.accept(LOOK)?;
        write(&self.writer, header, payload.payload_mut()).map_err(|error| match is_wait(&error) {
            true => PeerError::Silent { seconds: self.silence.as_secs_f64() },
            false => broken(error),
        })
    }

    fn poll(&mut self, wait: Duration) -> Result<Event, PeerError> {
        // A read time-out of zero would mean for ever.
        let wait = wait.clamp(Duration::from_millis(1), LOOK);
        if !self.accept(wait)? {
            return Ok(Event::Nothing);
        }
        if let Some(hello) = self.hello.take() {
            return Ok(Event::Frame(hello));
        }
        let Self { stream, partial, silence, longest, .. } = self;
        let Some(stream) = stream else { return Err(PeerError::Gone) };
        stream.set_read_timeout(Some(wait)).map_err(broken)?;
        let before = partial.read;
        match partial.read_on(stream, *longest)? {
            Some(frame) if frame.kind() == Kind::Heartbeat => Ok(Event::Heartbeat),
            Some(frame) => Ok(Event::Frame(Box::new(frame))),
            None if partial.is_late(*silence) => Err(PeerError::protocol(format!(
                "a frame that is not complete after {} s",
                silence.as_secs_f64()
            ))),
            // A long frame on its way is a sign of life.
            None if partial.read > before => Ok(Event::Heartbeat),
            None => Ok(Event::Nothing),
        }
    }

    fn allow(&mut self, numbers: usize) {
        self.longest = numbers.min(isize::MAX as usize / 8);
    }

    fn turned_away(&self) -> Option<&str> {
        self.turned_away.as_deref()
    }

    fn pulse(&self) -> Pulse {
        let writer = self.writer.clone();
        Box::new(move || {
            // The first write to a closed connection may pass, the next one does not.
            write(&writer, &Header::new(Kind::Heartbeat), &[]).is_ok()
        })
    }
}

fn write(writer: &Mutex<Option<TcpStream>>, header: &Header, payload: &[f64]) -> io::Result<()> {
    let mut writer = writer.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(stream) = writer.as_mut() else { return Err(ErrorKind::BrokenPipe.into()) };
    stream.write_all(header_bytes(header))?;
    stream.write_all(bytes(payload))
}

fn is_wait(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

/// A connection ends in many ways that all mean the same.
fn broken(error: io::Error) -> PeerError {
    use ErrorKind::{BrokenPipe, ConnectionAborted, ConnectionReset, UnexpectedEof};
    match error.kind() {
        BrokenPipe | ConnectionAborted | ConnectionReset | UnexpectedEof => PeerError::Gone,
        _ => PeerError::channel(format!("the connection failed: {error}")),
    }
}

fn bytes(numbers: &[f64]) -> &[u8] {
    // SAFETY: numbers have no padding, and bytes no alignment.
    unsafe { std::slice::from_raw_parts(numbers.as_ptr().cast(), size_of_val(numbers)) }
}

fn bytes_mut(numbers: &mut [f64]) -> &mut [u8] {
    // SAFETY: as above, and any bytes are numbers.
    unsafe { std::slice::from_raw_parts_mut(numbers.as_mut_ptr().cast(), size_of_val(numbers)) }
}

fn header_bytes(header: &Header) -> &[u8] {
    // SAFETY: the fields fill the header without padding (asserted below).
    unsafe { std::slice::from_raw_parts(std::ptr::from_ref(header).cast(), HEADER_BYTES) }
}

fn header_bytes_mut(header: &mut Header) -> &mut [u8] {
    // SAFETY: as above, and all its fields are numbers, which any bytes are.
    unsafe { std::slice::from_raw_parts_mut(std::ptr::from_mut(header).cast(), HEADER_BYTES) }
}

/// 13 fields of 8 bytes and 6 of 4.
const _: () = assert!(HEADER_BYTES == 13 * 8 + 6 * 4);
