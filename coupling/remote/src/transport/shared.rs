//! The frames in shared memory, by iceoryx2: a publish-subscribe service for each direction, whose samples are the
//! payloads, and an event service beside it that wakes the receiver.

use super::{Channel, Event, Frame, LOOK, Loan, Pulse};
use crate::protocol::{Header, VERSION};
use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use std::fmt::Debug;
use std::sync::Arc;
use std::time::Duration;
use voidage_coupling::error::{Notice, PeerError};

type Ipc = ipc_threadsafe::Service;
/// A payload as received.
pub type ReceivedSample = Sample<Ipc, [f64], Header>;
/// Memory for a payload, in shared memory.
pub type LoanedSample = SampleMut<Ipc, [f64], Header>;
type Data = publish_subscribe::PortFactory<Ipc, [f64], Header>;

const TO_FLUID: &str = "grains-to-fluid";
const TO_GRAINS: &str = "fluid-to-grains";
/// Frames that a receiver may hold at once (views in Python keep theirs).
const HELD: usize = 4;
/// Frames on their way: questions and answers alternate, a farewell may come on top.
const UNDER_WAY: usize = 2;
/// Samples that iceoryx2 makes room for: those above, the loaned one, and one on each side.
const SAMPLES: u64 = (HELD + UNDER_WAY) as u64 + 3;
/// What services and ports take beside the payloads, with a margin, bytes.
const FIRST: u64 = 2 << 20;
const WAKE: usize = 0;
const BEAT: usize = 1;

/// An end of a connection through shared memory.
pub struct Shared {
    publisher: Publisher<Ipc, [f64], Header>,
    subscriber: Subscriber<Ipc, [f64], Header>,
    notifier: Arc<Notifier<Ipc>>,
    listener: Listener<Ipc>,
    incoming: Data,
    node: Node<Ipc>,
    /// Whether the other process has been there.
    met: bool,
    /// Largest payload so far, numbers: longer ones need new memory.
    capacity: usize,
    free: fn() -> Option<u64>,
}

/// Bytes free where shared memory lies; `None` where that is not a file system.
pub fn free_bytes() -> Option<u64> {
    let stat = rustix::fs::statvfs("/dev/shm").ok()?;
    Some(stat.f_bavail * stat.f_frsize)
}

/// A process that writes to a full `/dev/shm` is killed by the system: better not to begin.
fn need(bytes: u64, free: Option<u64>) -> Result<(), PeerError> {
    match free {
        Some(free) if free < bytes => {
            let mebibyte = f64::from(1 << 20);
            Err(PeerError::channel(Notice::new(
                format!(
                    "shared memory (/dev/shm) has {:.1} MiB free, {:.1} MiB are needed",
                    free as f64 / mebibyte,
                    bytes as f64 / mebibyte
                ),
                "`mount -o remount,size=1G /dev/shm` (in a container `--shm-size=1g`), or use `--transport tcp`",
            )))
        }
        _ => Ok(()),
    }
}

fn cannot<E: Debug>(what: &str) -> impl Fn(E) -> PeerError + '_ {
    move |error| PeerError::channel(format!("shared memory: cannot {what}: {error:?}"))
}

/// The name space of voidage.
fn config() -> Result<Config, PeerError> {
    let mut config = Config::default();
    config.global.prefix = FileName::new(b"voidage_").map_err(cannot("make a name"))?;
    Ok(config)
}

/// A node of this process. What processes left that were killed is removed first.
fn node() -> Result<Node<Ipc>, PeerError> {
    let config = config()?;
    let builder = NodeBuilder::new().config(&config).signal_handling_mode(SignalHandlingMode::Disabled);
    let node = builder.create::<Ipc>().map_err(cannot("make a node"))?;
    node.try_cleanup_dead_nodes();
    Ok(node)
}

fn name(run: &str, direction: &str) -> Result<ServiceName, PeerError> {
    ServiceName::new(&format!("voidage/{run}/{direction}")).map_err(cannot("name a service"))
}

/// What it means that a service of this name is there.
fn occupied<E: Debug>(run: &str) -> impl Fn(E) -> PeerError + '_ {
    move |error| {
        PeerError::channel(Notice::new(
            format!("shared memory: the run `{run}` cannot be opened: {error:?}"),
            "another run may have this name, or another version of voidage; give another name",
        ))
    }
}

impl Shared {
    /// The end of the grains, under a name that no other run has.
    ///
    /// # Errors
    /// The name is in use, there is no shared memory.
    pub fn create(run: &str) -> Result<Self, PeerError> {
        need(FIRST, free_bytes())?;
        let node = node()?;
        let data = |direction| {
            let builder = node.service_builder(&name(run, direction)?).publish_subscribe::<[f64]>();
            builder
                .user_header::<Header>()
                .enable_safe_overflow(false)
                .history_size(0)
                .max_publishers(1)
                .max_subscribers(1)
                .max_nodes(2)
                .subscriber_max_buffer_size(UNDER_WAY)
                .subscriber_max_borrowed_samples(HELD)
                .create()
                .map_err(occupied(run))
        };
        let events = |direction| {
            let builder = node.service_builder(&name(run, direction)?).event();
            let limited = builder.max_notifiers(1).max_listeners(1).max_nodes(2).event_id_max_value(BEAT);
            limited.create().map_err(occupied(run))
        };
        let services = [data(TO_FLUID)?, data(TO_GRAINS)?];
        let [out, incoming] = services;
        let (wake, wait) = (events(TO_FLUID)?, events(TO_GRAINS)?);
        Self::new(node, out, incoming, (wake, wait), false)
    }

