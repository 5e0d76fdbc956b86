//! The table that says which program solves the equations of the fluid.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::str::FromStr;
use voidage_coupling::Notice;

/// Which program solves the equations of the fluid, and how it is reached.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Backend {
    /// The solver: `"rust"` in the process of the grains; in a process of its own `"serve"` (the same), `"fenicsx"`,
    /// `"scikit-fem"` or `{python = "MODULE"}`; or one that is started by hand, `{attach = "ADDRESS"}`. Default
    /// `"rust"`.
    pub solver: Solver,
    /// How data go to and from a process that the run starts. Default `"shm"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transport: Option<Transport>,
    /// Longest time without a sign of life from the process, s. Above 0. Default 60.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timeout: Option<f64>,
    /// Number of processes, started by `mpirun`, among which the solver `"fenicsx"` divides mesh and matrices. At least
    /// 1. Default 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ranks: Option<usize>,
}

/// Fluid solvers.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// The Rust solver in the process of the grains.
    #[default]
    Rust,
    /// The Rust solver in a process of its own.
    Serve,
    /// FEniCSx.
    Fenicsx,
    /// scikit-fem.
    ScikitFem,
    /// A Python module or file with a solver of your own.
    Python(String),
    /// A solver that is started by hand: `shm:NAME` or `tcp:HOST:PORT`.
    Attach(String),
}

/// Ways to another process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Transport {
    /// Shared memory.
    #[default]
    Shm,
    /// TCP on 127.0.0.1.
    Tcp,
}

impl Backend {
    /// Longest time without a sign of life, s.
    pub fn timeout(&self) -> f64 {
        self.timeout.unwrap_or(60.0)
    }

    /// Number of processes that share the solver.
    pub fn ranks(&self) -> usize {
        self.ranks.unwrap_or(1)
    }
}

impl Solver {
    /// The name, as `voidage run --fluid` has it.
    pub fn name(&self) -> String {
        match self {
            Solver::Rust => "rust".into(),
            Solver::Serve => "serve".into(),
            Solver::Fenicsx => "fenicsx".into(),
            Solver::ScikitFem => "scikit-fem".into(),
            Solver::Python(module) => format!("python:{module}"),
            Solver::Attach(address) => format!("attach:{address}"),
        }
    }

    /// The change of a scene that chooses this solver, `KEY=VALUE` as `--set` takes it.
    pub fn setting(&self) -> String {
        let value = match self {
            Solver::Python(module) => format!("{{python={module:?}}}"),
            Solver::Attach(address) => format!("{{attach={address:?}}}"),
            named => format!("{:?}", named.name()),
        };
        format!("fluid.backend.solver={value}")
    }
}

/// The solver of a [name](Solver::name); the error says which there are.
impl FromStr for Solver {
    type Err = Notice;

    fn from_str(name: &str) -> Result<Self, Notice> {
        match name.split_once(':') {
            Some(("python", module)) => Ok(Solver::Python(module.into())),
            Some(("attach", address)) => Ok(Solver::Attach(address.into())),
            _ => [Solver::Rust, Solver::Serve, Solver::Fenicsx, Solver::ScikitFem]
                .into_iter()
                .find(|solver| solver.name() == name)
                .ok_or_else(|| {
                    Notice::new(
                        format!("`{name}`: there is no such fluid solver"),
                        "use rust, serve, fenicsx, scikit-fem, python:MODULE or attach:ADDRESS",
                    )
                }),
        }
    }
}
