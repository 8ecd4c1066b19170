//! From arguments to a scene ready to be rendered and the options to render it with.

use super::args::SceneArgs;
use caustica::accel::Backend;
use caustica::integrator::{Budget, Kind, Options, Params};
use caustica::scene::{self, IntegratorParam, Scene};
use caustica::{Error, Result};
use std::path::Path;
use std::time::Instant;

/// A loaded scene.
pub(super) struct Prepared {
    pub(super) scene: Scene,
    pub(super) backend: Backend,
    /// With the scene's own number of passes as budget.
    pub(super) options: Options,
    /// The integrator that the file names.
    pub(super) named_integrator: String,
    /// Seconds it took to read files, and to build the acceleration structure.
    pub(super) seconds: (f64, f64),
}

/// Runs `f` with as many threads as the command line says.
pub(super) fn with_threads<R: Send>(args: &SceneArgs, f: impl FnOnce() -> Result<R> + Send) -> Result<R> {
    match args.threads {
        None => f(),
        Some(n) => rayon::ThreadPoolBuilder::new()
            .num_threads(n.into())
            .build()
            .map_err(|e| {
                Error::Runtime(format!("cannot start {n} threads: {e}; ask for fewer with --threads"))
            })?
            .install(f),
    }
}

/// Loads `path`, says what of it is ignored, and settles the integrator (`kind` if it was asked for) and its parameters.
pub(super) fn prepare(path: &Path, args: &SceneArgs, kind: Option<Kind>) -> Result<Prepared> {
    // Cheap checks first: nobody should wait for a scene to hear of a typing error.
    let backend = args.backend()?;
    let mut overrides = Params::default();
    for (name, value) in &args.set {
        overrides.set(name, value)?;
    }
    let start = Instant::now();
    let description = scene::load(path, &args.define, args.size)?;
    let load = start.elapsed().as_secs_f64();
    let named = description.integrator.clone();
    let mut params = Params::default();
    let radius = description.geometry.bounds().radius();
    let mut ignored = Vec::new();
    // `lookup_size` is but the default of the two others that end so, wherever it stands.
    let mut given: Vec<_> = description.integrator_params.iter().collect();
    given.sort_by_key(|param| param.name != "lookup_size");
    for param in given {
        let ours = translate(&named, param, radius);
        if ours.is_empty() {
            ignored.push(param.name.as_str());
        }
        ours.iter().try_for_each(|(name, value)| apply(&mut params, name, value, param))?;
    }
    if !ignored.is_empty() {
        let message =
            format!("parameters of integrator '{named}' that have no effect: {}", ignored.join(", "));
        args.verbosity.note("warning: ", &message);
    }
    for (name, value) in &args.set {
        params.set(name, value)?;
    }
    for warning in &description.warnings {
        args.verbosity.note("warning: ", warning);
    }
    if kind.is_none() && !matches!(named.as_str(), "" | "photonmap") {
        let message = format!(
            "{} names the integrator '{named}'; it is rendered by photon mapping (--integrator path traces paths)",
            path.display()
        );
        args.verbosity.note("note: ", &message);
    }
    let passes = description.sample_count.max(1);
    let options = Options {
        integrator: kind.unwrap_or(Kind::Photonmap),
        params,
        seed: args.seed,
        budget: Budget::Passes(passes),
        aovs: false,
    };

    let start = Instant::now();
    let mut scene = Scene::new(description, backend)?;
    if !options.params.skip {
        scene.compute_everything();
    }
    let build = start.elapsed().as_secs_f64();
    Ok(Prepared { scene, backend, options, named_integrator: named, seconds: (load, build) })
}

/// Our names and values for a parameter of a scene's integrator; none if it means nothing to us. What a `photonmap` says
/// is passed on whatever it is, so that typing errors are found; others have parameters that only they need. `radius` is
/// the scene's.
fn translate<'a>(integrator: &str, param: &'a IntegratorParam, radius: f32) -> Vec<(&'a str, String)> {
    let value = param.value.as_str();
    let same = |names: &[&'a str]| names.iter().map(|name| (*name, value.to_string())).collect();
    match (integrator, param.name.as_str()) {
        ("photonmap", name) => same(&[name]),
        (_, "max_depth") => same(&["max_depth"]),
        (_, "rr_depth") => same(&["rr_depth"]),
        (_, "hide_emitters") => same(&["hide_emitters"]),
        // Mitsuba 0.6, whose radii are fractions of the scene's radius as ours are.
        ("photonmapper", "global_photons") => same(&["global_photons"]),
        ("photonmapper", "caustic_photons") => same(&["caustic_photons"]),
        ("photonmapper", "lookup_size") => same(&["global_k", "caustic_k"]),
        ("photonmapper", "global_lookup_size") => same(&["global_k"]),
        ("photonmapper", "caustic_lookup_size") => same(&["caustic_k"]),
        ("photonmapper", "global_lookup_radius") => same(&["global_radius"]),
        ("photonmapper", "caustic_lookup_radius") => same(&["caustic_radius"]),
        ("ppm" | "sppm", "alpha") => same(&["alpha"]),
        ("ppm" | "sppm", "photon_count") => same(&["global_photons", "caustic_photons"]),
        // In units of the scene; 0 leaves it to the renderer.
        ("ppm" | "sppm", "initial_radius") => match value.parse::<f32>() {
            Ok(r) if r > 0.0 && radius > 0.0 => {
                let relative = (r / radius).to_string();
                vec![("global_radius", relative.clone()), ("caustic_radius", relative)]
            }
            _ => vec![],
        },
        _ => vec![],
    }
}

fn apply(params: &mut Params, name: &str, value: &str, param: &IntegratorParam) -> Result<()> {
    params.set(name, value).map_err(|e| Error::Scene {
        file: param.file.clone(),
        line: param.line,
        message: e.to_string(),
    })
}
