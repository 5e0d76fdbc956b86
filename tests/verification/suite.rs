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

#[test]
fn measured_experiments() {
    solve_quickly(voidage_validation::CASES);
}
