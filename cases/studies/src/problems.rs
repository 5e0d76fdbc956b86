//! Problems with a known answer that are no scenes: they know their own errors.

use super::cost;
use super::plan::{Settings, THREADS};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::time::Instant;
use voidage_campaign::clock::{Cost, Spent, median, timed};
use voidage_coupling::scheme::{Options, SchemeName};
use voidage_coupling::{Error, Notice, Result};
use voidage_dem::{Acceleration, Load, Settings as Contacts};
use voidage_remote::launch::{SYSTEM_PYTHON, fenicsx_interpreter, interpreter, python, run_module};
use voidage_scene::Solver;
use voidage_scene::document::{Document, Fault, fill};
use voidage_verification::fluid::manufactured::{Cut, Off, Run, UNIT};
use voidage_verification::fluid::orders::STILL;
use voidage_verification::grains::stack;
use voidage_verification::models::SlipBox;

/// The problems by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ProblemName {
    /// Steady flow with heat through a field of voidage that stands still, with a known solution.
    Manufactured,
    /// Slip between uniform grains and fluid in a closed box.
    SlipBox,
    /// Contact forces in a stack of discs at rest.
    Stack,
}

impl fmt::Display for ProblemName {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Manufactured => "manufactured",
            Self::SlipBox => "slip-box",
            Self::Stack => "stack",
        })
    }
}

/// What a problem gives: relative errors by name, and what it cost.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Solved {
    /// Relative errors.
    pub errors: BTreeMap<String, f64>,
    /// What it took.
    #[serde(flatten)]
    pub cost: Cost,
}

/// A problem with its settings.
pub trait Problem {
    /// Names of the errors that it knows.
    fn errors(&self) -> &'static [&'static str];
    /// Whether the settings make sense.
    fn check(&self) -> Result<(), Fault>;
    /// Estimated cost.
    fn cost(&self) -> f64;
    /// Solves it.
    fn solve(&self) -> Result<Solved>;
}

/// A problem with the given settings, all but the threads.
///
/// # Errors
/// A key that the problem does not have, a value of the wrong kind.
pub fn build(name: ProblemName, settings: &Settings) -> Result<Box<dyn Problem>, Fault> {
    let own = settings.iter().filter(|(key, _)| *key != THREADS);
    let table = own.map(|(key, value)| (key.clone(), value.clone())).collect();
    Ok(match name {
        ProblemName::Manufactured => Box::new(fill::<Manufactured>(&table)?),
        ProblemName::SlipBox => Box::new(fill::<Slip>(&table)?),
        ProblemName::Stack => Box::new(fill::<Stack>(&table)?),
    })
}

/// A fault where a value is outside of its range.
fn outside(key: &str, value: impl fmt::Display, help: &str) -> Result<(), Fault> {
    let notice = Notice::new(format!("`{key} = {value}`: {help}"), help);
    Err(Fault { path: key.into(), notice, unknown: false })
}

/// Steady flow with heat through a still field of voidage, made a solution by sources (C1 of `tests/manufactured.py`).
/// Five long steps of two Newton iterations. Errors: `u`, `p`, `T` in L2, `grad u` and `grad T` in L2, each over its
/// norm. The Rust solver and the others have fields, sources, meshes and errors of their own (`voidage.manufactured` in
/// Python).
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Manufactured {
    /// Squares along each side of the mesh. 2 or more. Default 16.
    pub squares: usize,
    /// The fluid solver: `"rust"`, `"fenicsx"`, `"scikit-fem"` or `{python = "MODULE"}`. Default `"rust"`.
    pub solver: Solver,
}

impl Default for Manufactured {
    fn default() -> Self {
        Self { squares: 16, solver: Solver::Rust }
    }
}

/// Keys of problems are part of those of studies.
impl Document for Manufactured {
    const KEYS: &'static str = "voidage schema --study";
}

impl Problem for Manufactured {
    fn errors(&self) -> &'static [&'static str] {
        &["u", "grad u", "p", "T", "grad T"]
    }

    fn check(&self) -> Result<(), Fault> {
        match (&self.solver, self.squares) {
            (Solver::Serve | Solver::Attach(_), _) => {
                let help = "sources go to solvers in this process or in Python: rust, fenicsx, scikit-fem or \
                            {python = ..}";
                outside("solver", self.solver.name(), help)
            }
            (_, 0 | 1) => outside("squares", self.squares, "give 2 or more"),
            _ => Ok(()),
        }
    }

    fn cost(&self) -> f64 {
        (self.squares as f64).powf(2.4) * cost::of_solver(&self.solver)
    }

    fn solve(&self) -> Result<Solved> {
        let module = match &self.solver {
            Solver::Fenicsx => return elsewhere(&fenicsx_interpreter(), "voidage.fenicsx", self.squares),
            Solver::Python(module) => module.as_str(),
            Solver::ScikitFem => "voidage.scikit_fem",
            _ => return self.here(),
        };
        elsewhere(&interpreter(), module, self.squares)
    }
}

