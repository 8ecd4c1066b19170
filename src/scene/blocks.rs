//! Large files, read block by block: what has been used need not stay in memory, and what a header promises need not
//! be asked for.

use crate::{Error, Result};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Large enough to occupy all threads, small enough to stay in their caches.
const BLOCK: usize = 4 << 20;

/// A file, and what has been read of it and not been used.
pub(super) struct Blocks {
    path: PathBuf,
    file: File,
    buffer: Vec<u8>,
    used: usize,
    /// Bytes of the file that have not been read, if it is one that has a length.
    unread: Option<u64>,
}

impl Blocks {
    /// # Errors
    /// [`Error::File`] if the file cannot be opened.
    pub(super) fn open(path: &Path) -> Result<Blocks> {
        let opened = File::open(path).and_then(|file| file.metadata().map(|metadata| (file, metadata)));
        let (file, metadata) = opened.map_err(|e| cannot_read(path, &e))?;
        let unread = metadata.is_file().then_some(metadata.len());
        Ok(Blocks { path: path.into(), file, buffer: Vec::new(), used: 0, unread })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// What has been read and not been used.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.buffer[self.used..]
    }

    pub(super) fn consume(&mut self, count: usize) {
        self.used += count;
    }

    /// Adds a block to [`Blocks::bytes`]. `false` at the end of the file.
    pub(super) fn more(&mut self) -> Result<bool> {
        self.buffer.drain(..self.used);
        self.used = 0;
        let read = (&mut self.file).take(BLOCK as u64).read_to_end(&mut self.buffer);
        let count = read.map_err(|e| cannot_read(&self.path, &e))?;
        self.unread = self.unread.map(|n| n.saturating_sub(count as u64));
        Ok(count > 0)
    }

    /// How many bytes can still come, those of [`Blocks::bytes`] included, if the file has a length.
    pub(super) fn left(&self) -> Option<u64> {
        Some(self.unread? + self.bytes().len() as u64)
    }

    /// An error that concerns the whole file.
    pub(super) fn error(&self, message: String) -> Error {
        Error::File { file: self.path.clone(), message }
    }
}

/// Why a mesh cannot be used at all.
pub(super) fn cannot_read(path: &Path, error: &std::io::Error) -> Error {
    Error::File { file: path.into(), message: format!("cannot read the mesh: {error}") }
}

/// Cuts text into pieces for threads to share, where a record ends: `end` is the first end at or after a
/// place.
pub(super) fn pieces(
    text: &[u8],
    end: impl Fn(&[u8], usize) -> Option<usize>,
) -> impl Iterator<Item = &[u8]> {
    const PIECE: usize = 1 << 16;
    let mut rest = text;
    std::iter::from_fn(move || {
        let found = if rest.len() > PIECE { end(rest, PIECE) } else { None };
        let (piece, after) = rest.split_at(found.unwrap_or(rest.len()));
        rest = after;
        (!piece.is_empty()).then_some(piece)
    })
}
