//! Numbers that hold under stress: scenes at the edge of what f32 can say. Whatever happens, pixels are finite and not
//! negative, nothing hangs, memory stays bounded; and where a symmetry or a furnace tells the right answer, it is found.
//! Fixed seeds; confidence as in [`common::assert_mean`].

#[path = "../common/mod.rs"]
mod common;

mod degenerate;
mod invariance;
mod materials;
mod photons;

use caustica::integrator::{Budget, Kind, Options, Rendering};
use caustica::scene::Scene;
use common::{backends, mean, params, parse_sized, render_with};
use std::sync::mpsc;
use std::time::Duration;

/// The integrators, the last with photons alone. All with so few photons that a pass takes a few milliseconds.
const WAYS: [(Kind, &[&str]); 3] = [
    (Kind::Path, &[]),
    (Kind::Photonmap, &["global_photons=2000", "caustic_photons=2000"]),
    (Kind::Photonmap, &["global_photons=2000", "caustic_photons=2000", "final_gather=false", "direct=map"]),
];

/// Runs `work`, and fails if it takes minutes or the process has taken gigabytes.
fn watched<T: Send + 'static>(what: &str, work: impl FnOnce() -> T + Send + 'static) -> T {
    let (sender, receiver) = mpsc::channel();
    let worker = std::thread::spawn(move || sender.send(work()));
    match receiver.recv_timeout(Duration::from_secs(300)) {
        Ok(result) => {
            let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
            let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.split_whitespace().next());
            let peak: u64 = peak.map_or(0, |kb| kb.parse().unwrap());
            assert!(peak < 2 << 20, "{what}: {peak} kB of memory");
            result
        }
        Err(mpsc::RecvTimeoutError::Timeout) => panic!("{what}: still running after five minutes"),
        Err(mpsc::RecvTimeoutError::Disconnected) => match worker.join() {
            Err(panic) => std::panic::resume_unwind(panic),
            Ok(_) => unreachable!("the result was sent"),
        },
    }
}

/// Asserts that whatever a rendering shows is finite, and not negative but for normals.
#[track_caller]
fn assert_sane(rendering: &Rendering, what: &str) {
    let layers = rendering.layers.iter().map(|layer| (layer.name.as_str(), &layer.image));
    for (name, image) in layers.chain([("the picture", &rendering.image)]) {
        for (i, p) in image.pixels.iter().enumerate() {
            let good = p.is_finite() && (p.min_element() >= 0.0 || name == "normal");
            assert!(good, "{what}: pixel {i} of {name} is {p}");
        }
    }
}

/// A scene rendered by one integrator.
struct View {
    scene: Scene,
    kind: Kind,
    settings: Vec<String>,
    what: String,
}

impl View {
    fn render(&self, seed: u64, passes: u32) -> Rendering {
        let settings: Vec<&str> = self.settings.iter().map(String::as_str).collect();
        let params = params(&settings);
        let options =
            Options { integrator: self.kind, params, seed, budget: Budget::Passes(passes), aovs: true };
        let rendering = render_with(&self.scene, &options);
        assert_sane(&rendering, &self.what);
        rendering
    }

    /// The red mean of what the path tracer sees of the same scene.
    fn path_mean(&self, passes: u32) -> f64 {
        let (integrator, params) = (Kind::Path, params(&[]));
        let options = Options { integrator, params, seed: 77, budget: Budget::Passes(passes), aovs: false };
        mean(&render_with(&self.scene, &options).image).x as f64
    }

    /// The red mean of the picture, as each of 16 seeds has it.
    fn means(&self, passes: u32) -> Vec<f64> {
        (0..common::ESTIMATES).map(|seed| mean(&self.render(seed, passes).image).x as f64).collect()
    }
}

/// Runs `check` on the scene in the text for every backend and integrator, watched.
fn for_all(name: &str, body: &str, size: (u32, u32), check: impl Fn(&View) + Send + Sync + Clone + 'static) {
    let xml = format!(r#"<scene version="3.0.0">{body}</scene>"#);
    for backend in backends() {
        for (kind, settings) in WAYS {
            let what = format!(
                "{name}, {}, {kind:?}{}",
                backend.name(),
                if settings.len() > 2 { " map" } else { "" }
            );
            println!("{what}");
            let (xml, check) = (xml.clone(), check.clone());
            watched(&what.clone(), move || {
                let settings = settings.iter().map(|s| s.to_string()).collect();
                check(&View { scene: parse_sized(&xml, size, backend), kind, settings, what });
            });
        }
    }
}

/// A camera at `origin` that looks at `target`, both moved and scaled.
fn camera(fov: f64, origin: [f64; 3], target: [f64; 3], scale: f64, offset: f64) -> String {
    let place = |p: [f64; 3]| p.map(|x| (x * scale + offset).to_string()).join(", ");
    let (near, far) = (1e-3 * scale, 1e4 * scale);
    format!(
        r#"<sensor type="perspective"><float name="fov" value="{fov}"/>
            <float name="near_clip" value="{near}"/><float name="far_clip" value="{far}"/>
            <transform name="to_world"><lookat origin="{}" target="{}" up="0.1, 0.2, 1"/></transform>
            <film type="hdrfilm"><rfilter type="box"/></film></sensor>"#,
        place(origin),
        place(target)
    )
}

/// A floor with a wall, a box, a mirror, and a glass ball on it, under a lamp and a sun; scaled, then moved along all axes.
fn still_life(scale: f64, offset: f64, radiance: f64) -> String {
    let place = |inner: &str| {
        format!(
            r#"<transform name="to_world">{inner}<scale value="{scale}"/>
                <translate x="{offset}" y="{offset}" z="{offset}"/></transform>"#
        )
    };
    let diffuse = |rgb: &str| {
        format!(
            r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="{rgb}"/></bsdf></bsdf>"#
        )
    };
    let shapes = [
        ("rectangle", "", diffuse("0.6, 0.5, 0.4")),
        ("rectangle", r#"<rotate y="1" angle="90"/><translate x="-1" z="1"/>"#, diffuse("0.3, 0.7, 0.4")),
        (
            "cube",
            r#"<scale value="0.2"/><rotate z="1" angle="20"/><translate x="-0.4" y="-0.4" z="0.2"/>"#,
            diffuse("0.7"),
        ),
        (
            "cube",
            r#"<scale value="0.15"/><translate x="0.5" y="-0.5" z="0.15"/>"#,
            r#"<bsdf type="conductor"/>"#.into(),
        ),
        (
            "sphere",
            r#"<scale value="0.3"/><translate x="0.2" y="0.3" z="0.35"/>"#,
            r#"<bsdf type="dielectric"/>"#.into(),
        ),
    ];
    let shapes: String = shapes
        .iter()
        .map(|(kind, placement, bsdf)| format!(r#"<shape type="{kind}">{}{bsdf}</shape>"#, place(placement)))
        .collect();
    format!(
        r#"{}{shapes}<shape type="rectangle">{}<emitter type="area"><rgb name="radiance" value="{}"/></emitter></shape>
        <emitter type="directional"><vector name="direction" value="-1, 0.3, -2"/>
            <rgb name="irradiance" value="{}"/></emitter>"#,
        camera(50.0, [2.0, 0.4, 1.6], [0.0, 0.0, 0.2], scale, offset),
        place(r#"<scale value="0.3"/><rotate x="1" angle="180"/><translate x="0.2" z="1.5"/>"#),
        3.0 * radiance,
        0.5 * radiance
    )
}
