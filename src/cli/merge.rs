//! `caustica merge`.

use super::args::MergeArgs;
use super::checkpoint::passes;
use super::output::{Format, Origin, Run, Stats, write_image};
use caustica::part_file::{self, Header};
use caustica::{Error, Result, image_io};
use std::path::PathBuf;
use std::time::Instant;

pub(super) fn run(args: &MergeArgs, start: Instant) -> Result<()> {
    let format = Format::of(&args.output, &args.image)?;
    image_io::check_writable(&args.output)?;
    if let Some(stats) = &args.image.stats {
        image_io::check_writable(stats)?;
    }
    let mut parts = args
        .parts
        .iter()
        .map(|file| Ok((file, part_file::read_header(file)?)))
        .collect::<Result<Vec<_>>>()?;
    parts.sort_by_key(|(_, header)| (header.range().start, header.range().end));
    check(&parts, format)?;

    let mut sum = None;
    for (file, expected) in &parts {
        let (header, state) = part_file::read(file)?;
        if header.identity != expected.identity || header.range() != expected.range() {
            return Err(Error::Runtime(format!("'{}' changed while it was read; try again", file.display())));
        }
        args.verbosity.detail(&format!(
            "{}: {}",
            file.display(),
            passes(header.range().start..=header.range().end - 1)
        ));
        match &mut sum {
            None => sum = Some((header, state)),
            Some((_, sum)) => sum.merge(&state)?,
        }
    }
    let Some((Header { identity, scene, .. }, state)) = sum else {
        return Err(Error::Usage("there is nothing to merge; name part files".into()));
    };

    let rendering = state.resolve();
    let origin = Origin {
        scene,
        integrator: identity.integrator.clone(),
        backend: identity.backend.clone(),
        seed: identity.seed,
    };
    let earlier = state.statistics.seconds.rendering;
    let run = Run { start, seconds: (0.0, 0.0), earlier, interrupted: false };
    let stats = Stats::new(&origin, &run, &state, &rendering);
    match format {
        Format::Part => part_file::write(&args.output, &identity, &origin.scene, &state)?,
        _ => write_image(&args.output, format, args.image.exposure, rendering, &origin, stats.passes)?,
    }
    if let Some(path) = &args.image.stats {
        stats.write(path)?;
    }
    stats.report(&args.verbosity, &args.output);
    Ok(())
}

/// Whether the parts, sorted, belong together and follow each other, and begin with the first pass if they are to be
/// an image.
fn check(parts: &[(&PathBuf, Header)], format: Format) -> Result<()> {
    let fail = |file: &PathBuf, message| Err(Error::File { file: file.clone(), message });
    let first = &parts[0];
    for (file, header) in parts {
        if let Some(difference) = header.identity.difference(&first.1.identity) {
            let message = format!("does not belong to {}: it was rendered {difference}", first.0.display());
            return fail(file, message);
        }
    }
    if first.1.identity.version != env!("CARGO_PKG_VERSION") {
        let version = &first.1.identity.version;
        return fail(first.0, format!("was rendered by caustica {version}; merge it with that version"));
    }
    let missing = |file: &PathBuf, from: u32, to: u32| {
        fail(file, format!("begins with pass {to}, but {} missing", is_or_are(from, to - 1)))
    };
    let start = first.1.range().start;
    if format != Format::Part && start > 0 {
        return missing(first.0, 0, start);
    }
    for pair in parts.windows(2) {
        let [(before, a), (file, b)] = pair else { continue };
        let (a, b) = (a.range(), b.range());
        if a.end < b.start {
            return missing(file, a.end, b.start);
        }
        if b.start < a.end {
            let both = is_or_are(b.start, a.end.min(b.end) - 1);
            return fail(file, format!("{both} in {}, too; leave one of them out", before.display()));
        }
    }
    Ok(())
}

fn is_or_are(first: u32, last: u32) -> String {
    format!("{} {}", passes(first..=last), if first == last { "is" } else { "are" })
}
