//! Schemes of a user's own, by name: `python:FILE[:CLASS]`.
//!
//! The file is run by whoever can: the Python package `voidage` says that it does ([`Maker::is_here`]). A program without an
//! interpreter says how it gets one ([`start_where_schemes_are_made`]), before it has done anything else.

use super::{Options, Scheme};
use crate::{Error, Notice, Result};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};

/// What a scheme of one's own is called, with the path of its file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Own(&'static str);

/// What its name begins with.
pub const PYTHON: &str = "python:";

/// Names that were met. A program meets few, so that they may stay.
static NAMES: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());

impl Own {
    /// The scheme of this name, none if it is not one of one's own.
    pub fn named(name: &str) -> Option<Self> {
        let place = name.strip_prefix(PYTHON)?;
        if place.is_empty() {
            return None;
        }
        let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = names.get(name) {
            return Some(Self(known));
        }
        let kept: &'static str = Box::leak(name.to_owned().into_boxed_str());
        names.insert(kept);
        Some(Self(kept))
    }

    /// The name.
    pub fn name(self) -> &'static str {
        self.0
    }

    /// The file, and the class in it if one is named.
    pub fn place(self) -> (&'static str, Option<&'static str>) {
        let place = &self.0[PYTHON.len()..];
        match place.rsplit_once(':') {
            Some((file, class)) if !class.contains('/') && !class.is_empty() => (file, Some(class)),
            _ => (place, None),
        }
    }

    /// The same with a file that is beside `folder` where its path is relative.
    pub fn within(self, folder: &Path) -> Self {
        let (file, class) = self.place();
        let whole = folder.join(file);
        let class = class.map_or(String::new(), |class| format!(":{class}"));
        Self::named(&format!("{PYTHON}{}{class}", whole.display())).unwrap_or(self)
    }
}

/// Makes the schemes of names.
#[derive(Clone, Copy)]
pub struct Maker(pub fn(Own, &Options) -> Result<Box<dyn Scheme<2>>>);

static MAKER: OnceLock<Maker> = OnceLock::new();

/// Goes on in a process that can make schemes, with the same arguments; returns why that cannot be.
static START: OnceLock<fn() -> Error> = OnceLock::new();

impl Maker {
    /// Says that this process makes schemes of one's own; the first word counts.
    pub fn is_here(self) {
        MAKER.get_or_init(|| self);
    }
}

/// Says how this process starts again where schemes of one's own can be made; the first word counts.
pub fn start_where_schemes_are_made(start: fn() -> Error) {
    START.get_or_init(|| start);
}

/// Sees to it that a scheme can be made, before anything else is done: checks that its file is there, and goes on in
/// another process where this one cannot make it.
///
/// # Errors
/// There is no such file, or no process that makes schemes.
pub fn require(own: Own) -> Result<()> {
    let (file, _) = own.place();
    if !Path::new(file).is_file() {
        let what = format!("the scheme {}: there is no file {file}", own.name());
        return Err(Error::input(Notice::new(what, "give the path of a Python file: python:FILE[:CLASS]")));
    }
    match (MAKER.get(), START.get()) {
        (Some(_), _) => Ok(()),
        (None, Some(start)) => Err(start()),
        (None, None) => Err(nobody()),
    }
}

fn nobody() -> Error {
    Error::input(Notice::new(
        "a scheme in Python runs in the Python package of voidage, and this program has none",
        "install it: pip install ./coupling/python",
    ))
}

/// Makes the scheme.
pub(super) fn build<const D: usize>(own: Own, options: &Options) -> Result<Box<dyn Scheme<D>>> {
    let Maker(make) = MAKER.get().ok_or_else(nobody)?;
    let scheme: Box<dyn std::any::Any> = Box::new(make(own, options)?);
    let scheme = scheme.downcast::<Box<dyn Scheme<D>>>();
    scheme.map(|scheme| *scheme).map_err(|_| Error::input("schemes of one's own are for the plane"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_a_file_and_may_have_a_class() {
        let place = |name: &str| Own::named(name).map(Own::place);
        assert_eq!(place("python:aitken.py"), Some(("aitken.py", None)));
        assert_eq!(place("python:a/b.py:Mine"), Some(("a/b.py", Some("Mine"))));
        assert_eq!(place("python:C:/b.py"), Some(("C:/b.py", None)));
        assert_eq!((place("henry"), place("python:")), (None, None));
        let beside = Own::named("python:b.py:Mine").map(|own| own.within(Path::new("/a")));
        assert_eq!(beside, Own::named("python:/a/b.py:Mine"));
        let there = Own::named("python:/c.py").map(|own| own.within(Path::new("/a")));
        assert_eq!(there, Own::named("python:/c.py"));
    }
}
