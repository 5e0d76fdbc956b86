//! Columns of the grains, the load and the fluid, by name.

use crate::arrays::{Column, finite_numbers, vectors};
use crate::scheme::System;
use crate::simulation::Simulation;
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use voidage_coupling::{Coupled, Fluid, Interaction, Mixture, Result, StepReport};
use voidage_dem::Dem;
use voidage_fluid::Vector;

/// Which columns a mapping shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// State of the grains.
    Grains,
    /// What the fluid solver gets.
    Load,
    /// What it gave back.
    AtGrains,
    /// Nodal fields.
    Fluid,
}

/// Whose columns they are.
pub enum Owner {
    /// A simulation between two steps.
    Simulation(Py<Simulation>),
    /// The system that a scheme advances.
    System(Py<System>),
}

/// Columns by name, a mapping from names to numpy arrays. Reading copies a column to a read-only array; assigning
/// checks shape and values and writes the whole column.
#[pyclass(frozen, mapping, module = "voidage")]
pub struct Columns {
    /// Whose they are.
    pub owner: Owner,
    /// Which ones.
    pub group: Group,
}

/// What columns are columns of.
pub enum Subject<'a> {
    /// A simulation between two steps.
    Coupled(&'a mut Coupled<2>),
    /// Grains in a fluid during a step.
    Mixture(&'a mut Mixture<2>),
}

impl Subject<'_> {
    fn grains(&self) -> Option<&Dem<2>> {
        match self {
            Self::Coupled(coupled) => coupled.grains(),
            Self::Mixture(mixture) => Some(&mixture.grains),
        }
    }

    fn grains_mut(&mut self) -> Option<&mut Dem<2>> {
        match self {
            Self::Coupled(coupled) => coupled.grains_mut(),
            Self::Mixture(mixture) => Some(&mut mixture.grains),
        }
    }

    fn fluid(&self) -> Option<&Fluid<2>> {
        match self {
            Self::Coupled(coupled) => coupled.fluid(),
            Self::Mixture(mixture) => Some(&mixture.fluid),
        }
    }

    fn mixture(&mut self) -> Option<&mut Mixture<2>> {
        match self {
            Self::Coupled(coupled) => coupled.mixture_mut(),
            Self::Mixture(mixture) => Some(mixture),
        }
    }

    fn interaction(&self) -> Option<&Interaction<2>> {
        match self {
            Self::Coupled(coupled) => coupled.interaction(),
            Self::Mixture(mixture) => Some(&mixture.interaction),
        }
    }
}

