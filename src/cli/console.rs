//! Everything the program prints. Streams that are closed (`caustica info | head -1`) are no reason to fail.

use super::args::Verbosity;
use indicatif::ProgressDrawTarget;
use std::io::{Write, stderr, stdout};

/// Prints an error in one line.
pub(super) fn error(message: &str) {
    line_to_stderr("error: ", message);
}

/// Prints a result.
pub(super) fn result(text: &str) {
    let _ = writeln!(stdout(), "{text}");
}

fn line_to_stderr(kind: &str, message: &str) {
    let one_line: Vec<&str> = message.lines().map(str::trim).collect();
    let _ = writeln!(stderr(), "{kind}{}", one_line.join(" "));
}

impl Verbosity {
    /// Prints what the user should know about a run that goes on, unless `-q`.
    pub(super) fn note(&self, kind: &str, message: &str) {
        if !self.quiet {
            line_to_stderr(kind, message);
        }
    }

    /// Where a progress bar is drawn. (It draws nothing where stderr is no terminal.)
    pub(super) fn progress_target(&self) -> ProgressDrawTarget {
        if self.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() }
    }

    /// Prints what only `-v` asks for.
    pub(super) fn detail(&self, message: &str) {
        if self.verbose {
            line_to_stderr("", message);
        }
    }
}
