//! `voidage closures`: the drag laws against voidage and Reynolds number, as a table and as curves.

use clap::Args;
use serde::Serialize;
use std::path::{Path, PathBuf};
use voidage_campaign::plot::panels::{self, Curve, Panel};
use voidage_campaign::table::Table;
use voidage_coupling::closure::{Drag, Surroundings, VoidageFunction};
use voidage_coupling::{Error, Result};

/// Voidages of the curves over the Reynolds number.
const VOIDAGES: [f64; 3] = [0.4, 0.6, 0.9];
/// Reynolds numbers of the curves over the voidage.
const REYNOLDS: [f64; 3] = [0.1, 30.0, 1000.0];

/// Options of `voidage closures`.
#[derive(Args)]
pub struct Options {
    /// Folder of `closures.csv` and `closures.png`.
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
}

/// The drag of one law at one state.
#[derive(Clone, Debug, Serialize)]
struct Row {
    /// Name of the law, as in `coupling.drag`.
    law: String,
    /// Voidage.
    voidage: f64,
    /// Reynolds number of the superficial velocity.
    reynolds: f64,
    /// Drag on a grain over Stokes' of a sphere in the superficial velocity.
    normalised_drag: f64,
}

/// Writes table and picture; the number is the exit code.
pub fn closures(options: &Options) -> Result<u8> {
    let folder = &options.out;
    std::fs::create_dir_all(folder).map_err(|error| Error::file(folder, "make", error))?;
    let rows = rows()?;
    let table = folder.join("closures.csv");
    Table::create(&table)?.add(&rows)?;
    let picture = folder.join("closures.png");
    draw(&picture, &rows)?;
    println!("{}\n{}", table.display(), picture.display());
    Ok(0)
}

/// Fluid of unit properties that flows so fast past a grain of unit diameter.
fn surroundings(voidage: f64, reynolds: f64) -> Surroundings {
    Surroundings { slip: reynolds / voidage, voidage, diameter: 1.0, density: 1.0, viscosity: 1.0 }
}

/// All laws on both families of curves.
fn rows() -> Result<Vec<Row>> {
    let numbers = (0..=40).map(|k| 10f64.powf(-1.0 + 0.1 * f64::from(k)));
    let along = numbers.flat_map(|reynolds| VOIDAGES.map(|voidage| (voidage, reynolds)));
    let shares = (0..=60).map(|k| f64::from(40 + k) / 100.0);
    let across = shares.flat_map(|voidage| REYNOLDS.map(|reynolds| (voidage, reynolds)));
    let mut states: Vec<(f64, f64)> = along.chain(across).collect();
    states.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    states.dedup();
    let mut rows = Vec::new();
    for law in Drag::ALL {
        let name = name(law)?;
        rows.extend(states.iter().map(|&(voidage, reynolds)| Row {
            law: name.clone(),
            voidage,
            reynolds,
            normalised_drag: law.normalised(&surroundings(voidage, reynolds), VoidageFunction::default()),
        }));
    }
    Ok(rows)
}

/// Name of a law in a scene.
fn name(law: Drag) -> Result<String> {
    let value = serde_json::to_value(law).ok().and_then(|value| value.as_str().map(str::to_owned));
    value.ok_or_else(|| Error::run(format!("{law:?} has no name")))
}

/// One panel for each voidage, and one for each Reynolds number.
fn draw(path: &Path, rows: &[Row]) -> Result<()> {
    let mut names: Vec<&str> = rows.iter().map(|row| row.law.as_str()).collect();
    names.dedup();
    let curves = |panel: &mut Panel, point: &dyn Fn(&Row) -> Option<(f64, f64)>| {
        for name in &names {
            let points = rows.iter().filter(|row| row.law == *name).filter_map(point).collect();
            panel.curves.push(Curve::measured(*name, points));
        }
    };
    const DRAG: &str = "drag / Stokes' drag";
    let mut sheet = Vec::new();
    for voidage in VOIDAGES {
        let title = format!("voidage {voidage}");
        let mut panel = Panel::log_log(title, "superficial Reynolds number", DRAG);
        curves(&mut panel, &|row| (row.voidage == voidage).then_some((row.reynolds, row.normalised_drag)));
        sheet.push(panel);
    }
    for reynolds in REYNOLDS {
        let title = format!("superficial Reynolds number {reynolds}");
        let mut panel = Panel { log: [false, true], ..Panel::new(title, "voidage", DRAG) };
        curves(&mut panel, &|row| (row.reynolds == reynolds).then_some((row.voidage, row.normalised_drag)));
        sheet.push(panel);
    }
    panels::large(path, 3, &sheet)
}
