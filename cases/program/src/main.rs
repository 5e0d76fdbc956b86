//! The program `voidage`: see the library beside it, which the Python package has too.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(voidage_program::main(std::env::args_os()))
}
