//! The command line of Caustica.

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
