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

/// Without the loose column, whose quick form takes minutes, because it needs small grains.
#[test]
fn measured_experiments() {
    let short = voidage_validation::CASES.iter().filter(|case| case.name != "collapse-loose");
    solve_quickly(&short.copied().collect::<Vec<_>>());
}
