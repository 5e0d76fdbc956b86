//! What the tests share.

use voidage_campaign::Effort;
use voidage_scene::Simulation;
use voidage_verification::{cases, solve};

/// Solves the quick form of all cases of a group of the verification suite.
///
/// # Panics
/// If a finding is outside of what is allowed.
pub fn verify_quickly(group: &str) {
    let mut missed = Vec::new();
    let chosen: Vec<_> = cases().into_iter().filter(|case| case.group == group).collect();
    assert!(!chosen.is_empty(), "there is no case in the group {group}");
    for case in chosen {
        let outcome = solve(&case, Effort::Quick);
        assert!(!outcome.findings.is_empty(), "{} finds nothing", case.name);
        let outside = outcome.findings.into_iter().filter(|finding| !finding.passes());
        missed.extend(outside.map(|finding| format!("{}: {finding:?}", case.name)));
    }
    assert!(missed.is_empty(), "{}", missed.join("\n"));
}

/// Grains and fields of a run with both and with heat, as bits.
///
/// # Panics
/// If one of them is missing.
pub fn bits(run: &mut Simulation) -> Vec<u64> {
    run.refresh().expect("fields");
    let view = run.view();
    let (grains, fluid) = (view.grains.expect("grains"), view.fluid.expect("fluid"));
    let vectors = grains.position.iter().chain(grains.velocity).chain(&fluid.fields.velocity);
    let scalars = grains.temperature.expect("heat").iter().chain(&fluid.fields.pressure);
    let all = vectors.flat_map(|v| [v.x, v.y]).chain(scalars.copied());
    all.map(f64::to_bits).collect()
}
