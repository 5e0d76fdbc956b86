//! The frames over TCP: header and payload as they lie in memory.

use super::{Channel, Event, Frame, LOOK, Loan, Pulse};
use crate::protocol::{HEADER_BYTES, Header, Kind};
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
}

/// An end of a TCP connection.
pub struct Tcp {
    /// Taken away once the solver is there.
    listener: Option<TcpListener>,
    /// For reading.
    stream: Option<TcpStream>,
    /// For writing: heartbeats must not get into a frame.
    writer: Arc<Mutex<Option<TcpStream>>>,
    partial: Partial,
    /// Longest time in which the other end takes nothing.
    silence: Duration,
}

impl Tcp {
    fn closed(silence: Duration) -> Self {
        let (writer, partial) = (Arc::default(), Partial::default());
        Self { listener: None, stream: None, writer, partial, silence }
    }

    /// Listens at `HOST:PORT`, for one solver; also returns where, with the port that was chosen for port 0.
    ///
    /// # Errors
    /// The port is in use.
    pub fn listen(place: &str, silence: Duration) -> Result<(Self, String), PeerError> {
        let cannot = |error: io::Error| PeerError::channel(format!("cannot listen at tcp:{place}: {error}"));
        let listener = TcpListener::bind(place).map_err(cannot)?;
        listener.set_nonblocking(true).map_err(cannot)?;
        let place = listener.local_addr().map_err(cannot)?.to_string();
        Ok((Self { listener: Some(listener), ..Self::closed(silence) }, place))
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

    /// Reads on; `None` if there is no whole frame in this time.
    fn read_on(&mut self) -> Result<Option<Frame>, PeerError> {
        let Some(stream) = &mut self.stream else { return Err(PeerError::Gone) };
        let Partial { header, payload, read } = &mut self.partial;
        if *read < HEADER_BYTES && !fill(stream, header_bytes_mut(header), 0, read)? {
            return Ok(None);
        }
        if payload.is_empty() {
            // Before its length is believed.
            header.kind()?;
            let length = header.length;
            if length > isize::MAX as u64 / 8 || payload.try_reserve_exact(length as usize).is_err() {
                return Err(PeerError::protocol(format!("a frame that says it has {length} numbers")));
            }
            payload.resize(length as usize, 0.0);
        }
        if !fill(stream, bytes_mut(payload), HEADER_BYTES, read)? {
            return Ok(None);
        }
        let Partial { header, payload, .. } = std::mem::take(&mut self.partial);
        Frame::owned(header, payload).map(Some)
    }
}

/// Fills a part of a frame that starts at `start`, of which `read` bytes are there; `false` if it takes longer.
fn fill(stream: &mut TcpStream, part: &mut [u8], start: usize, read: &mut usize) -> Result<bool, PeerError> {
    while *read < start + part.len() {
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
        let Some(stream) = &self.stream else { return Err(PeerError::Gone) };
        stream.set_read_timeout(Some(wait)).map_err(broken)?;
        let before = self.partial.read;
        match self.read_on()? {
            Some(frame) if frame.kind() == Kind::Heartbeat => Ok(Event::Heartbeat),
            Some(frame) => Ok(Event::Frame(Box::new(frame))),
            // A long frame on its way is a sign of life.
            None if self.partial.read > before => Ok(Event::Heartbeat),
            None => Ok(Event::Nothing),
        }
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
