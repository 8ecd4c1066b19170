//! The command line: arguments to calls into the library. Nothing else prints or exits.
//!
//! Exit status: 0 done, 1 failed while running, 2 bad command line or scene, 130 stopped by Ctrl-C or SIGTERM.

mod args;
mod bench;
mod checkpoint;
mod compare;
mod console;
mod info;
mod merge;
mod output;
mod photons;
mod prepare;
mod render;

use clap::Parser;
use clap::error::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::Instant;

const INTERRUPTED: u8 = 130;

/// Runs the program.
pub(crate) fn main() -> ExitCode {
    let start = Instant::now();
    let cli = match args::Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) => return ExitCode::from(refuse(&e)),
    };
    // A bug is told in one line like any other failure. (Damaged images may crash a decoder; the library turns that
    // into an error, and nothing must be printed about it.)
    static BUG: Mutex<String> = Mutex::new(String::new());
    std::panic::set_hook(Box::new(|info| {
        if let Ok(mut bug) = BUG.lock() {
            *bug = info.to_string();
        }
    }));
    let status = catch_unwind(AssertUnwindSafe(|| run(&cli.command, start))).unwrap_or_else(|_| {
        let bug = BUG.lock().map(|b| b.clone()).unwrap_or_default();
        Err(caustica::Error::Runtime(format!("internal error, please report it: {bug}")))
    });
    ExitCode::from(status.unwrap_or_else(|e| {
        console::error(&e.to_string());
        e.exit_code()
    }))
}

fn run(command: &args::Command, start: Instant) -> caustica::Result<u8> {
    match command {
        args::Command::Render(args) => render::run(args, start),
        args::Command::Merge(args) => merge::run(args, start).map(|()| 0),
        args::Command::Compare(args) => compare::run(args).map(|()| 0),
        args::Command::Bench(args) => bench::run(args).map(|()| 0),
        args::Command::Photons(args) => photons::run(args).map(|()| 0),
        args::Command::Info(args) => info::run(args).map(|()| 0),
    }
}

/// Prints what clap has to say: help as it is, errors in one line.
fn refuse(e: &clap::Error) -> u8 {
    use ErrorKind::{DisplayHelp, DisplayHelpOnMissingArgumentOrSubcommand, DisplayVersion};
    if matches!(e.kind(), DisplayHelp | DisplayVersion | DisplayHelpOnMissingArgumentOrSubcommand) {
        // Only a closed pipe can fail.
        let _ = e.print();
    } else {
        let text = e.render().to_string();
        let lines: Vec<&str> = text
            .lines()
            .map(str::trim)
            .take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more information"))
            .filter(|l| !l.is_empty())
            .collect();
        let message = lines.join(" ");
        let message = message.strip_prefix("error:").unwrap_or(&message).trim();
        console::error(&format!("{message}; see 'caustica --help'"));
    }
    e.exit_code() as u8
}
