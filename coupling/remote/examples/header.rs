//! Writes `voidage.h`, the header for fluid solvers in C and C++: `cargo run -p voidage-remote --example header`.

use std::path::Path;

fn main() -> std::io::Result<()> {
    std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("voidage.h"), voidage_remote::c::header())
}
