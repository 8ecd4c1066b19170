//! `caustica info`.

use super::args::InfoArgs;
use super::console;
use super::prepare::{Prepared, prepare, with_threads};
use caustica::integrator::{self, Budget};
use caustica::shape::Shape;
use caustica::{Result, accel};
use std::fs;

pub(super) fn run(args: &InfoArgs) -> Result<()> {
    with_threads(&args.common, || match &args.scene {
        None => {
            print_program();
            Ok(())
        }
        Some(path) => prepare(path, &args.common, args.integrator.map(|i| i.kind())).map(|p| print_scene(&p)),
    })
}

fn print_program() {
    let backends: Vec<_> = accel::available().iter().map(|b| b.name()).collect();
    let backends = match &backends[..] {
        [] => "none (build with --features embree or --features bvh)".into(),
        [default, ..] => format!("{} (default: {default})", backends.join(", ")),
    };
    console::result(&format!(
        "caustica {}\nbackends: {backends}\ncpu: {}\ncpu features: {}\nthreads: {}",
        env!("CARGO_PKG_VERSION"),
        cpu(),
        cpu_features().join(", "),
        rayon::current_num_threads()
    ));
}

fn print_scene(prepared: &Prepared) {
    let scene = &prepared.scene;
    let geometry = &scene.geometry;
    let shapes = &geometry.shapes;
    let mut triangles = 0;
    let mut bytes = 0;
    for shape in shapes {
        if let Shape::Mesh(m) = shape {
            triangles += m.triangles.len();
            bytes += size_of_val(&m.triangles[..])
                + size_of_val(&m.positions[..])
                + size_of_val(&m.normals[..])
                + size_of_val(&m.uvs[..]);
        }
    }
    let size = |shape: &Shape| if let Shape::Mesh(m) = shape { m.triangles.len() } else { 0 };
    let of = |shapes: &[Shape]| shapes.iter().map(size).sum::<usize>();
    let groups: Vec<usize> = (0..geometry.groups.len() as u32).map(|g| of(geometry.group(g))).collect();
    let placed: usize = geometry.instances.iter().map(|i| groups[i.group as usize]).sum();
    let shown = of(geometry.world()) + placed;
    let (min, max) = (scene.bounds.min, scene.bounds.max);
    let (_, _, w, h) = scene.film.crop;
    console::result(&format!(
        "film: {w} x {h} pixels\nshapes: {}\ntriangles: {triangles}\ninstances: {}, with them {shown} triangles show\nmaterials: {}\nlights: {}\ntextures: {}\n\
         bounds: {} {} {} to {} {} {}\nmeshes: {:.1} MiB\npeak memory: {:.1} MiB\nbackend: {}\n\
         seconds: load {:.3}, build {:.3}",
        shapes.len(),
        geometry.instances.len(),
        scene.materials.len(),
        scene.lights.lights().len(),
        scene.textures.len(),
        min.x,
        min.y,
        min.z,
        max.x,
        max.y,
        max.z,
        mebibytes(bytes as u64),
        mebibytes(peak_rss_bytes()),
        prepared.backend.name(),
        prepared.seconds.0,
        prepared.seconds.1,
    ));
    let named = match prepared.named_integrator.as_str() {
        "" => "none".into(),
        name => format!("'{name}'"),
    };
    console::result(&format!("integrator in the file: {named}"));
    print_plan(prepared, console::result);
}

/// Tells what rendering the scene takes, line by line.
pub(super) fn print_plan(prepared: &Prepared, mut line: impl FnMut(&str)) {
    let options = &prepared.options;
    let budget = match options.budget {
        Budget::Passes(n) => format!("{n} passes"),
        Budget::Time(t) => format!("{:.1} s", t.as_secs_f64()),
        Budget::Error(e) => format!("until the relative error is {e}"),
    };
    line(&format!("plan: {}, {budget}", options.integrator.name()));
    for skipped in integrator::plan(&prepared.scene, options) {
        line(&format!("  no {}: {}", skipped.stage, skipped.reason));
    }
}

fn mebibytes(bytes: u64) -> f64 {
    bytes as f64 / (1 << 20) as f64
}

/// Largest amount of memory that the process has had resident; 0 where the system does not tell.
pub(super) fn peak_rss_bytes() -> u64 {
    let kib = field("/proc/self/status", "VmHWM").and_then(|v| v.split(' ').next()?.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}

/// The processor's name.
pub(super) fn cpu() -> String {
    field("/proc/cpuinfo", "model name").unwrap_or_else(|| std::env::consts::ARCH.into())
}

/// The operating system's name.
pub(super) fn os() -> String {
    let text = fs::read_to_string("/etc/os-release").unwrap_or_default();
    let name = text.lines().find_map(|l| l.strip_prefix("PRETTY_NAME="));
    name.map_or_else(|| std::env::consts::OS.into(), |name| name.trim_matches('"').into())
}

/// The value of `name: value` in a file of such lines.
fn field(file: &str, name: &str) -> Option<String> {
    let text = fs::read_to_string(file).ok()?;
    text.lines().find_map(|l| {
        let (key, value) = l.split_once(':')?;
        (key.trim() == name).then(|| value.trim().to_string())
    })
}

#[cfg(target_arch = "x86_64")]
pub(super) fn cpu_features() -> Vec<&'static str> {
    let features = [
        ("sse4.2", is_x86_feature_detected!("sse4.2")),
        ("avx", is_x86_feature_detected!("avx")),
        ("avx2", is_x86_feature_detected!("avx2")),
        ("fma", is_x86_feature_detected!("fma")),
        ("avx512f", is_x86_feature_detected!("avx512f")),
    ];
    features.into_iter().filter(|f| f.1).map(|f| f.0).collect()
}

#[cfg(not(target_arch = "x86_64"))]
pub(super) fn cpu_features() -> Vec<&'static str> {
    vec![std::env::consts::ARCH]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_known() {
        assert!(peak_rss_bytes() > 1 << 20);
        assert_eq!(field("/proc/self/status", "no such field"), None);
    }
}
