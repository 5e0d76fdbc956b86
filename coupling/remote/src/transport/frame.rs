//! Frames as they are received, and memory for those to be sent.

use super::shared::{LoanedSample, ReceivedSample};
use crate::protocol::{Header, Kind, read_text};
use std::ptr::NonNull;
use std::sync::Mutex;
use voidage_coupling::error::PeerError;

enum Payload {
    /// Samples may change threads but not be shared by them: the sample is kept, and never used but to be dropped.
    Shared {
        numbers: NonNull<[f64]>,
        _sample: Mutex<ReceivedSample>,
    },
    Owned(Vec<f64>),
}

/// A frame that was received: a valid header, and a payload that is read where it lies.
pub struct Frame {
    kind: Kind,
    header: Header,
    payload: Payload,
}

// SAFETY: `numbers` is read-only shared memory that `_sample` keeps in place, wherever the frame goes.
unsafe impl Send for Frame {}
// SAFETY: as above; nothing changes the payload while the frame lives.
unsafe impl Sync for Frame {}

impl Frame {
    pub(super) fn shared(sample: ReceivedSample) -> Result<Self, PeerError> {
        let (header, numbers) = (*sample.user_header(), NonNull::from(sample.payload()));
        Self::new(header, Payload::Shared { numbers, _sample: Mutex::new(sample) })
    }

    pub(super) fn owned(header: Header, payload: Vec<f64>) -> Result<Self, PeerError> {
        Self::new(header, Payload::Owned(payload))
    }

    fn new(header: Header, payload: Payload) -> Result<Self, PeerError> {
        let frame = Self { kind: header.kind()?, header, payload };
        let (said, are) = (header.length, frame.payload().len());
        if said != are as u64 {
            return Err(PeerError::protocol(format!("a frame of {are} numbers that says it has {said}")));
        }
        Ok(frame)
    }

    /// What it is.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Its header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Its payload.
    pub fn payload(&self) -> &[f64] {
        match &self.payload {
            // SAFETY: `_sample` keeps the memory where it was when the frame was made.
            Payload::Shared { numbers, .. } => unsafe { numbers.as_ref() },
            Payload::Owned(numbers) => numbers,
        }
    }

    /// Its text; empty if there is none.
    ///
    /// # Errors
    /// No UTF-8.
    pub fn text(&self) -> Result<String, PeerError> {
        read_text(&self.header, self.payload())
    }
}

/// Memory for the payload of a frame.
pub enum Loan {
    /// In shared memory.
    Shared(LoanedSample),
    /// On the heap.
    Owned(Vec<f64>),
}

impl Loan {
    /// The payload to write.
    pub fn payload_mut(&mut self) -> &mut [f64] {
        match self {
            Loan::Shared(sample) => sample.payload_mut(),
            Loan::Owned(numbers) => numbers,
        }
    }
}