    /// The end of the fluid; `None` if there is no such run yet.
    ///
    /// # Errors
    /// The run has its solver already, or is of another version.
    pub fn open(run: &str) -> Result<Option<Self>, PeerError> {
        // The last service that the grains make.
        let last = name(run, TO_GRAINS)?;
        if !Ipc::does_exist(&last, &config()?, MessagingPattern::Event).map_err(cannot("look for a run"))? {
            return Ok(None);
        }
        let node = node()?;
        let data = |direction| {
            let builder = node.service_builder(&name(run, direction)?).publish_subscribe::<[f64]>();
            builder.user_header::<Header>().open().map_err(occupied(run))
        };
        let events =
            |direction| node.service_builder(&name(run, direction)?).event().open().map_err(occupied(run));
        let (incoming, out) = (data(TO_FLUID)?, data(TO_GRAINS)?);
        let (wait, wake) = (events(TO_FLUID)?, events(TO_GRAINS)?);
        Self::new(node, out, incoming, (wake, wait), true).map(Some)
    }

    fn new(
        node: Node<Ipc>,
        out: Data,
        incoming: Data,
        (wake, wait): (event::PortFactory<Ipc>, event::PortFactory<Ipc>),
        met: bool,
    ) -> Result<Self, PeerError> {
        // Receiving ends first: what is sent to them is then not lost.
        let subscriber = incoming.subscriber_builder().create().map_err(cannot("receive"))?;
        let listener = wait.listener_builder().create().map_err(cannot("wait"))?;
        let publisher = out
            .publisher_builder()
            .initial_max_slice_len(1)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(cannot("send"))?;
        let notifier = Arc::new(wake.notifier_builder().create().map_err(cannot("wake"))?);
        let free = free_bytes;
        Ok(Self { publisher, subscriber, notifier, listener, incoming, node, met, capacity: 1, free })
    }

    /// Replaces the measurement of free memory, for tests.
    #[cfg(test)]
    pub(super) fn with_free(mut self, free: fn() -> Option<u64>) -> Self {
        self.free = free;
        self
    }

    fn take(&mut self) -> Result<Option<Frame>, PeerError> {
        let sample = self.subscriber.receive().map_err(cannot("receive"))?;
        self.met |= sample.is_some();
        sample.map(Frame::shared).transpose()
    }

    /// Whether the other process is there or still to come. One that died, be it before its first frame, is removed
    /// from shared memory.
    fn is_there(&mut self) -> bool {
        let (mut there, mut dead) = (false, false);
        let listed = self.incoming.nodes(|state| {
            if state.node_id() != self.node.id() {
                dead |= matches!(state, NodeState::Dead(_));
                there |= !matches!(state, NodeState::Dead(_));
            }
            CallbackProgression::Continue
        });
        if dead {
            self.node.try_cleanup_dead_nodes();
        }
        self.met |= there || dead;
        there || !self.met || listed.is_err()
    }

    /// The node of the other process; `None` if it is not there.
    fn other(&self) -> Option<UniqueNodeId> {
        let mut other = None;
        // A list that cannot be had is as no list.
        let _ = self.incoming.nodes(|state| {
            other = Some(*state.node_id()).filter(|id| id != self.node.id()).or(other);
            CallbackProgression::Continue
        });
        other
    }
}

impl Channel for Shared {
    fn loan(&mut self, length: usize) -> Result<Loan, PeerError> {
        if length > self.capacity {
            let capacity = length.next_power_of_two();
            need(SAMPLES * 8 * capacity as u64, (self.free)())?;
            self.capacity = capacity;
        }
        let sample = self.publisher.loan_slice_uninit(length).map_err(cannot("get memory"))?;
        // SAFETY: shared memory is mapped with content, zeros or an earlier frame, and any bytes are numbers.
        Ok(Loan::Shared(unsafe { sample.assume_init() }))
    }

    fn send(&mut self, header: &Header, payload: Loan) -> Result<(), PeerError> {
        let Loan::Shared(mut sample) = payload else {
            return Err(PeerError::channel("a payload of another channel"));
        };
        *sample.user_header_mut() = *header;
        let received = sample.send().map_err(cannot("send"))?;
        if received == 0 {
            return Err(match self.is_there() {
                false => PeerError::Gone,
                true => PeerError::channel(format!(
                    "the other process does not take the frames of protocol version {VERSION}"
                )),
            });
        }
        self.notifier.notify_with_custom_event_id(EventId::new(WAKE)).map_err(cannot("wake"))?;
        Ok(())
    }

    fn poll(&mut self, wait: Duration) -> Result<Event, PeerError> {
        if let Some(frame) = self.take()? {
            return Ok(Event::Frame(Box::new(frame)));
        }
        let (mut woken, mut beat) = (false, false);
        // An interrupted wait (a signal) is a short one.
        let _ = self.listener.timed_wait(
            |event| {
                woken = true;
                beat |= event.id.as_value() == BEAT;
            },
            wait.min(LOOK),
        );
        let there = woken || self.is_there();
        match self.take()? {
            Some(frame) => Ok(Event::Frame(Box::new(frame))),
            None if !there => Err(PeerError::Gone),
            None if beat => Ok(Event::Heartbeat),
            None => Ok(Event::Nothing),
        }
    }

    fn pulse(&self) -> Pulse {
        let (notifier, config, other) = (self.notifier.clone(), self.node.config().clone(), self.other());
        Box::new(move || {
            // A peer that is gone shows below, and when the answer is sent.
            let _ = notifier.notify_with_custom_event_id(EventId::new(BEAT));
            match other.map(|id| Node::<Ipc>::state_of(&config, id)) {
                Some(Ok(state)) => state.is_some_and(|state| !matches!(state, NodeState::Dead(_))),
                Some(Err(_)) | None => true,
            }
        })
    }
}
