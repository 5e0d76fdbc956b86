//! The quick forms of `voidage verify`.

use voidage_tests::verify_quickly;

#[test]
fn the_fluid_alone() {
    verify_quickly("fluid");
}

#[test]
fn grains_in_a_fluid() {
    verify_quickly("coupled");
}
