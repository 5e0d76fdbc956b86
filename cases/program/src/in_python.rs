//! The same program in an interpreter of Python, where schemes of one's own can be made.

use std::os::unix::process::CommandExt;
use std::process::Stdio;
use voidage_coupling::{Error, Notice};
use voidage_remote::launch::{interpreter, python, run_module};

/// Goes on in the Python package `voidage` with the same arguments; returns only where that cannot be.
pub fn start() -> Error {
    let interpreter = interpreter();
    let mut probe = python(&interpreter, "import voidage; print(voidage.__version__)");
    let answer = probe.stdin(Stdio::null()).output();
    let help = "the scheme runs in the Python package voidage: `pip install ./coupling/python` installs it, \
                `tests/python-setup` in a clone, and VOIDAGE_PYTHON names the interpreter that has it";
    let wrong = |what: String| Error::input(Notice::new(format!("{}: {what}", interpreter.display()), help));
    let version = env!("CARGO_PKG_VERSION");
    match answer {
        Err(error) => return wrong(error.to_string()),
        Ok(answer) if !answer.status.success() => {
            let words = String::from_utf8_lossy(&answer.stderr);
            return wrong(words.lines().last().unwrap_or("it has no package voidage").to_owned());
        }
        Ok(answer) if String::from_utf8_lossy(&answer.stdout).trim() != version => {
            let other = String::from_utf8_lossy(&answer.stdout).trim().to_owned();
            return wrong(format!(
                "it has version {other} of the package voidage, this program is {version}"
            ));
        }
        Ok(_) => {}
    }
    let mut command = python(&interpreter, &run_module("voidage"));
    wrong(command.args(std::env::args_os().skip(1)).exec().to_string())
}