impl Manufactured {
    fn here(&self) -> Result<Solved> {
        let (fields, steps) = (STILL, 5);
        let run = Run {
            fields,
            fluid: UNIT,
            cut: Cut::Alternating,
            squares: self.squares,
            dt: 1e3,
            steps,
            lumped: false,
            bodies: None,
        };
        // What another solver loads or compiles at its first step is loaded here too.
        Run { squares: 2, ..run }.solve()?;
        let (flow, spent) = run.timed()?;
        let off = run.off(&flow, steps as f64 * run.dt);
        let norms = run.norms(&flow, steps as f64 * run.dt);
        let share = |error: fn(&Off) -> f64| error(&off) / error(&norms);
        let errors = [
            ("u", share(|off| off.velocity.l2)),
            ("grad u", share(|off| off.velocity.h1)),
            ("p", share(|off| off.pressure.l2)),
            ("T", share(|off| off.temperature.l2)),
            ("grad T", share(|off| off.temperature.h1)),
        ];
        let phases = [("mesh", spent.mesh), ("flow", spent.flow), ("energy", spent.heat)];
        Ok(Solved {
            errors: errors.map(|(name, error)| (name.to_owned(), error)).into(),
            cost: Cost {
                steps_s: spent.all,
                steps_cpu_s: spent.cpu,
                phases: phases.map(|(name, seconds)| (name.to_owned(), seconds)).into(),
                steps: steps as u64,
                fluid_solves: Some(steps as u64),
                ..Cost::default()
            },
        })
    }
}

/// The same by a solver in Python, in an interpreter of its own.
fn elsewhere(interpreter: &Path, module: &str, squares: usize) -> Result<Solved> {
    let squares = squares.to_string();
    let mut command = python(interpreter, &run_module("voidage.manufactured"));
    // Whether a file needs FEniCSx is known when it is imported.
    command.args([module, "--squares", &squares, "--or-python", SYSTEM_PYTHON]);
    let output = command.output().map_err(|error| {
        let help = "`voidage doctor` says what is missing";
        Error::run(Notice::new(format!("cannot start {}: {error}", interpreter.display()), help))
    })?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        let last = said.lines().last().unwrap_or("it says nothing");
        return Err(Error::run(format!("{module} ({}): {last}", output.status)));
    }
    serde_json::from_slice(&output.stdout)
        .map_err(|error| Error::run(format!("{module} gave no result: {error}")))
}

/// Grains and fluid turn against each other in a round box, without constraint; their slip decays exponentially. Error:
/// `slip`, at the end, over what is then left of it.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Slip {
    /// Time step over the relaxation time of the slip, 1/(A + B) dt. Above 0. Default 0.1.
    pub dt: f64,
    /// End, in relaxation times of the slip. At least one step. Default 1.
    pub end: f64,
    /// Coupling scheme. Default `"iterated"`.
    pub scheme: SchemeName,
}

impl Default for Slip {
    fn default() -> Self {
        Self { dt: 0.1, end: 1.0, scheme: SchemeName::default() }
    }
}

impl Document for Slip {
    const KEYS: &'static str = Manufactured::KEYS;
}

impl Problem for Slip {
    fn errors(&self) -> &'static [&'static str] {
        &["slip"]
    }

    fn check(&self) -> Result<(), Fault> {
        match (self.dt > 0.0, self.end >= self.dt) {
            (false, _) => outside("dt", self.dt, "give a number above 0"),
            (_, false) => outside("end", self.end, "the end is at least one step"),
            _ => self.scheme.require().map_err(|error| Fault {
                path: "scheme".into(),
                notice: error.notice(),
                unknown: false,
            }),
        }
    }

    fn cost(&self) -> f64 {
        self.end / self.dt
    }

    fn solve(&self) -> Result<Solved> {
        often(|| self.once())
    }
}

