//! What a step reports, as a dictionary.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use voidage_coupling::StepReport;

/// The dictionary of a report; parts that the scene does not have are not there.
pub fn dictionary<'py>(py: Python<'py>, report: &StepReport) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    let phases = PyDict::new(py);
    for (name, seconds) in report.phases.named() {
        phases.set_item(name, seconds)?;
    }
    all.set_item("phases_s", phases)?;
    all.set_item("residual", report.residual())?;
    if let Some(grains) = &report.grains {
        all.set_item("grains", self::grains(py, grains)?)?;
    }
    if let Some(fluid) = &report.fluid {
        all.set_item("fluid", self::fluid(py, fluid)?)?;
    }
    if let Some(agreement) = &report.agreement {
        all.set_item("agreement", self::agreement(py, agreement)?)?;
    }
    let defects = [
        ("momentum_exchange_defect", report.momentum_exchange_defect),
        ("energy_exchange_defect", report.energy_exchange_defect),
        ("solid_volume_defect", report.solid_volume_defect),
        ("solid_volume_in", report.appeared),
    ];
    for (name, defect) in defects {
        if let Some(defect) = defect {
            all.set_item(name, defect)?;
        }
    }
    Ok(all)
}

fn grains<'py>(py: Python<'py>, report: &voidage_dem::StepReport) -> PyResult<Bound<'py, PyDict>> {
    let grains = PyDict::new(py);
    grains.set_item("contacts", report.contacts)?;
    grains.set_item("substeps", report.substeps)?;
    grains.set_item("sweeps", report.sweeps)?;
    grains.set_item("residual", report.residual)?;
    grains.set_item("converged", report.converged)?;
    grains.set_item("max_penetration_over_radius", report.max_penetration_over_radius)?;
    Ok(grains)
}

fn agreement<'py>(py: Python<'py>, report: &voidage_coupling::Agreement) -> PyResult<Bound<'py, PyDict>> {
    let agreement = PyDict::new(py);
    agreement.set_item("solutions", report.solves)?;
    agreement.set_item("parts", report.parts)?;
    agreement.set_item("converged", report.converged)?;
    agreement.set_item("disagreement", report.disagreement)?;
    agreement.set_item("heat_disagreement", report.heat_disagreement)?;
    agreement.set_item("carried", report.carried)?;
    agreement.set_item("worst", report.worst.iter().flatten().copied().collect::<Vec<_>>())?;
    Ok(agreement)
}

fn fluid<'py>(py: Python<'py>, report: &voidage_fluid::flow::Report) -> PyResult<Bound<'py, PyDict>> {
    let fluid = PyDict::new(py);
    fluid.set_item("flow_iterations", report.flow_iterations)?;
    fluid.set_item("scalar_iterations", report.scalar_iterations)?;
    fluid.set_item("residual", report.residual)?;
    fluid.set_item("flow_s", report.flow_s)?;
    fluid.set_item("scalars_s", report.scalars_s)?;
    Ok(fluid)
}
