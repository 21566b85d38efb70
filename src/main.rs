//! The `brickscope` binary: everything is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    brickscope::cli::main(std::env::args_os())
}
