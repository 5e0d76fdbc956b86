//! What a fluid solver that comes over the network must know to be the one of a run.

use crate::protocol::Greeting;
use std::fmt;
use std::net::ToSocketAddrs;

/// The environment variable that has the token of a run, for solvers and for runs that one attaches to.
pub const TOKEN_VARIABLE: &str = "VOIDAGE_TOKEN";

/// A word that the run and its fluid solver share; without one any solver is welcome.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct Token(Option<String>);

impl Token {
    /// A word that nobody guesses.
    pub fn random() -> Self {
        Self(Some(format!("{:032x}", rand::random::<u128>())))
    }

    /// The word; `None` if there is none, or an empty one.
    pub fn new(word: Option<String>) -> Self {
        Self(word.filter(|word| !word.is_empty()))
    }

    /// That of the environment.
    pub fn of_environment() -> Self {
        Self::new(std::env::var(TOKEN_VARIABLE).ok())
    }

    /// The word.
    pub fn word(&self) -> Option<&str> {
        self.0.as_deref()
    }

    /// Whether a solver that greets like this is welcome.
    pub fn admits(&self, greeting: &Greeting) -> bool {
        // Hashes are compared in constant time: how long it takes says nothing about the word.
        let hash = |word: &str| blake3::hash(word.as_bytes());
        match (&self.0, &greeting.token) {
            (None, _) => true,
            (Some(_), None) => false,
            (Some(ours), Some(theirs)) => hash(ours) == hash(theirs),
        }
    }
}

/// Not the word itself: this goes into messages.
impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "a token" } else { "no token" })
    }
}

/// Whether only processes of this machine reach a place `HOST:PORT`.
pub fn is_local(place: &str) -> bool {
    place.to_socket_addrs().is_ok_and(|mut addresses| addresses.all(|address| address.ip().is_loopback()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn greeting(token: &Token) -> Greeting {
        Greeting::new("a test", token)
    }

    #[test]
    fn whoever_came_first_was_the_solver() {
        let token = Token::random();
        assert_ne!(token, Token::random());
        assert!(token.admits(&greeting(&token)));
        for other in [Token::default(), Token::random(), Token::new(Some("0".into()))] {
            assert!(!token.admits(&greeting(&other)), "{:?}", other.word());
            assert!(Token::default().admits(&greeting(&other)));
        }
        assert_eq!(Token::new(Some(String::new())).word(), None);
        assert!(!format!("{token:?}").contains(token.word().unwrap_or_default()));
    }

    #[test]
    fn addresses_of_all_the_world_passed_for_those_of_this_machine() {
        for (place, local) in [
            ("127.0.0.1:80", true),
            ("[::1]:80", true),
            ("localhost:80", true),
            ("0.0.0.0:80", false),
            ("[::]:80", false),
            ("192.0.2.1:80", false),
        ] {
            assert_eq!(is_local(place), local, "{place}");
        }
    }
}