impl Slip {
    fn once(&self) -> Result<Solved> {
        let begun = Instant::now();
        let mut slip_box = SlipBox::new(self.scheme, &Options::default())?;
        let steps = (self.end / self.dt).round().max(1.0) as u64;
        let dt = self.dt / (slip_box.fluid_rate + slip_box.grain_rate);
        let before = slip_box.slip();
        let mut cost = Cost { setup_s: begun.elapsed().as_secs_f64(), steps, ..Cost::default() };
        let (mut solves, mut spent) = (0, Spent::default());
        for _ in 0..steps {
            let report = timed(&mut spent, || slip_box.system.step(dt))?;
            solves += report.agreement.map_or(1, |agreement| agreement.solves as u64);
            for (name, seconds) in report.phases.named() {
                *cost.phases.entry(name.to_owned()).or_default() += seconds;
            }
        }
        (cost.steps_s, cost.steps_cpu_s) = (spent.wall, spent.cpu);
        cost.fluid_solves = Some(solves);
        let exact = (-(steps as f64) * self.dt).exp();
        let error = (slip_box.slip() / before / exact - 1.0).abs();
        Ok(Solved { errors: [("slip".to_owned(), error)].into(), cost })
    }
}

/// A stack of discs from a cold start, one step. Error: `forces`, the 2-norm of the errors of all contact forces over
/// that of the forces. Contact k of N carries (N - k + 1) m g.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Stack {
    /// Discs. 2 or more. Default 100.
    pub count: usize,
    /// Share of the energy of the changes of the velocities which that of their error may have when the sweeps stop.
    /// Above
    /// 0. Default 1e-3.
    pub tolerance: f64,
    /// `"none"`, plain Gauss-Seidel, or `"momentum"`. Default `"momentum"`.
    #[schemars(with = "String")]
    pub acceleration: Acceleration,
}

impl Default for Stack {
    fn default() -> Self {
        Self {
            count: 100,
            tolerance: Contacts::<2>::default().tolerance,
            acceleration: Acceleration::Momentum,
        }
    }
}

impl Document for Stack {
    const KEYS: &'static str = Manufactured::KEYS;
}

impl Problem for Stack {
    fn errors(&self) -> &'static [&'static str] {
        &["forces"]
    }

    fn check(&self) -> Result<(), Fault> {
        match (self.count, self.tolerance > 0.0) {
            (0 | 1, _) => outside("count", self.count, "give 2 or more"),
            (_, false) => outside("tolerance", self.tolerance, "give a number above 0"),
            _ => Ok(()),
        }
    }

    fn cost(&self) -> f64 {
        let power = if self.acceleration == Acceleration::None { 3 } else { 2 };
        (self.count as f64).powi(power) * (1.0 - self.tolerance.clamp(1e-15, 0.5).log10())
    }

    fn solve(&self) -> Result<Solved> {
        let settings = Contacts {
            tolerance: self.tolerance,
            acceleration: self.acceleration,
            max_sweeps: 1_000_000,
            ..Contacts::default()
        };
        often(|| {
            let (mut dem, mut spent) = (stack::stack(self.count, settings.clone())?, Spent::default());
            let report = timed(&mut spent, || dem.step(1e-3, &Load::default()));
            Ok(Solved {
                errors: [("forces".to_owned(), stack::error_of(&dem))].into(),
                cost: Cost {
                    steps_s: spent.wall,
                    steps_cpu_s: spent.cpu,
                    phases: [("contacts".to_owned(), spent.wall)].into(),
                    steps: 1,
                    unconverged_steps: u64::from(!report.converged),
                    ..Cost::default()
                },
            })
        })
    }
}

/// Time, s, for which something short is done again and again: the median of many short times is known well.
const LONG_ENOUGH: f64 = 0.1;

/// The run whose processor time is the median of as many as fit into a tenth of a second.
fn often(once: impl Fn() -> Result<Solved>) -> Result<Solved> {
    let (begun, mut all) = (Instant::now(), Vec::new());
    while all.is_empty() || begun.elapsed().as_secs_f64() < LONG_ENOUGH {
        all.push(once()?);
    }
    let middle = median(&all.iter().map(|solved: &Solved| solved.cost.steps_cpu_s).collect::<Vec<f64>>());
    let away = |solved: &Solved| (solved.cost.steps_cpu_s - middle).abs();
    let nearest = all.into_iter().min_by(|a, b| away(a).total_cmp(&away(b)));
    nearest.ok_or_else(|| Error::run("nothing was run"))
}
