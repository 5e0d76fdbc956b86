//! The quick forms of `voidage verify` and `voidage validate`.

use voidage_tests::{solve_quickly, verify_quickly};

#[test]
fn the_fluid_alone() {
    verify_quickly("fluid");
}

#[test]
fn grains_in_a_fluid() {
    verify_quickly("coupled");
}

/// The quick forms of the other two experiments miss what was measured, as the page of validation says.
#[test]
fn a_measured_experiment() {
    let dense = voidage_validation::CASES.iter().filter(|case| case.name == "collapse-dense");
    solve_quickly(&dense.copied().collect::<Vec<_>>());
}
