//! Fluid solvers as processes: which command starts them, and what became of them.

use crate::protocol::Setup;
use crate::remote::RemoteFluid;
use crate::solver::{Backend, Solver, Transport};
use crate::transport::{self, Address};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use voidage_coupling::error::{Error, Notice, PeerError, Result};

/// The Python that Debian's dolfinx is for.
pub const SYSTEM_PYTHON: &str = "/usr/bin/python3";
/// How long a solver may take to end after the farewell, or after it has died.
const END: Duration = Duration::from_secs(2);
/// Lines of the log that an error shows.
const LAST_LINES: usize = 15;

/// Where solvers are started from.
#[derive(Clone, Debug)]
pub struct Host {
    /// The program `voidage`, which serves the Rust solver.
    pub program: PathBuf,
    /// The file that gets the output of the solver.
    pub log: PathBuf,
}

impl Default for Host {
    /// The program that `PATH` finds, and `solver.log` in the current folder.
    fn default() -> Self {
        Self { program: "voidage".into(), log: "solver.log".into() }
    }
}

/// The solver that a scene asks for, started if need be and connected.
///
/// # Errors
/// It cannot be started, or does not come.
pub fn remote<const D: usize>(backend: &Backend, host: &Host, setup: &Setup<D>) -> Result<RemoteFluid<D>> {
    let timeout = Duration::try_from_secs_f64(backend.timeout()).unwrap_or(Duration::MAX);
    let name = backend.solver.name();
    if let Solver::Attach(address) = &backend.solver {
        let address: Address = address.parse().map_err(Error::input)?;
        let (channel, _) = transport::listen(&address, timeout)?;
        return RemoteFluid::new(channel, None, name, timeout, setup);
    }
    let address = match backend.transport.unwrap_or_default() {
        Transport::Shm => Address::unique(),
        Transport::Tcp => Address::any_port(),
    };
    let (channel, address) = transport::listen(&address, timeout)?;
    let process = Process::start(command(&backend.solver, host, &address), &host.log)?;
    RemoteFluid::new(channel, Some(process), name, timeout, setup)
}

/// The command that starts a solver.
fn command(solver: &Solver, host: &Host, address: &Address) -> Command {
    let mut command = match solver {
        Solver::Fenicsx => python(Path::new(SYSTEM_PYTHON), &["-m", "voidage.fenicsx"]),
        Solver::ScikitFem => python(&interpreter(), &["-m", "voidage.scikit_fem"]),
        Solver::Python(module) => python(&interpreter(), &["-m", "voidage.adapter", module]),
        Solver::Rust | Solver::Serve | Solver::Attach(_) => {
            let mut command = Command::new(&host.program);
            command.arg("serve");
            command
        }
    };
    command.args(["--connect", &address.to_string()]);
    command.env("RAYON_NUM_THREADS", rayon::current_num_threads().to_string());
    command
}

/// An interpreter that finds the package `voidage`, with arguments.
pub fn python(interpreter: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(interpreter);
    command.args(arguments);
    if let Some(folder) = package() {
        let mut path = folder.into_os_string();
        if let Some(others) = std::env::var_os("PYTHONPATH") {
            path.push(":");
            path.push(others);
        }
        command.env("PYTHONPATH", path);
    }
    // Threads of BLAS only get in the way of systems of this size.
    if std::env::var_os("OPENBLAS_NUM_THREADS").is_none() {
        command.env("OPENBLAS_NUM_THREADS", "1");
    }
    command.env("PYTHONUNBUFFERED", "1");
    command
}

/// The Python of solvers that need no dolfinx: `$VOIDAGE_PYTHON`, `target/venv/bin/python` above this folder or the
/// program (`tests/python-setup` makes it), or `python3`.
pub fn interpreter() -> PathBuf {
    match std::env::var_os("VOIDAGE_PYTHON") {
        Some(python) => python.into(),
        None => above("target/venv/bin/python").unwrap_or("python3".into()),
    }
}

/// The folder of the Python package `voidage`: `$VOIDAGE_PYTHONPATH`, or `coupling/python` above this folder or the
/// program; `None` if the interpreter must find it itself.
fn package() -> Option<PathBuf> {
    if let Some(folder) = std::env::var_os("VOIDAGE_PYTHONPATH") {
        return Some(folder.into());
    }
    // Without its compiled part, the sources would only hide a package that is installed.
    let compiled = above("coupling/python/voidage/_voidage.abi3.so")?;
    compiled.ancestors().nth(2).map(Path::to_path_buf)
}

/// A file in this folder, that of the program, or one above.
fn above(file: &str) -> Option<PathBuf> {
    let places = [std::env::current_dir().ok(), std::env::current_exe().ok()];
    let above = places.iter().flatten().flat_map(|place| place.ancestors());
    above.map(|folder| folder.join(file)).find(|path| path.exists())
}

/// A solver that was started here. It is ended with this value.
#[derive(Debug)]
pub struct Process {
    child: Child,
    log: PathBuf,
}

impl Process {
    /// Starts a command whose output goes to a log.
    ///
    /// # Errors
    /// The log cannot be written, the command is not there.
    pub fn start(mut command: Command, log: &Path) -> Result<Self> {
        if let Some(folder) = log.parent() {
            fs::create_dir_all(folder).map_err(|error| Error::file(folder, "make the folder", error))?;
        }
        let file = File::create(log).map_err(|error| Error::file(log, "write", error))?;
        let second = file.try_clone().map_err(|error| Error::file(log, "write", error))?;
        command.stdin(Stdio::null()).stdout(file).stderr(second);
        // Ctrl-C is for the run, which then says goodbye.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let child = command.spawn().map_err(|error| {
            Error::run(Notice::new(
                format!("cannot start the fluid solver {}: {error}", command.get_program().display()),
                "`voidage doctor` says what is missing",
            ))
        })?;
        Ok(Self { child, log: log.to_path_buf() })
    }

    /// Checks that it runs.
    ///
    /// # Errors
    /// It does not.
    pub fn look(&mut self) -> Result<(), PeerError> {
        match self.child.try_wait() {
            Ok(Some(_)) => Err(PeerError::Gone),
            _ => Ok(()),
        }
    }

    /// How it ended, if it did, and the last lines of its log.
    pub fn last_words(&mut self, error: &PeerError) -> String {
        let mut words = String::new();
        match error {
            PeerError::Gone => {
                words = self.wait(END / 4).map_or(words, |status| format!(" ({status})"));
            }
            // It would not hear a farewell.
            PeerError::Silent { .. } => self.kill(),
            _ => {}
        }
        let log = fs::read_to_string(&self.log).unwrap_or_default();
        let lines: Vec<&str> = log.lines().collect();
        if !lines.is_empty() {
            words.push_str(&format!("\nthe last lines of {}:", self.log.display()));
            let last = &lines[lines.len().saturating_sub(LAST_LINES)..];
            last.iter().for_each(|line| words.push_str(&format!("\n    {line}")));
        }
        words
    }

    fn kill(&mut self) {
        // Both only fail if it has ended after all.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    fn wait(&mut self, limit: Duration) -> Option<std::process::ExitStatus> {
        let start = Instant::now();
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) => return Some(status),
                _ if start.elapsed() >= limit => return None,
                _ => std::thread::sleep(Duration::from_millis(5)),
            }
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if self.wait(END).is_none() {
            self.kill();
        }
    }
}
