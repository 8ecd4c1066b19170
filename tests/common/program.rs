//! The program, run in a directory of its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

/// A directory that is removed in the end. Test files add what they put into it.
pub(crate) struct Dir(tempfile::TempDir);

impl Dir {
    pub(crate) fn new() -> Dir {
        Dir(tempfile::tempdir().unwrap())
    }

    pub(crate) fn root(&self) -> &Path {
        self.0.path()
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.root().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        fs::write(self.path(name), text).unwrap();
    }

    pub(crate) fn command(&self, args: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_caustica"));
        command.current_dir(self.root()).args(args.split_whitespace()).stdin(Stdio::null());
        command
    }

    pub(crate) fn run(&self, args: &str) -> Output {
        self.command(args).output().unwrap()
    }

    #[track_caller]
    pub(crate) fn succeed(&self, args: &str) -> Output {
        let out = self.run(args);
        assert_eq!(out.status.code(), Some(0), "caustica {args}: {}", stderr(&out));
        out
    }

    /// The one line of an error, which must contain all of `words`.
    #[track_caller]
    pub(crate) fn fail(&self, args: &str, status: i32, words: &[&str]) -> String {
        let out = self.run(args);
        let text = stderr(&out);
        assert_eq!(out.status.code(), Some(status), "caustica {args}: {text}");
        assert_eq!(text.lines().count(), 1, "caustica {args} prints not one line but: {text}");
        assert!(text.starts_with("error: "), "{text}");
        for word in words {
            assert!(text.contains(word), "caustica {args}: no '{word}' in: {text}");
        }
        text
    }

    pub(crate) fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.root()).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    pub(crate) fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&fs::read(self.path(name)).unwrap()).unwrap()
    }
}

/// Sends a signal, by the shell: not every system has a program for it.
pub(crate) fn signal(child: &Child, name: &str) {
    let kill = format!("kill -{name} {}", child.id());
    assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
}

pub(crate) fn stdout(out: &Output) -> String {
    String::from_utf8(out.stdout.clone()).unwrap()
}

pub(crate) fn stderr(out: &Output) -> String {
    String::from_utf8(out.stderr.clone()).unwrap()
}
