//! Texts in a payload, and what the hellos say.

use super::columns::{Described, POINT_SCALAR, POINTS};
use super::{Header, Kind, VERSION};
use crate::token::Token;
use serde::{Deserialize, Serialize};
use voidage_coupling::backend::Model;
use voidage_coupling::error::PeerError;

/// Numbers of the payload that a text takes.
pub fn numbers_for_text(text: &str) -> usize {
    text.len().div_ceil(8)
}

/// Packs a text into the last numbers of a payload, eight bytes in each.
pub fn write_text(text: &str, payload: &mut [f64]) {
    let start = payload.len() - numbers_for_text(text);
    for (number, bytes) in payload[start..].iter_mut().zip(text.as_bytes().chunks(8)) {
        let mut eight = [0; 8];
        eight[..bytes.len()].copy_from_slice(bytes);
        *number = f64::from_le_bytes(eight);
    }
}

/// The text at the end of a payload; empty if there is none.
///
/// # Errors
/// It is longer than the payload, or no UTF-8.
pub fn read_text(header: &Header, payload: &[f64]) -> Result<String, PeerError> {
    let bytes = header.text as usize;
    let Some(start) = payload.len().checked_sub(bytes.div_ceil(8)) else {
        return Err(PeerError::protocol(format!("a text of {bytes} bytes in {} numbers", payload.len())));
    };
    let mut text: Vec<u8> = payload[start..].iter().flat_map(|number| number.to_le_bytes()).collect();
    text.truncate(bytes);
    String::from_utf8(text).map_err(|_| PeerError::protocol("a text that is no UTF-8"))
}

/// How the fluid presents itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Greeting {
    /// Name and version of the solver.
    pub solver: String,
    /// Version of the protocol.
    pub protocol: u32,
    /// The word of [`Token`], if the solver was given one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub token: Option<String>,
}

impl Greeting {
    /// Longest payload of a greeting, numbers.
    pub const LONGEST: usize = 512;

    /// The greeting of a solver of this name.
    pub fn new(solver: &str, token: &Token) -> Self {
        let token = token.word().map(str::to_owned);
        Self { solver: solver.to_owned(), protocol: VERSION, token }
    }

    /// The greeting that a frame brings.
    ///
    /// # Errors
    /// The frame is no hello, or its text is no greeting.
    pub fn read(header: &Header, payload: &[f64]) -> Result<Self, PeerError> {
        match header.kind()? {
            Kind::Hello => serde_json::from_str(&read_text(header, payload)?)
                .map_err(|error| PeerError::protocol(format!("the hello: {error}"))),
            other => Err(PeerError::protocol(format!("{other:?} instead of a hello"))),
        }
    }
}

/// The law of the velocity that a point will have, and of the scalars, in terms of the columns.
pub const CLOSURE: [&str; 2] = [
    "velocity + mobility * (drag * u - volume * grad(p)), \
     in the equation of mass flux_velocity + flux_mobility * (drag * u - volume * grad(p))",
    "value + mobility * coefficient * s",
];

/// What the grains tell once: all that does not change from step to step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup<const D: usize> {
    /// Version of the protocol.
    pub protocol: u32,
    /// Units of all numbers: `SI`.
    pub units: String,
    /// 2 or 3.
    pub dimension: usize,
    /// Columns of the points of a step, in the order in which they lie; the last three again for every scalar.
    pub columns: Vec<Described>,
    /// [`CLOSURE`].
    pub closure: [String; 2],
    /// Properties, scalars, numerics and conditions.
    #[serde(flatten)]
    pub model: Model<D>,
}

impl<const D: usize> Setup<D> {
    /// The setup of a fluid.
    pub fn new(model: Model<D>) -> Self {
        Self {
            protocol: VERSION,
            units: "SI".into(),
            dimension: D,
            columns: POINTS.iter().chain(&POINT_SCALAR).map(|column| column.described(D)).collect(),
            closure: CLOSURE.map(str::to_owned),
            model,
        }
    }

    /// The setup that a text describes.
    ///
    /// # Errors
    /// The text is no setup of this dimension.
    pub fn parse(text: &str) -> Result<Self, PeerError> {
        serde_json::from_str(text).map_err(|error| PeerError::protocol(format!("the hello: {error}")))
    }
}

/// The dimension that a setup is for, before it can be read as one.
///
/// # Errors
/// The text is no setup.
pub fn dimension(text: &str) -> Result<usize, PeerError> {
    #[derive(Deserialize)]
    struct Dimension {
        dimension: usize,
    }
    let parsed: serde_json::Result<Dimension> = serde_json::from_str(text);
    parsed.map(|setup| setup.dimension).map_err(|error| PeerError::protocol(format!("the hello: {error}")))
}
