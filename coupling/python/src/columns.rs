//! Columns of the grains, the load and the fluid, by name.

use crate::arrays::{Column, finite_numbers, vectors};
use crate::scheme::System;
use crate::simulation::Simulation;
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use voidage_coupling::{Coupled, Result, StepReport};
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
    fn there(self, coupled: &mut Coupled<2>) -> Result<Vec<String>> {
        let mut there = Vec::new();
        for name in self.names() {
            if self.read(coupled, name)?.is_some() {
                there.push((*name).to_owned());
            }
        }
        if self == Group::Fluid {
            there.extend(coupled.fluid.iter().flat_map(|fluid| fluid.scalars.clone()));
        }
        Ok(there)
    }

    fn read(self, coupled: &mut Coupled<2>, name: &str) -> Result<Option<Column>> {
        match self {
            Group::Grains => Ok(grains(coupled, name)),
            Group::Load => Ok(load(coupled, name)),
            Group::AtGrains => Ok(at_grains(coupled, name)),
            Group::Fluid => fluid(coupled, name),
        }
    }

    fn target<'a>(self, coupled: &'a mut Coupled<2>, name: &str) -> Option<Target<'a>> {
        match self {
            Group::Grains => {
                let particles = &mut coupled.grains.as_mut()?.particles;
                match name {
                    "position" => Some(Target::Vectors(&mut particles.position)),
                    "velocity" => Some(Target::Vectors(&mut particles.velocity)),
                    "spin" => Some(Target::Scalars(&mut particles.rotation.as_mut()?.spin)),
                    "temperature" => Some(Target::Scalars(&mut particles.heat.as_mut()?.temperature)),
                    _ => None,
                }
            }
            Group::Load => {
                let load = &mut coupled.interaction.as_mut()?.load;
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

fn grains(coupled: &Coupled<2>, name: &str) -> Option<Column> {
    let grains = coupled.grains.as_ref()?;
    let (particles, interaction) = (&grains.particles, coupled.interaction.as_ref());
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

fn load(coupled: &Coupled<2>, name: &str) -> Option<Column> {
    let load = &coupled.interaction.as_ref()?.load;
    let heat = load.heat.as_ref();
    Some(match name {
        "volume" => load.volume.as_slice().into(),
        "drag" => load.drag.as_slice().into(),
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

fn at_grains(coupled: &Coupled<2>, name: &str) -> Option<Column> {
    let interaction = coupled.interaction.as_ref()?;
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

fn fluid(coupled: &mut Coupled<2>, name: &str) -> Result<Option<Column>> {
    if name == "voidage" {
        // Where the grains are now, and not where they were in the last step.
        coupled.cut_grains(&mut StepReport::default())?;
        return Ok(coupled
            .interaction
            .as_ref()
            .map(|interaction| interaction.load.voidage.as_slice().into()));
    }
    let Some(fluid) = &coupled.fluid else { return Ok(None) };
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
        work: impl FnOnce(&mut Coupled<2>) -> Result<R> + Send,
    ) -> PyResult<R> {
        match &self.owner {
            Owner::Simulation(simulation) => Simulation::with(simulation.bind(py), work),
            Owner::System(system) => system.get().with(py, |held| work(&mut held.coupled)),
        }
    }

    fn column(&self, py: Python<'_>, name: &str) -> PyResult<Option<Column>> {
        // A scalar of the fluid has a name of the user's.
        if self.group != Group::Fluid && !self.group.names().contains(&name) {
            return Ok(None);
        }
        self.with(py, |coupled| self.group.read(coupled, name))
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
        self.with(py, |coupled| self.group.there(coupled))
    }

    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        self.column(py, name)?.ok_or_else(|| self.missing(py, name))?.into_array(py)
    }

    fn __setitem__(&self, py: Python<'_>, name: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let Some(old) = self.column(py, name)? else { return Err(self.missing(py, name)) };
        let rows = old.numbers.len() / old.width;
        let numbers = finite_numbers(value, name, Some(rows), old.width)?;
        let written = self.with(py, |coupled| {
            let target = self.group.target(coupled, name);
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
