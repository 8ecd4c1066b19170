//! Plugins that Mitsuba 3 or 0.6 has and this renderer lacks, and what to do instead: whoever names one has made no typing
//! error. `docs/plugins.md` lists the others as well.

const MESH: &str = "export it as a mesh";
const MEASURED: &str = "measurements are not read, fit a 'principled' or 'roughconductor'";
const POLARISING: &str = "light has no polarisation here";
const OLD: &str = "only scenes of Mitsuba 0.6 may have it (version=\"0.6.0\")";
const MEDIUM: &str = "light goes straight from surface to surface, leave the medium out";
const SUBSURFACE: &str = "light does not go below surfaces, use a bsdf alone, such as 'roughplastic'";

/// Element, plugin, and why not or what instead.
#[rustfmt::skip]
const REFUSED: [(&str, &str, &str); 43] = [
    ("bsdf", "measured", MEASURED),
    ("bsdf", "measured_polarized", MEASURED),
    ("bsdf", "pplastic", "light has no polarisation here, use 'roughplastic'"),
    ("bsdf", "polarizer", POLARISING),
    ("bsdf", "retarder", POLARISING),
    ("bsdf", "circular", POLARISING),
    ("bsdf", "hair", "there are no strands, model them as meshes of another bsdf"),
    ("bsdf", "hk", "light does not go below surfaces, use 'roughplastic', or 'difftrans' for what is thin"),
    ("bsdf", "irawan", "woven cloth is not modelled, use 'principled' with 'sheen'"),
    ("bsdf", "coating", "only scenes of Mitsuba 0.6 may have it (version=\"0.6.0\"), use 'principled' with 'clearcoat'"),
    ("bsdf", "roughcoating", "only scenes of Mitsuba 0.6 may have it (version=\"0.6.0\"), use 'principled' with 'clearcoat'"),
    ("bsdf", "mixturebsdf", "only scenes of Mitsuba 0.6 may have it (version=\"0.6.0\"), use 'blendbsdf'"),
    ("shape", "bsplinecurve", MESH),
    ("shape", "linearcurve", MESH),
    ("shape", "hair", MESH),
    ("shape", "sdfgrid", MESH),
    ("shape", "ellipsoids", MESH),
    ("shape", "ellipsoidsmesh", MESH),
    ("shape", "heightfield", MESH),
    ("shape", "deformable", "nothing moves, export one moment of it as a mesh"),
    ("shape", "blender", "it hands over memory of a running Blender, export it as a mesh"),
    ("texture", "gridtexture", OLD),
    ("texture", "scale", OLD),
    ("texture", "vertexcolors", "only scenes of Mitsuba 0.6 may have it (version=\"0.6.0\"), use 'mesh_attribute'"),
    ("texture", "volume", "textures are looked up on surfaces, use 'bitmap' or 'mesh_attribute'"),
    ("texture", "wireframe", "bake it into a 'bitmap'"),
    ("texture", "curvature", "bake it into a 'bitmap'"),
    ("emitter", "timed_sunsky", "time stands still here, use 'sunsky' with one sun"),
    ("emitter", "sky", "it is of Mitsuba 0.6, use 'sunsky' here with a 'sun_scale' of 0"),
    ("emitter", "sun", "it is of Mitsuba 0.6, use 'sunsky' here with a 'sky_scale' of 0"),
    ("sensor", "radiancemeter", "it measures a single ray, use a 'perspective' of narrow field of view"),
    ("sensor", "irradiancemeter", "it measures light on a shape, use an 'orthographic' that looks at a white diffuse surface there"),
    ("sensor", "fluencemeter", "it measures light at a point, use a 'perspective' that looks at a white diffuse surface there"),
    ("sensor", "distant", "it sees the scene from infinitely far away, use an 'orthographic' from outside of it"),
    ("sensor", "batch", "it holds several views, render each on its own"),
    ("sensor", "spherical", "it sees all around, use several views of 'perspective'"),
    ("sensor", "telecentric", "use 'orthographic', which is the same without a lens"),
    ("sensor", "perspective_rdist", "use 'perspective', which is the same without distortion"),
    ("film", "specfilm", "light has three channels"),
    ("medium", "homogeneous", MEDIUM),
    ("medium", "heterogeneous", MEDIUM),
    ("subsurface", "dipole", SUBSURFACE),
    ("subsurface", "singlescatter", SUBSURFACE),
];

/// Why a plugin of Mitsuba's is refused, or what to use instead; `None` if Mitsuba has none of this name.
pub(super) fn reason(tag: &str, plugin: &str) -> Option<&'static str> {
    REFUSED.iter().find(|(t, p, _)| (*t, *p) == (tag, plugin)).map(|(.., reason)| *reason)
}
