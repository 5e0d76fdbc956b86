//! The frames over TCP: header and payload as they lie in memory.

use super::{Channel, Event, Frame, LOOK, Loan, Pulse};
use crate::error::PeerError;
use crate::protocol::{HEADER_BYTES, Header, Kind};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Longest pause inside a frame.
const PAUSE: Duration = Duration::from_secs(10);

/// An end of a TCP connection.
pub struct Tcp {
    /// Taken away once the solver is there.
    listener: Option<TcpListener>,
    /// For reading.
    stream: Option<TcpStream>,
    /// For writing: heartbeats must not get into a frame.
    writer: Arc<Mutex<Option<TcpStream>>>,
}

impl Tcp {
    /// Listens at `HOST:PORT`, for one solver; also returns where, with the port that was chosen for port 0.
    ///
    /// # Errors
    /// The port is in use.
    pub fn listen(place: &str) -> Result<(Self, String), PeerError> {
        let cannot = |error: io::Error| PeerError::Channel(format!("cannot listen at tcp:{place}: {error}"));
        let listener = TcpListener::bind(place).map_err(cannot)?;
        listener.set_nonblocking(true).map_err(cannot)?;
        let place = listener.local_addr().map_err(cannot)?.to_string();
        Ok((Self { listener: Some(listener), stream: None, writer: Arc::default() }, place))
    }

    /// Connects to the grains at `HOST:PORT`; `None` if nobody listens there yet.
    ///
    /// # Errors
    /// The address cannot be used at all.
    pub fn connect(place: &str) -> Result<Option<Self>, PeerError> {
        match TcpStream::connect(place) {
            Ok(stream) => {
                let mut channel = Self { listener: None, stream: None, writer: Arc::default() };
                channel.use_stream(stream).map_err(broken)?;
                Ok(Some(channel))
            }
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => Ok(None),
            Err(error) => Err(PeerError::Channel(format!("cannot connect to tcp:{place}: {error}"))),
        }
    }

    fn use_stream(&mut self, stream: TcpStream) -> io::Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(PAUSE))?;
        *self.writer.lock().unwrap_or_else(PoisonError::into_inner) = Some(stream.try_clone()?);
        self.stream = Some(stream);
        self.listener = None;
        Ok(())
    }

    /// Waits for the solver to connect.
    fn accept(&mut self, wait: Duration) -> Result<bool, PeerError> {
        let start = Instant::now();
        while let Some(listener) = &self.listener {
            match listener.accept() {
                Ok((stream, _)) => self.use_stream(stream).map_err(broken)?,
                Err(error) if error.kind() != ErrorKind::WouldBlock => return Err(broken(error)),
                Err(_) if start.elapsed() >= wait => return Ok(false),
                Err(_) => std::thread::sleep(Duration::from_millis(5)),
            }
        }
        Ok(true)
    }

    fn read_frame(&mut self) -> Result<Frame, PeerError> {
        let Some(stream) = &mut self.stream else { return Err(PeerError::Gone) };
        stream.set_read_timeout(Some(PAUSE)).map_err(broken)?;
        let mut header = Header::default();
        stream.read_exact(header_bytes_mut(&mut header)).map_err(broken)?;
        // Before its length is believed.
        header.kind()?;
        let (mut payload, length) = (Vec::new(), header.length);
        if length > isize::MAX as u64 / 8 || payload.try_reserve_exact(length as usize).is_err() {
            return Err(PeerError::Protocol(format!("a frame that says it has {length} numbers")));
        }
        payload.resize(length as usize, 0.0);
        stream.read_exact(bytes_mut(&mut payload)).map_err(broken)?;
        Frame::owned(header, payload)
    }
}

impl Channel for Tcp {
    fn loan(&mut self, length: usize) -> Result<Loan, PeerError> {
        Ok(Loan::Owned(vec![0.0; length]))
    }

    fn send(&mut self, header: &Header, mut payload: Loan) -> Result<(), PeerError> {
        write(&self.writer, header, payload.payload_mut())
    }

    fn poll(&mut self, wait: Duration) -> Result<Event, PeerError> {
        // A read time-out of zero would mean for ever.
        let wait = wait.clamp(Duration::from_millis(1), LOOK);
        if !self.accept(wait)? {
            return Ok(Event::Nothing);
        }
        let Some(stream) = &self.stream else { return Err(PeerError::Gone) };
        stream.set_read_timeout(Some(wait)).map_err(broken)?;
        match stream.peek(&mut [0]) {
            Ok(0) => Err(PeerError::Gone),
            Ok(_) => {
                let frame = self.read_frame()?;
                let beat = frame.kind() == Kind::Heartbeat;
                Ok(if beat { Event::Heartbeat } else { Event::Frame(frame) })
            }
            Err(error) if is_wait(&error) => Ok(Event::Nothing),
            Err(error) => Err(broken(error)),
        }
    }

    fn pulse(&self) -> Pulse {
        let writer = self.writer.clone();
        Box::new(move || {
            // A peer that is gone shows when the answer is sent.
            let _ = write(&writer, &Header::new(Kind::Heartbeat), &[]);
        })
    }
}

fn write(writer: &Mutex<Option<TcpStream>>, header: &Header, payload: &[f64]) -> Result<(), PeerError> {
    let mut writer = writer.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(stream) = writer.as_mut() else { return Err(PeerError::Gone) };
    stream.write_all(header_bytes(header)).and_then(|()| stream.write_all(bytes(payload))).map_err(broken)
}

fn is_wait(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

/// A connection ends in many ways that all mean the same.
fn broken(error: io::Error) -> PeerError {
    use ErrorKind::{BrokenPipe, ConnectionAborted, ConnectionReset, UnexpectedEof};
    match error.kind() {
        BrokenPipe | ConnectionAborted | ConnectionReset | UnexpectedEof => PeerError::Gone,
        _ if is_wait(&error) => PeerError::Silent { seconds: PAUSE.as_secs_f64() },
        _ => PeerError::Channel(format!("the connection failed: {error}")),
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

/// 11 fields of 8 bytes and 6 of 4.
const _: () = assert!(HEADER_BYTES == 11 * 8 + 6 * 4);
