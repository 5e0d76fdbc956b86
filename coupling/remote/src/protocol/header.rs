//! The header of a frame.

use iceoryx2::prelude::ZeroCopySend;
use std::mem::offset_of;
use voidage_coupling::error::{Notice, PeerError};

/// First bytes of every frame: `VOIDAGE.` as a little-endian number. A machine of the other byte order sees another.
pub const MAGIC: u64 = u64::from_le_bytes(*b"VOIDAGE.");
/// Version of the protocol; both ends must have the same.
pub const VERSION: u32 = 6;
/// A flag or a kind of frames: its name, its number, and what it says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Its name.
    pub name: &'static str,
    /// Its number.
    pub number: u32,
    /// What it says.
    pub about: &'static str,
}

/// Constants of flags, and the list of them, from which `voidage.h` is written.
macro_rules! flags {
    ($($(#[doc = $about:literal])+ $name:ident = $number:literal,)+) => {
        $($(#[doc = $about])+ pub const $name: u32 = $number;)+
        /// All flags.
        pub const FLAGS: &[Listed] =
            &[$(Listed { name: stringify!($name), number: $number, about: concat!($($about),+) }),+];
    };
}

flags! {
    /// Flag of a step or a state: the last solution is accepted, before anything else is done.
    ACCEPT = 1,
    /// Flag of a step: the mesh moves, and the payload has the places and velocities of its nodes.
    MOVES = 2,
    /// Flag of a step: there are grains, and the payload has point terms and voidage.
    IMMERSED = 4,
    /// Flag of a step with grains: solid volume comes in, and the payload has the nodal source of the equation of mass
    /// behind the voidage.
    APPEARS = 8,
    /// Flag of a mesh: it has periodic sides, and the payload has the lengths of the period and the master of every
    /// node behind the cells of the facets.
    JOINED = 16,
}

/// An enumeration of kinds, and the list of them, from which `voidage.h` is written.
macro_rules! kinds {
    (
        $(#[$outer:meta])*
        pub enum Kind { $($(#[doc = $about:literal])+ $name:ident = $number:literal,)+ }
    ) => {
        $(#[$outer])*
        pub enum Kind { $($(#[doc = $about])+ $name = $number,)+ }

        impl Kind {
            /// All kinds.
            pub const ALL: &[Kind] = &[$(Kind::$name),+];
            /// The same as a list.
            pub const LISTED: &[Listed] =
                &[$(Listed { name: stringify!($name), number: $number, about: concat!($($about),+) }),+];
        }
    };
}

kinds! {
    /// What a frame is. The grains ask, the fluid answers each question with one frame.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[repr(u32)]
    pub enum Kind {
        /// The fluid presents itself; the grains answer with all that does not change: text.
        Hello = 1,
        /// Mesh and accepted fields; answered by a frame of the same kind without content.
        Mesh = 2,
        /// Accepted fields on the mesh there is; answered likewise.
        State = 3,
        /// Point terms and voidage for one solution from the accepted state; the text has the conditions if they
        /// changed.
        Step = 4,
        /// Answer to a step: nodal fields, what passed the boundary, and a report.
        Solution = 5,
        /// The fluid is alive and not done.
        Heartbeat = 7,
        /// The fluid could not do what was asked: text.
        Error = 8,
        /// The grains are done.
        Bye = 9,
    }
}

/// A field of the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: &'static str,
    /// Its type in Rust.
    pub number: &'static str,
    /// Where it starts, bytes.
    pub offset: usize,
    /// What it says.
    pub about: &'static str,
}

/// The structure of the header, and the list of its fields, from which `voidage.h` is written.
macro_rules! header {
    (
        $(#[$outer:meta])*
        pub struct Header { $($(#[doc = $about:literal])+ pub $name:ident: $number:ident,)+ }
    ) => {
        $(#[$outer])*
        pub struct Header { $($(#[doc = $about])+ pub $name: $number,)+ }

        impl Header {
            /// Its fields, in the order in which they lie.
            pub const FIELDS: &[Field] = &[$(Field {
                name: stringify!($name),
                number: stringify!($number),
                offset: offset_of!(Header, $name),
                about: concat!($($about),+),
            }),+];
        }
    };
}

header! {
    /// The header of a frame; the payload that follows is `length` numbers of 8 bytes.
    #[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
    #[repr(C)]
    pub struct Header {
        /// [`MAGIC`].
        pub magic: u64,
        /// [`VERSION`].
        pub version: u32,
        /// A [`Kind`].
        pub kind: u32,
        /// Number of the run; 0 before the grains have answered the hello.
        pub run: u64,
        /// Number of the mesh, from 1; 0 before the first.
        pub generation: u32,
        /// [`ACCEPT`], [`MOVES`], [`IMMERSED`], [`APPEARS`] and [`JOINED`], or 0.
        pub flags: u32,
        /// Number of the step since time zero; the first is 1.
        pub step: u64,
        /// How many solutions of this step went before.
        pub iteration: u32,
        /// Which scalars have columns, one bit each.
        pub scalars: u32,
        /// Time at the start of the step, s.
        pub time: f64,
        /// Length of the step; in an answer the wall time that the fluid took for it, s.
        pub dt: f64,
        /// Rows of the columns: points, or nodes of the mesh.
        pub rows: u64,
        /// Distance from column to column in numbers; at least `rows`.
        pub stride: u64,
        /// Cells of a mesh; else 0.
        pub cells: u64,
        /// Facets of the boundary of a mesh; else 0.
        pub facets: u64,
        /// Parts of the boundary whose balances a solution has; else 0.
        pub parts: u64,
        /// Nodes of which a step brings the voidage (with grains) or the motion (if the mesh moves); else 0.
        pub nodes: u64,
        /// Bytes of the text at the end of the payload.
        pub text: u64,
        /// Numbers in the payload.
        pub length: u64,
    }
}

/// Size of a header, bytes.
pub const HEADER_BYTES: usize = size_of::<Header>();

impl Default for Header {
    fn default() -> Self {
        Self {
            magic: MAGIC,
            version: VERSION,
            kind: 0,
            run: 0,
            generation: 0,
            flags: 0,
            step: 0,
            iteration: 0,
            scalars: 0,
            time: 0.0,
            dt: 0.0,
            rows: 0,
            stride: 0,
            cells: 0,
            facets: 0,
            parts: 0,
            nodes: 0,
            text: 0,
            length: 0,
        }
    }
}

impl Header {
    /// An otherwise empty header.
    pub fn new(kind: Kind) -> Self {
        Self { kind: kind as u32, ..Self::default() }
    }

    /// Magic, version and kind, checked.
    ///
    /// # Errors
    /// It is no header of this protocol.
    pub fn kind(&self) -> Result<Kind, PeerError> {
        let wrong = |what: String, help: &str| Err(PeerError::protocol(Notice::new(what, help)));
        if self.magic != MAGIC {
            return wrong(format!("a frame starts with {:#018x} and not with {MAGIC:#018x}", self.magic), "");
        }
        if self.version != VERSION {
            let theirs = self.version;
            return wrong(
                format!("a frame of protocol version {theirs}, this is version {VERSION}"),
                "install the same version of voidage on both sides",
            );
        }
        match Kind::ALL.iter().find(|kind| **kind as u32 == self.kind) {
            Some(kind) => Ok(*kind),
            None => wrong(format!("a frame of the unknown kind {}", self.kind), ""),
        }
    }

    /// Whether it is of this program, in another version of the protocol.
    pub fn is_of_another_version(&self) -> bool {
        self.magic == MAGIC && self.version != VERSION
    }

    /// Whether there are grains in this step.
    pub fn immerses(&self) -> bool {
        self.flags & IMMERSED != 0
    }

    /// Whether solid volume comes in in this step.
    pub fn appears(&self) -> bool {
        self.flags & APPEARS != 0
    }

    /// Whether the mesh moves in this step.
    pub fn moves(&self) -> bool {
        self.flags & MOVES != 0
    }

    /// Whether the last solution is accepted.
    pub fn accepts(&self) -> bool {
        self.flags & ACCEPT != 0
    }
}
