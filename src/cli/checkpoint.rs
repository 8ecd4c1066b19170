//! `--checkpoint` and `--resume` of `caustica render`.

use super::args::Verbosity;
use caustica::integrator::{Layout, State};
use caustica::part_file::{self, Identity};
use caustica::{Error, Result};
use std::ops::RangeInclusive;
use std::path::Path;
use std::time::{Duration, Instant};

/// Writes checkpoints while a render goes on.
pub(super) struct Checkpoint<'a> {
    pub(super) file: &'a Path,
    pub(super) interval: Duration,
    pub(super) identity: &'a Identity,
    pub(super) scene: &'a str,
    /// When the last one was written.
    pub(super) last: Instant,
}

impl Checkpoint<'_> {
    /// Writes one if it is time. Hours of work are not given up because a disk is full for a while: a failure is told,
    /// and the next one may succeed.
    pub(super) fn after_pass(&mut self, state: &State, verbosity: &Verbosity) {
        if self.last.elapsed() >= self.interval {
            if let Err(e) = self.write(state) {
                verbosity.note("warning: ", &format!("{e}; rendering goes on"));
            }
            self.last = Instant::now();
        }
    }

    pub(super) fn write(&self, state: &State) -> Result<()> {
        part_file::write(self.file, self.identity, self.scene, state)
    }
}

/// The render kept in `file`, if it is one of `identity` and `layout` that starts at pass `first` and holds at most
/// `total` passes.
pub(super) fn resume(
    file: &Path,
    identity: &Identity,
    layout: Layout,
    first: u32,
    total: Option<u32>,
) -> Result<State> {
    let fail = |message| Err(Error::File { file: file.into(), message });
    let (header, state) = part_file::read(file)?;
    if let Some(difference) = header.identity.difference(identity) {
        return fail(format!("cannot be resumed: it was rendered {difference}"));
    }
    // The identity settles the layout, but not of a file that was made to deceive.
    if state.layout() != layout {
        return fail("cannot be resumed: its sums are not laid out as those of this scene".into());
    }
    let range = header.range();
    if range.start != first {
        return fail(format!(
            "cannot be resumed: it starts with pass {}, not {first}; see --pass-range",
            range.start
        ));
    }
    match total {
        Some(total) if total < range.len() as u32 => fail(format!(
            "holds {} already, more than the {total} asked for; ask for more by --passes or --pass-range, or write \
             it as it is by 'caustica merge'",
            passes(range.start..=range.end - 1)
        )),
        _ => Ok(state),
    }
}

/// `pass 3` or `passes 3 to 5`.
pub(super) fn passes(range: RangeInclusive<u32>) -> String {
    let (first, last) = range.into_inner();
    if first == last { format!("pass {first}") } else { format!("passes {first} to {last}") }
}
