//! The program `voidage`.
fn main() {}
