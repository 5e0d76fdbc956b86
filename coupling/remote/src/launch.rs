//! Fluid solvers as processes: which command starts them, and what became of them.

use crate::protocol::Setup;
use crate::remote::RemoteFluid;
use crate::solver::{Backend, Solver, Transport};
use crate::token::{TOKEN_VARIABLE, Token, is_local};
use crate::transport::{self, Address};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};
use voidage_coupling::error::{Error, Notice, PeerError, Result};

/// The Python that Debian's dolfinx is for.
pub const SYSTEM_PYTHON: &str = "/usr/bin/python3";
/// How long a solver may take to end after the farewell, or after it has died.
const END: Duration = Duration::from_secs(2);
/// Lines of the log that an error shows.
const LAST_LINES: usize = 15;

/// The environment of Python that this process is in.
#[derive(Clone, Debug)]
pub struct Environment {
    /// The interpreter.
    pub python: PathBuf,
    /// The folder that has the package `voidage`.
    pub packages: PathBuf,
}

static ENVIRONMENT: OnceLock<Environment> = OnceLock::new();

impl Environment {
    /// Says that this process is an interpreter; the first word counts.
    pub fn is_here(self) {
        ENVIRONMENT.get_or_init(|| self);
    }
}

/// The command that starts this program once more.
///
/// # Errors
/// The system does not tell where this program is.
pub fn this_program() -> io::Result<Command> {
    match ENVIRONMENT.get() {
        Some(environment) => Ok(python(&environment.python, &run_module("voidage"))),
        None => std::env::current_exe().map(Command::new),
    }
}

/// Where solvers are started from.
#[derive(Clone, Debug)]
pub struct Host {
    /// The program `voidage`, which serves the Rust solver; `None` for [`this_program`].
    pub program: Option<PathBuf>,
    /// The file that gets the output of the solver.
    pub log: PathBuf,
    /// What a solver that is started by hand must greet with.
    pub token: Token,
}

impl Default for Host {
    /// This program, `solver.log` in the current folder, and the token of the environment.
    fn default() -> Self {
        Self { program: None, log: "solver.log".into(), token: Token::of_environment() }
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
        check_door(backend, host)?;
        let address: Address = address.parse().map_err(Error::input)?;
        let (channel, _) = transport::listen(&address, timeout, &host.token)?;
        return RemoteFluid::new(channel, None, name, (timeout, host.token.clone()), setup);
    }
    let token = Token::random();
    let address = match backend.transport.unwrap_or_default() {
        Transport::Shm => Address::unique(),
        Transport::Tcp => Address::any_port(),
    };
    let (channel, address) = transport::listen(&address, timeout, &token)?;
    let mut command = command(backend, host, &address)?;
    // Not as an argument: those are for all users of a machine to see.
    command.env(TOKEN_VARIABLE, token.word().unwrap_or_default());
    let process = Process::start(command, &host.log)?;
    RemoteFluid::new(channel, Some(process), name, (timeout, token), setup)
}

/// Checks that a run that waits for a solver from other machines asks for a token: the first to come would be the
/// solver.
///
/// # Errors
/// It does not.
pub fn check_door(backend: &Backend, host: &Host) -> Result<()> {
    let Solver::Attach(address) = &backend.solver else { return Ok(()) };
    match address.parse().map_err(Error::input)? {
        Address::Tcp(place) if host.token.word().is_none() && !is_local(&place) => {
            Err(Error::input(Notice::new(
                format!("{}: whoever reaches this port would be the fluid solver", backend.solver.name()),
                "give the run and the solver the same word with --token, or in VOIDAGE_TOKEN; or listen at 127.0.0.1",
            )))
        }
        _ => Ok(()),
    }
}

/// Checks that there is an `mpirun` for a solver on several ranks.
///
/// # Errors
/// There is none.
pub fn check_ranks(backend: &Backend) -> Result<()> {
    match backend.ranks() {
        0 | 1 => Ok(()),
        ranks => mpirun(&fenicsx_interpreter()).map(drop).map_err(|notice| lacking(ranks, notice)),
    }
}

/// The `mpirun` that starts ranks of an interpreter: the one beside it, which is of the same installation as its MPI,
/// else the first on the path.
///
/// # Errors
/// There is none.
pub fn mpirun(interpreter: &Path) -> std::result::Result<PathBuf, Notice> {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let beside = interpreter.parent().filter(|folder| !folder.as_os_str().is_empty()).map(Path::to_path_buf);
    let mut places =
        beside.into_iter().chain(std::env::split_paths(&folders)).map(|folder| folder.join("mpirun"));
    places.find(|file| file.is_file()).ok_or_else(|| {
        let what = format!("there is no mpirun beside {} or on PATH", interpreter.display());
        Notice::new(what, "apt-get install openmpi-bin, or the mpirun of that Python's MPI; or give 1 rank")
    })
}

