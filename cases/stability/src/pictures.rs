//! Pictures beyond the maps: the law of a bed at rest against the step, and fluidisation curves.

use super::bed::{GAS, LIQUID};
use super::fluidisation::LAW;
use super::record::{Place, Record};
use std::path::{Path, PathBuf};
use voidage_campaign::plot::panels::{self, Curve, Panel};
use voidage_coupling::Result;
use voidage_coupling::scheme::SchemeName;

/// Inflow over the fluidisation velocity in the picture of the law.
const INFLOW: f64 = 0.3;

/// Draws those pictures whose points are there.
pub fn draw(folder: &Path, record: &Record) -> Result<Vec<PathBuf>> {
    let mut drawn = vec![];
    let beds = [("bed-gas", "55 \u{b5}m grains in gas"), ("bed-liquid", "100 \u{b5}m grains in water")];
    let laws: Vec<Panel> =
        beds.iter().filter_map(|(axis, title)| law(axis, title, record.places())).collect();
    if !laws.is_empty() {
        drawn.extend(panels::pages(folder, "bed-law", &laws)?);
    }
    let mut curves = vec![];
    for scheme in [SchemeName::Iterated, SchemeName::HenryFree] {
        for (axis, density) in [
            ("fluidisation-gas", GAS.solid / GAS.fluid),
            ("fluidisation-liquid", LIQUID.solid / LIQUID.fluid),
        ] {
            let medium = if density > 100.0 { "gas" } else { "water" };
            curves.extend(fluidisation(axis, &format!("{scheme}, {medium}"), scheme, record.places()));
        }
    }
    if !curves.is_empty() {
        drawn.extend(panels::pages(folder, "fluidisation", &curves)?);
    }
    Ok(drawn)
}

/// Pressure drop over weight against the step at one inflow; the formula of `henry-free` for its kappa.
fn law(axis: &str, title: &str, places: &[Place]) -> Option<Panel> {
    let here = |place: &&Place| place.axis == axis && place.x == INFLOW;
    let of = |curve: &str, scheme: SchemeName| {
        let found = places.iter().filter(here).filter(|p| p.curve == curve && p.scheme == scheme);
        let mut points: Vec<(f64, f64)> = found.map(|place| (place.y, place.value)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let first = |curve: &str| places.iter().filter(here).find(|p| p.curve == curve).map(|p| p.value);
    let (drag, voidage) = (first("drag law / weight")?, first("voidage")?);
    let steps: Vec<f64> = (0..=140).map(|k| 10f64.powf(-3.0 + 0.05 * f64::from(k))).collect();
    let formula = |step: f64| {
        // kappa = beta dt/(eps^2 phi rho_p) is in proportion to the drag law, which on this mesh is not that of the
        // mean voidage.
        let kappa = step / (voidage * voidage) * drag / INFLOW;
        (drag + kappa) / (1.0 + kappa)
    };
    let mut panel = Panel::new(
        format!("{title}, inflow {INFLOW} of fluidisation"),
        "step / relaxation time of a grain",
        "pressure drop / weight of the bed",
    );
    panel.log[0] = true;
    panel.headroom = 0.35;
    panel.curves = vec![
        Curve::line("drag law", steps.iter().map(|step| (*step, drag)).collect()),
        Curve::dashes(
            "(D + \u{3ba} W) / (1 + \u{3ba})",
            steps.iter().map(|step| (*step, formula(*step))).collect(),
        ),
    ];
    // What does not end at a sensible drop is unstable: the map shows it, not this picture.
    for scheme in [SchemeName::Iterated, SchemeName::HenryFree, SchemeName::Henry, SchemeName::Lagged] {
        let points = of("pressure drop / weight", scheme);
        let points: Vec<_> = points.into_iter().filter(|(_, drop)| (-0.1..1.5).contains(drop)).collect();
        panel
            .curves
            .push(Curve::points(if points.is_empty() { String::new() } else { scheme.to_string() }, points));
    }
    Some(panel)
}

/// Pressure drop over weight against the inflow, up and down, a curve per step.
fn fluidisation(axis: &str, title: &str, scheme: SchemeName, places: &[Place]) -> Option<Panel> {
    let here: Vec<&Place> = places.iter().filter(|p| p.axis == axis && p.scheme == scheme).collect();
    let mut steps: Vec<f64> = here.iter().map(|place| place.y).collect();
    steps.sort_by(f64::total_cmp);
    steps.dedup();
    // The law of the first bed on its first way up, while it lies as it was packed; on in proportion to the inflow.
    let mut law = vec![(0.0, 0.0)];
    for place in here.iter().filter(|place| place.curve == LAW) {
        if place.at >= 1.0 || law.last().is_some_and(|&(before, _)| place.at <= before) {
            break;
        }
        law.push((place.at, place.value));
    }
    let &(at, value) = law.last().filter(|&&(at, _)| at > 0.0)?;
    let last = here.iter().fold(at / value, |most: f64, place| most.max(place.at));
    law.extend([(at / value, 1.0), (last, 1.0)]);
    let mut panel = Panel::new(title, "inflow / fluidisation velocity", "pressure drop / weight of the bed");
    panel.headroom = 0.35;
    panel.curves = vec![Curve::line("min(drag law, weight) of the bed as it lay", law)];
    for step in steps {
        let on = here.iter().filter(|place| place.y == step && place.curve != LAW);
        panel.curves.push(Curve::joined(format!("dt/\u{3c4} = {step}"), mean(on)));
    }
    Some(panel)
}

/// Means of places of the same curve at the same inflow: those of several beds, one after the other.
fn mean<'a>(places: impl Iterator<Item = &'a &'a Place>) -> Vec<(f64, f64)> {
    let mut found: Vec<(&Place, f64, f64)> = vec![];
    for place in places {
        match found.iter_mut().find(|(first, ..)| first.curve == place.curve && first.at == place.at) {
            Some((_, sum, count)) => (*sum, *count) = (*sum + place.value, *count + 1.0),
            None => found.push((place, place.value, 1.0)),
        }
    }
    found.into_iter().map(|(first, sum, count)| (first.at, sum / count)).collect()
}
