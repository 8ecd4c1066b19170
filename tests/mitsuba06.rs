//! Integrators of Mitsuba 0.6 from outside: their parameters become ours.

mod common;

use caustica::{image_io, scene};
use common::program::{Dir, stderr};
use glam::Vec3;

/// A small room of one ball of glass and a lamp; `integrator` may be empty.
fn room(integrator: &str) -> String {
    format!(
        "<scene version='0.6.0'>{integrator}<sensor type='perspective'><transform name='toWorld'>\
         <lookAt origin='0,1,6' target='0,0,0' up='0,1,0'/></transform><sampler type='independent'>\
         <integer name='sampleCount' value='2'/></sampler><film type='hdrfilm'><integer name='width' value='16'/>\
         <integer name='height' value='12'/></film></sensor>\
         <shape type='rectangle'><transform name='toWorld'><scale value='2'/><rotate x='1' angle='-90'/>\
         <translate y='-1'/></transform></shape>\
         <shape type='rectangle'><transform name='toWorld'><scale value='2'/><translate z='-2'/></transform></shape>\
         <shape type='sphere'><float name='radius' value='0.5'/><bsdf type='dielectric'/></shape>\
         <emitter type='point'><point name='position' x='1' y='2' z='1'/><spectrum name='intensity' value='20'/>\
         </emitter></scene>"
    )
}

/// The picture of a room with the integrator, rendered with further arguments, and what is said.
fn picture(integrator: &str, args: &str) -> (Vec<Vec3>, String) {
    let dir = Dir::new();
    dir.write("room.xml", room(integrator));
    let said = stderr(&dir.succeed(&format!("render room.xml -o a.exr --backend bvh {args}")));
    (image_io::read(&dir.path("a.exr")).unwrap().pixels, said)
}

/// The same bits as with our own words for it.
#[track_caller]
fn means(integrator: &str, args: &str) -> String {
    let (theirs, said) = picture(integrator, "");
    assert_eq!(theirs, picture("", args).0, "{integrator} is not {args}: {said}");
    assert_ne!(theirs, picture("", "").0, "{integrator} has no effect");
    said
}

fn integer(name: &str, value: u32) -> String {
    format!("<integer name='{name}' value='{value}'/>")
}

#[test]
fn photon_mappers() {
    let photonmapper = |inside: &str| format!("<integrator type='photonmapper'>{inside}</integrator>");
    let photons = integer("globalPhotons", 900) + &integer("causticPhotons", 700);
    let all = format!(
        "{photons}{}{}<float name='globalLookupRadius' value='0.2'/><float name='causticLookupRadius' value='0.03'/>",
        integer("lookupSize", 20),
        integer("maxDepth", 7),
    );
    let ours = "--set global_photons=900 --set caustic_photons=700 --set global_k=20 --set caustic_k=20 \
                --set global_radius=0.2 --set caustic_radius=0.03 --set max_depth=7";
    let said = means(&photonmapper(&all), ours);
    assert!(said.contains("'photonmapper'") && !said.contains("warning"), "{said}");
    // What cannot be used is told in one line.
    let idle = integer("directSamples", 3) + &integer("glossySamples", 4) + &integer("maxSpecularDepth", 5);
    let said = means(&photonmapper(&format!("{all}{idle}")), ours);
    let warnings: Vec<_> = said.lines().filter(|l| l.contains("warning")).collect();
    assert!(
        matches!(&warnings[..], [one] if one.contains("direct_samples") && one.contains("max_specular_depth"))
    );
    // The general size is but a default, wherever it stands.
    let sizes = [integer("lookupSize", 20), integer("causticLookupSize", 9)];
    for sizes in [sizes.concat(), sizes.into_iter().rev().collect()] {
        means(&photonmapper(&sizes), "--set global_k=20 --set caustic_k=9");
    }
    // What is around it has no effect, which is said.
    let wrapped = format!(
        "<integrator type='irrcache'>{}{}</integrator>",
        integer("resolution", 5),
        photonmapper(&all)
    );
    let said = means(&wrapped, ours);
    assert!(said.contains("warning: ") && said.contains("'irrcache'"), "{said}");
}

#[test]
fn progressive_photon_mappers() {
    let dir = Dir::new();
    dir.write("room.xml", room(""));
    let radius = scene::load(&dir.path("room.xml"), &[], None).unwrap().geometry.bounds().radius();
    for name in ["ppm", "sppm"] {
        let with = |inside: &str| format!("<integrator type='{name}'>{inside}</integrator>");
        let given = with(&format!(
            "{}{}<float name='initialRadius' value='0.3'/><float name='alpha' value='0.8'/>",
            integer("maxPasses", 3),
            integer("photonCount", 800)
        ));
        // Theirs is in units of the scene, ours a fraction of its radius.
        let r = 0.3 / radius;
        means(
            &given,
            &format!(
                "--passes 3 --set global_photons=800 --set caustic_photons=800 --set alpha=0.8 \
                 --set global_radius={r} --set caustic_radius={r}"
            ),
        );
        // 0 leaves the radius to the renderer, and −1 passes are as many as there are samples.
        let open = with("<float name='initialRadius' value='0'/><integer name='maxPasses' value='-1'/>");
        assert_eq!(picture(&open, "").0, picture("", "").0);
    }
}
