//! Where grains and fluid meet.

use std::fmt;
use std::str::FromStr;

/// `shm:RUN` or `tcp:HOST:PORT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// Shared memory of this machine, by the name of the run: letters, digits, `-` and `_`.
    Shared(String),
    /// A port, `HOST:PORT`.
    Tcp(String),
}

impl Address {
    /// A new name in shared memory that no other run of this machine has.
    pub fn unique() -> Self {
        let since = std::time::UNIX_EPOCH.elapsed().map_or(0, |time| time.as_nanos());
        Address::Shared(format!("{:x}-{:x}", std::process::id(), since))
    }

    /// Any free port of this machine, for its own processes only.
    pub fn any_port() -> Self {
        Address::Tcp("127.0.0.1:0".into())
    }
}

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        match text.split_once(':') {
            Some(("shm", run)) if !run.is_empty() && run.len() <= 64 && run.chars().all(allowed) => {
                Ok(Address::Shared(run.into()))
            }
            Some(("tcp", place))
                if place
                    .rsplit_once(':')
                    .is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok()) =>
            {
                Ok(Address::Tcp(place.into()))
            }
            _ => Err(format!(
                "`{text}` is no address; give shm:NAME (letters, digits, - and _) or tcp:HOST:PORT"
            )),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Address::Shared(run) => write!(f, "shm:{run}"),
            Address::Tcp(place) => write!(f, "tcp:{place}"),
        }
    }
}