fn lacking(ranks: usize, Notice { what, help }: Notice) -> Error {
    Error::input(Notice::new(format!("{ranks} ranks of fenicsx: {what}"), help))
}

/// A command of an interpreter, on several ranks.
fn on_ranks(ranks: usize, interpreter: &Path, one: &Command) -> Result<Command> {
    let mut command = Command::new(mpirun(interpreter).map_err(|notice| lacking(ranks, notice))?);
    command.args(["-n", &ranks.to_string()]).arg(one.get_program()).args(one.get_args());
    for (name, value) in one.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    // Open MPI, 4 and 5, refuses root and more ranks than cores if nobody says that they are meant. Others do not know
    // these variables.
    command.envs(["OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"].map(|name| (name, "1")));
    command.env("OMPI_MCA_rmaps_base_oversubscribe", "1");
    command.env("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe");
    command.arg("--ranks").arg(ranks.to_string());
    Ok(command)
}

/// The command that starts a solver.
fn command(backend: &Backend, host: &Host, address: &Address) -> Result<Command> {
    let solver = &backend.solver;
    let mut command = match solver {
        Solver::Fenicsx => {
            let interpreter = fenicsx_interpreter();
            let one = python(&interpreter, &run_module("voidage.fenicsx"));
            match backend.ranks() {
                0 | 1 => one,
                ranks => on_ranks(ranks, &interpreter, &one)?,
            }
        }
        Solver::ScikitFem => python(&interpreter(), &run_module("voidage.scikit_fem")),
        Solver::Python(module) => {
            let mut command = python(&interpreter(), &run_module("voidage.adapter"));
            // Which of the two it needs is known when it is imported.
            command.args([module, "--or-python", SYSTEM_PYTHON]);
            command
        }
        Solver::Rust | Solver::Serve | Solver::Attach(_) => {
            let mut command = match &host.program {
                Some(program) => Command::new(program),
                None => this_program().map_err(|error| {
                    Error::run(format!("cannot start the fluid solver {}: {error}", solver.name()))
                })?,
            };
            command.arg("serve");
            command
        }
    };
    command.args(["--connect", &address.to_string()]);
    command.env("RAYON_NUM_THREADS", rayon::current_num_threads().to_string());
    Ok(command)
}

/// The statement that runs a module as `python -m` does.
pub fn run_module(module: &str) -> String {
    format!("import runpy; runpy.run_module('{module}', run_name='__main__', alter_sys=True)")
}

/// An interpreter that finds the package `voidage` and executes a statement; arguments may follow.
pub fn python(interpreter: &Path, statement: &str) -> Command {
    let mut command = Command::new(interpreter);
    command.arg("-c");
    match ENVIRONMENT.get() {
        // Behind all others: another interpreter has packages of its own (Debian's numpy is the one that its dolfinx
        // fits).
        Some(environment) => {
            command.arg(format!("import sys; sys.path.append({:?}); {statement}", environment.packages))
        }
        None => command.arg(statement),
    };
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

/// The Python of solvers that need no dolfinx, and of files until they turn out to need it: `$VOIDAGE_PYTHON`, that of the environment which has this program,
/// `target/venv/bin/python` above this folder or the program (`tests/python-setup` makes it), or `python3`.
pub fn interpreter() -> PathBuf {
    match (std::env::var_os("VOIDAGE_PYTHON"), ENVIRONMENT.get()) {
        (Some(python), _) => python.into(),
        (None, Some(environment)) => environment.python.clone(),
        (None, None) => above("target/venv/bin/python").unwrap_or("python3".into()),
    }
}

/// The Python of solvers that need dolfinx: [`interpreter`] where it has dolfinx, else that of the system.
pub fn fenicsx_interpreter() -> PathBuf {
    let own = interpreter();
    let find = "import importlib.util, sys; sys.exit(importlib.util.find_spec('dolfinx') is None)";
    let mut probe = Command::new(&own);
    probe.args(["-c", find]).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    match probe.status().is_ok_and(|status| status.success()) {
        true => own,
        false => SYSTEM_PYTHON.into(),
    }
}

/// The folder of the Python package `voidage`: `$VOIDAGE_PYTHONPATH`, or `coupling/python` above this folder or the
/// program; `None` if the interpreter must find it itself, or the program is part of it.
fn package() -> Option<PathBuf> {
    if let Some(folder) = std::env::var_os("VOIDAGE_PYTHONPATH") {
        return Some(folder.into());
    }
    if ENVIRONMENT.get().is_some() {
        return None;
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
