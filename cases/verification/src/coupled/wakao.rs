//! Heat transfer of the voidage functions against Wakao's correlation for packed beds (Fig. 2 of Henry et al.).

use crate::{Case, Finding, Outcome};
use voidage_campaign::Effort;
use voidage_campaign::plot::panels::{Curve, Panel};
use voidage_coupling::Result;
use voidage_coupling::closure::{HeatTransfer, Surroundings, VoidageFunction};

/// The case.
pub const CASE: Case = Case {
    name: "wakao",
    group: "coupled",
    title: "Nusselt number of the law of Henry et al. with each voidage function, against Wakao's in a packed bed of \
            air",
    source: "N. Wakao, S. Kaguei, T. Funazkri, Chem. Eng. Sci. 34, 325 (1979); extremes of the printed formulas for Pr \
             0.71, eps 0.45, 15 <= Re_s <= 8500",
    run,
};

const PRANDTL: f64 = 0.71;
const VOIDAGE: f64 = 0.45;

/// Voidage function, its name, and the least and largest Nu / Nu_Wakao - 1, worked out from the printed formulas in
/// Python with 1e5 values of Re_s, apart from this code.
const FUNCTIONS: [(VoidageFunction, &str, [f64; 2]); 5] = [
    (VoidageFunction::Henry, "henry", [-0.074898, 0.063267]),
    (VoidageFunction::HenryInterstitial, "henry-interstitial", [-0.008144, 0.191710]),
    (VoidageFunction::DiFelice, "di-felice", [-0.030096, 0.279782]),
    (VoidageFunction::Migflow, "migflow", [0.079427, 0.970939]),
    (VoidageFunction::None, "none", [-0.743566, -0.461124]),
];

/// Surroundings of a superficial Reynolds number.
fn around(reynolds: f64) -> Surroundings {
    let (diameter, density, viscosity) = (1e-3, 1.2, 2e-5);
    let slip = reynolds * viscosity / (density * diameter * VOIDAGE);
    Surroundings { slip, voidage: VOIDAGE, diameter, density, viscosity }
}

fn run(effort: Effort) -> Result<Outcome> {
    let count = effort.pick(2000, 100_000);
    let reynolds = |k: usize| 15.0 * (8500.0f64 / 15.0).powf(k as f64 / count as f64);
    let wakao = |re: f64| HeatTransfer::Wakao.nusselt(&around(re), PRANDTL, VoidageFunction::None);
    let mut outcome = Outcome::default();
    let mut panel = Panel::log_log("Heat transfer in a packed bed, \u{3b5} = 0.45", "Re\u{209b}", "Nu");
    let drawn = || (0..=60).map(|k| reynolds(k * count / 60));
    panel.curves.push(Curve::line("Wakao et al.", drawn().map(|re| (re, wakao(re))).collect()));
    for (function, name, expected) in FUNCTIONS {
        let henry = |re: f64| HeatTransfer::Henry.nusselt(&around(re), PRANDTL, function);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for off in (0..=count).map(reynolds).map(|re| henry(re) / wakao(re) - 1.0) {
            (low, high) = (low.min(off), high.max(off));
        }
        for (what, expected, measured) in [("least", expected[0], low), ("largest", expected[1], high)] {
            let what = format!("{what} Nu / Nu_Wakao - 1 with {name}");
            outcome.findings.push(Finding::absolute(what, "1", expected, measured, 2e-5));
        }
        panel.curves.push(Curve::measured(name, drawn().map(|re| (re, henry(re))).collect()));
    }
    outcome.panels.push(panel);
    Ok(outcome)
}