/// A column that can be written.
enum Target<'a> {
    Scalars(&'a mut [f64]),
    Vectors(&'a mut [Vector<2>]),
}

impl Group {
    fn names(self) -> &'static [&'static str] {
        match self {
            Group::Grains => &[
                "position",
                "velocity",
                "radius",
                "mass",
                "volume",
                "spin",
                "temperature",
                "heat_capacity",
                "contact_force",
                "contact_heat",
                "force",
                "heat",
                "voidage",
            ],
            Group::Load => &[
                "volume",
                "drag",
                "known",
                "mobility",
                "velocity",
                "heat_coefficient",
                "heat_mobility",
                "temperature",
                "continuity_mobility",
                "continuity_velocity",
            ],
            Group::AtGrains => &["velocity", "pressure_gradient", "temperature"],
            Group::Fluid => &["velocity", "pressure", "voidage"],
        }
    }

    /// The names of the columns that are there.
    fn there(self, subject: &mut Subject<'_>) -> Result<Vec<String>> {
        let mut there = Vec::new();
        for name in self.names() {
            if self.read(subject, name)?.is_some() {
                there.push((*name).to_owned());
            }
        }
        if self == Group::Fluid {
            there.extend(subject.fluid().into_iter().flat_map(|fluid| fluid.scalars.clone()));
        }
        Ok(there)
    }

    fn read(self, subject: &mut Subject<'_>, name: &str) -> Result<Option<Column>> {
        match self {
            Group::Grains => Ok(grains(subject, name)),
            Group::Load => Ok(load(subject, name)),
            Group::AtGrains => Ok(at_grains(subject, name)),
            Group::Fluid => fluid(subject, name),
        }
    }

    fn target<'a>(self, subject: &'a mut Subject<'_>, name: &str) -> Option<Target<'a>> {
        match self {
            Group::Grains => {
                let particles = &mut subject.grains_mut()?.particles;
                match name {
                    "position" => Some(Target::Vectors(&mut particles.position)),
                    "velocity" => Some(Target::Vectors(&mut particles.velocity)),
                    "spin" => Some(Target::Scalars(&mut particles.rotation.as_mut()?.spin)),
                    "temperature" => Some(Target::Scalars(&mut particles.heat.as_mut()?.temperature)),
                    _ => None,
                }
            }
            Group::Load => {
                let load = &mut subject.mixture()?.interaction.load;
                match name {
                    "drag" => Some(Target::Scalars(&mut load.drag)),
                    "mobility" => Some(Target::Scalars(&mut load.mobility)),
                    "velocity" => Some(Target::Vectors(&mut load.velocity)),
                    "heat_coefficient" => Some(Target::Scalars(&mut load.heat.as_mut()?.coefficient)),
                    "heat_mobility" => Some(Target::Scalars(&mut load.heat.as_mut()?.mobility)),
                    "temperature" => Some(Target::Scalars(&mut load.heat.as_mut()?.temperature)),
                    "continuity_mobility" => Some(Target::Scalars(&mut load.continuity.as_mut()?.mobility)),
                    "continuity_velocity" => Some(Target::Vectors(&mut load.continuity.as_mut()?.velocity)),
                    _ => None,
                }
            }
            Group::AtGrains | Group::Fluid => None,
        }
    }
}

fn grains(subject: &Subject<'_>, name: &str) -> Option<Column> {
    let grains = subject.grains()?;
    let (particles, interaction) = (&grains.particles, subject.interaction());
    let (rotation, heat) = (particles.rotation.as_ref(), particles.heat.as_ref());
    Some(match name {
        "position" => particles.position.as_slice().into(),
        "velocity" => particles.velocity.as_slice().into(),
        "radius" => particles.radius.as_slice().into(),
        "mass" => particles.mass.as_slice().into(),
        "volume" => particles.volume.as_slice().into(),
        "spin" => rotation?.spin.as_slice().into(),
        "temperature" => heat?.temperature.as_slice().into(),
        "heat_capacity" => heat?.capacity.as_slice().into(),
        "contact_force" => grains.contact_force().into(),
        "contact_heat" => heat.map(|_| grains.contact_heat())?.into(),
        "force" => interaction?.force.as_slice().into(),
        "heat" => interaction.filter(|interaction| interaction.load.heat.is_some())?.heat.as_slice().into(),
        "voidage" => interaction?.voidage.as_slice().into(),
        _ => return None,
    })
}

fn load(subject: &Subject<'_>, name: &str) -> Option<Column> {
    let load = &subject.interaction()?.load;
    let heat = load.heat.as_ref();
    Some(match name {
        "volume" => load.volume.as_slice().into(),
        "drag" => load.drag.as_slice().into(),
        "known" if load.known.is_empty() => vec![Vector::<2>::zeros(); load.drag.len()].as_slice().into(),
        "known" => load.known.as_slice().into(),
        "mobility" => load.mobility.as_slice().into(),
        "velocity" => load.velocity.as_slice().into(),
        "heat_coefficient" => heat?.coefficient.as_slice().into(),
        "heat_mobility" => heat?.mobility.as_slice().into(),
        "temperature" => heat?.temperature.as_slice().into(),
        "continuity_mobility" => load.continuity.as_ref()?.mobility.as_slice().into(),
        "continuity_velocity" => load.continuity.as_ref()?.velocity.as_slice().into(),
        _ => return None,
    })
}

