//! All that a bench has found, and its files.

use super::baseline::{self, Change};
use super::reference::Reference;
use super::results::{self, Curve, Row, slug};
use super::{page, plot};
use crate::cli::info;
use caustica::image_io::replace_file;
use caustica::{Error, Result};
use serde::Serialize;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;
use std::time::SystemTime;

/// A reference with more than this part of an error says little of it, though its own is taken off.
const NOISY: f64 = 0.2;

pub(super) struct Report {
    pub(super) info: RunInfo,
    pub(super) scenes: Vec<Scene>,
    pub(super) rows: Vec<Row>,
    /// Methods, by slug, that have pictures.
    pub(super) pictured: BTreeSet<String>,
    /// What did not run, and why.
    pub(super) notes: Vec<String>,
    /// What `then` was read from.
    pub(super) baseline: Option<String>,
    pub(super) then: Vec<Curve>,
}

pub(super) struct Scene {
    pub(super) name: String,
    pub(super) reference: Reference,
}

/// Where and how it ran; `run.json`.
#[derive(Serialize)]
pub(super) struct RunInfo {
    pub(super) version: &'static str,
    /// UTC, RFC 3339.
    pub(super) date: String,
    pub(super) command: String,
    pub(super) cpu: String,
    pub(super) cpu_features: Vec<&'static str>,
    pub(super) os: String,
    pub(super) threads: usize,
    pub(super) optimised: bool,
    pub(super) repeats: u32,
}

impl RunInfo {
    pub(super) fn new(repeats: u32) -> RunInfo {
        let command: Vec<_> = std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect();
        RunInfo {
            version: env!("CARGO_PKG_VERSION"),
            date: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            command: command.join(" "),
            cpu: info::cpu(),
            cpu_features: info::cpu_features(),
            os: info::os(),
            threads: rayon::current_num_threads(),
            optimised: !cfg!(debug_assertions),
            repeats,
        }
    }
}

impl Report {
    /// Which references are too far from converged to tell the best pictures apart.
    pub(super) fn noisy_references(&self) -> Vec<String> {
        let noisy = |Scene { name, reference }: &Scene| {
            let errors = self.rows.iter().filter(|row| row.scene == *name).map(|row| row.relmse);
            let least = errors.fold(f64::INFINITY, f64::min);
            let noisy = least.is_finite() && reference.relmse > NOISY * least;
            noisy.then(|| {
                format!(
                    "{name}: the reference is noisy: its own relmse, {:.1e}, is more than a fifth of the least one measured, {least:.1e}",
                    reference.relmse
                )
            })
        };
        self.scenes.iter().filter_map(noisy).collect()
    }

    /// What has become of the curves of the baseline.
    pub(super) fn changes(&self, curves: &[Curve]) -> Vec<Change> {
        baseline::compare(curves, &self.then)
    }

    /// Writes all files but pictures, and returns the curves.
    pub(super) fn write(&self, dir: &Path) -> Result<Vec<Curve>> {
        let curves = Curve::all(&self.rows);
        results::write(&dir.join("results.csv"), &self.rows)?;
        let json = serde_json::to_vec_pretty(&self.info).map_err(|e| Error::Runtime(e.to_string()))?;
        replace_file(&dir.join("run.json"), |w| w.write_all(&json))?;
        for scene in &self.scenes {
            let own: Vec<&Curve> = curves.iter().filter(|c| c.method.scene == scene.name).collect();
            let file = dir.join("plots").join(format!("{}.svg", slug(&scene.name)));
            plot::write(&file, &scene.name, &own, scene.reference.relmse)?;
        }
        let page = page::page(self, &curves, &self.changes(&curves));
        replace_file(&dir.join("index.html"), |w| w.write_all(page.as_bytes()))?;
        Ok(curves)
    }
}
