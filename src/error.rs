//! The library's one error type. Messages say what was wrong and what to do.

use std::path::PathBuf;

/// Everything that can go wrong outside the hot paths.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene asks for something impossible or unknown; shown as `FILE:LINE: message`.
    #[error("{}:{line}: {message}", file.display())]
    Scene {
        /// The file that holds the mistake.
        file: PathBuf,
        /// Its line, from 1.
        line: u32,
        /// What was wrong, and what to do.
        message: String,
    },
    /// A file that cannot be used as a whole (missing, truncated, of another format).
    #[error("{}: {message}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// What was wrong, and what to do.
        message: String,
    },
    /// The request itself makes no sense (bad parameter, unavailable backend).
    #[error("{0}")]
    Usage(String),
    /// Something failed while running: the device, memory, writing the result.
    #[error("{0}")]
    Runtime(String),
}

impl Error {
    /// The process exit status that belongs to the error: 2 for a bad scene or request, 1 for a failed run.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Scene { .. } | Error::File { .. } | Error::Usage(_) => 2,
            Error::Runtime(_) => 1,
        }
    }
}

/// The library's result.
pub type Result<T, E = Error> = std::result::Result<T, E>;