fn at_grains(subject: &Subject<'_>, name: &str) -> Option<Column> {
    let interaction = subject.interaction()?;
    let at = &interaction.at;
    Some(match name {
        "velocity" => at.velocity.as_slice().into(),
        "pressure_gradient" => at.pressure_gradient.as_slice().into(),
        "temperature" => {
            interaction.load.heat.as_ref()?;
            at.temperature.as_slice().into()
        }
        _ => return None,
    })
}

fn fluid(subject: &mut Subject<'_>, name: &str) -> Result<Option<Column>> {
    if name == "voidage" {
        // Where the grains are now, and not where they were in the last step.
        let Some(mixture) = subject.mixture() else { return Ok(None) };
        mixture.cut_grains(&mut StepReport::default())?;
        return Ok(Some(mixture.interaction.load.voidage.as_slice().into()));
    }
    let Some(fluid) = subject.fluid() else { return Ok(None) };
    Ok(match name {
        "velocity" => Some(fluid.accepted.velocity.as_slice().into()),
        "pressure" => Some(fluid.accepted.pressure.as_slice().into()),
        _ => {
            let number = fluid.scalars.iter().position(|scalar| scalar == name);
            number.map(|number| fluid.accepted.scalar(number).into())
        }
    })
}

impl Columns {
    fn with<R: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Subject<'_>) -> Result<R> + Send,
    ) -> PyResult<R> {
        match &self.owner {
            Owner::Simulation(simulation) => {
                Simulation::with(simulation.bind(py), |coupled| work(&mut Subject::Coupled(coupled)))
            }
            Owner::System(system) => {
                system.get().with(py, |held| work(&mut Subject::Mixture(&mut held.mixture)))
            }
        }
    }

    fn column(&self, py: Python<'_>, name: &str) -> PyResult<Option<Column>> {
        // A scalar of the fluid has a name of the user's.
        if self.group != Group::Fluid && !self.group.names().contains(&name) {
            return Ok(None);
        }
        self.with(py, |subject| self.group.read(subject, name))
    }

    fn missing(&self, py: Python<'_>, name: &str) -> PyErr {
        match self.keys(py) {
            Ok(names) => {
                PyKeyError::new_err(format!("no column `{name}` here; there are {}", names.join(", ")))
            }
            Err(error) => error,
        }
    }
}

#[pymethods]
impl Columns {
    /// Names of the columns that the scene has.
    fn keys(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |subject| self.group.there(subject))
    }

    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        self.column(py, name)?.ok_or_else(|| self.missing(py, name))?.into_array(py)
    }

    fn __setitem__(&self, py: Python<'_>, name: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let Some(old) = self.column(py, name)? else { return Err(self.missing(py, name)) };
        let rows = old.numbers.len() / old.width;
        let numbers = finite_numbers(value, name, Some(rows), old.width)?;
        let cold = numbers.iter().position(|kelvin| *kelvin < 0.0);
        if let (Group::Grains, "temperature", Some(row)) = (self.group, name, cold) {
            let kelvin = numbers[row];
            return Err(PyValueError::new_err(format!(
                "`{name}` is {kelvin} in row {row}, it must be 0 K or more"
            )));
        }
        let written = self.with(py, |subject| {
            let target = self.group.target(subject, name);
            Ok(target.map(|target| match target {
                Target::Scalars(to) => to.copy_from_slice(&numbers),
                Target::Vectors(to) => to.copy_from_slice(&vectors(&numbers)),
            }))
        })?;
        written.ok_or_else(|| PyValueError::new_err(format!("`{name}` can be read but not written")))
    }

    fn __contains__(&self, py: Python<'_>, name: &str) -> PyResult<bool> {
        Ok(self.column(py, name)?.is_some())
    }

    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.keys(py)?.len())
    }

    fn __iter__(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        Ok(self.keys(py)?.into_pyobject(py)?.try_iter()?.into_any().unbind())
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("<columns {}>", self.keys(py)?.join(", ")))
    }
}
