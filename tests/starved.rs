//! Light that the camera sees, beside light a million times as strong that it does not.

mod common;

use caustica::integrator::{Budget, Kind, Options, State};
use caustica::math::{Sampler, Stream};
use caustica::photon::{Emission, Guide, Packed, Start, Store, trace};
use caustica::scene::Scene;
use common::{backends, learn, mean, mean_and_error, params, parse, render_with};
use std::f64::consts::PI;

const SIZE: u32 = 24;

fn options(integrator: Kind, settings: &[&str], seed: u64, passes: u32) -> Options {
    Options { integrator, params: params(settings), seed, budget: Budget::Passes(passes), aovs: false }
}

fn scene(camera: &str, xml: &str) -> Scene {
    let xml = format!(
        r#"<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="70"/>
            <transform name="to_world"><lookat {camera}/></transform>
            <film type="hdrfilm"><rfilter type="box"/></film></sensor>{xml}</scene>"#
    );
    parse(&xml, SIZE, backends().next().unwrap())
}

/// Asserts that a render of 64 passes has the mean `exact`, within 1 %, and does not claim to be better than
/// it is by more than a factor of two.
#[track_caller]
fn assert_honest(scene: &Scene, seed: u64, exact: f64, tolerance: f64) {
    let rendering = render_with(scene, &options(Kind::Photonmap, &[], seed, 64));
    let off = (f64::from(mean(&rendering.image).y) / exact - 1.0).abs();
    let claimed = rendering.error.total();
    println!("seed {seed}: off by {:.2} %, claims {:.2} %", 100.0 * off, 100.0 * claimed);
    assert!(off < tolerance && (off < 0.002 || off < 2.0 * claimed), "off by {off}, claims {claimed}");
}

/// The inside of a white sphere of radius 2 around `center`, with a lamp of `intensity` in the middle.
fn globe(center: &str, intensity: &str) -> String {
    format!(
        r#"<shape type="sphere"><point name="center" value="{center}"/><float name="radius" value="2"/>
            <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></bsdf></shape>
        <emitter type="point"><point name="position" value="{center}"/>
            <rgb name="intensity" value="{intensity}"/></emitter>"#
    )
}

const IN_GLOBE: &str = r#"origin="0, 0, 0.5" target="1, 0.2, 0.1" up="0, 0, 1""#;

/// What all of the inside sends out: irradiance I/r² from the lamp, and 1/(1 − ρ) times as much by way of the
/// walls.
const GLOBE: f64 = 0.5 / PI * (1.0 / 4.0) / (1.0 - 0.5);

#[test]
fn a_sealed_lamp_takes_no_light_away() {
    let xml = globe("0, 0, 0", "1") + &globe("30, 0, 0", "1e7");
    for seed in [0, 1] {
        assert_honest(&scene(IN_GLOBE, &xml), seed, GLOBE, 0.01);
    }
}

/// A closed room with a lamp, and what stands around it.
fn room(around: &str) -> Scene {
    let xml = format!(
        r#"<shape type="cube"><transform name="to_world"><scale x="3" y="5" z="2"/><translate z="2"/></transform>
            <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="180"/>
            <translate z="3.5"/></transform><emitter type="area"><rgb name="radiance" value="5"/></emitter></shape>{around}"#
    );
    scene(r#"origin="0, -4, 2" target="0, 0, 0.3" up="0, 0, 1""#, &xml)
}

#[test]
fn the_sun_over_a_closed_room_takes_no_light_away() {
    let sun = r#"<shape type="rectangle"><transform name="to_world"><scale value="500"/><translate z="-0.2"/></transform>
        <bsdf type="diffuse"/></shape>
        <emitter type="directional"><vector name="direction" x="-1" y="0.3" z="-1"/><rgb name="irradiance" value="1000"/></emitter>"#;
    let exact = mean(&render_with(&room(""), &options(Kind::Path, &[], 9, 2048)).image);
    for seed in [0, 1] {
        assert_honest(&room(sun), seed, f64::from(exact.y), 0.01);
    }
}

/// A room of six metres with a window of one, before a plane of the given half-width under a white sky.
fn windowed(plane: f32) -> Scene {
    let wall = |transform: &str| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world">{transform}</transform><bsdf type="twosided">
            <bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></bsdf></shape>"#
        )
    };
    let walls = [
        r#"<scale value="3"/>"#,
        r#"<scale value="3"/><translate z="4"/>"#,
        r#"<scale x="3" y="2" z="1"/><rotate x="1" angle="90"/><translate y="3" z="2"/>"#,
        r#"<scale x="3" y="2" z="1"/><rotate x="1" angle="90"/><translate y="-3" z="2"/>"#,
        r#"<scale x="2" y="3" z="1"/><rotate y="1" angle="90"/><translate x="-3" z="2"/>"#,
        // The fourth one, around the window.
        r#"<scale x="1.5" y="3" z="1"/><rotate y="1" angle="90"/><translate x="3" z="0"/>"#,
        r#"<scale x="0.75" y="3" z="1"/><rotate y="1" angle="90"/><translate x="3" z="3.25"/>"#,
        r#"<scale x="0.5" y="1.25" z="1"/><rotate y="1" angle="90"/><translate x="3" y="-1.75" z="2"/>"#,
        r#"<scale x="0.5" y="1.25" z="1"/><rotate y="1" angle="90"/><translate x="3" y="1.75" z="2"/>"#,
    ];
    let ground = wall(&format!(r#"<scale value="{plane}"/><translate z="-0.5"/>"#));
    let xml = walls.map(wall).concat() + &ground + r#"<emitter type="constant"/>"#;
    scene(r#"origin="2.5, -2.5, 2" target="-3, 2, 1" up="0, 0, 1""#, &xml)
}

/// Flux onto the floor of the room straight from the sky, of each of `passes`; and how many photons that were
/// in all.
fn onto_floor(scene: &Scene, guide: Option<&Guide>, count: u64, passes: u32) -> (Vec<f64>, usize) {
    let mut landed = 0;
    let flux = (0..passes).map(|pass| {
        let emission = Emission { guide, ..Emission::new(Store::All, count, 64) };
        let photons = trace(scene, 1, pass, &emission).photons;
        let on_floor = photons.iter().map(Packed::unpack).filter(|photon| {
            photon.depth == 1
                && photon.p.z.abs() < 1e-3
                && photon.p.truncate().abs().max_element() < 2.999
                && photon.wi.z > 0.0
        });
        on_floor.inspect(|_| landed += 1).map(|photon| f64::from(photon.flux.y)).sum()
    });
    (flux.collect(), landed)
}

/// What comes in is what comes in of photons that know of nothing, within the 99.9 % confidence interval of
/// the difference of two means of 16 values; and it is far more photons. On a plane of a kilometre they would
/// be none at all.
#[test]
fn a_window_is_found_from_the_sky() {
    const T: f64 = 3.65;
    const COUNT: u64 = 1 << 18;
    let scene = windowed(10.0);
    let guide = learn(&scene, Store::All, 1 << 20, 64);
    let (flux, landed) = onto_floor(&scene, guide.as_ref(), COUNT, 16);
    let (flux_plain, landed_plain) = onto_floor(&scene, None, 4 * COUNT, 16);
    let ((mean, error), (plain, error_plain)) = (mean_and_error(&flux), mean_and_error(&flux_plain));
    let width = T * error.hypot(error_plain) / plain;
    println!("flux {mean:.4} and {plain:.4} ± {:.1} %, photons {landed} and {landed_plain}", 100.0 * width);
    assert!((mean / plain - 1.0).abs() < width && width < 0.2);
    assert!(4 * landed > 20 * landed_plain, "photons {landed} and {landed_plain}");

    let far = windowed(500.0);
    let (_, landed) = onto_floor(&far, learn(&far, Store::All, COUNT, 64).as_ref(), COUNT, 2);
    let (_, landed_plain) = onto_floor(&far, None, COUNT, 2);
    println!("photons {landed} and {landed_plain}");
    assert!(landed > 200 && landed > 100 * landed_plain, "photons {landed} and {landed_plain}");
}

/// Three of four hundred lamps light the room that is seen: most photons are theirs, and every other lamp
/// keeps some.
#[test]
fn photons_go_to_the_three_lamps_that_are_seen() {
    let room = |x: f32, lamps: usize| {
        let lamp = |i: usize| {
            let (x, z) = (x + 0.15 * (i % 20) as f32 - 1.45, 0.15 * (i / 20) as f32 - 1.45);
            format!(
                r#"<emitter type="point"><point name="position" value="{x}, 1.9, {z}"/>
                <rgb name="intensity" value="1"/></emitter>"#
            )
        };
        format!(
            r#"<shape type="cube"><transform name="to_world"><scale x="2" y="1" z="2"/><translate x="{x}" y="1"/></transform>
                <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>{}"#,
            (0..lamps).map(lamp).collect::<String>()
        )
    };
    let scene = scene(
        r#"origin="0, 1.5, 1.9" target="0, 0, 0" up="0, 1, 0""#,
        &(room(4.5, 200) + &room(0.0, 3) + &room(-4.5, 197)),
    );
    let guide = learn(&scene, Store::All, 1 << 14, 64);
    let mut counts = [0u32; 400];
    const N: u64 = 1 << 16;
    for index in 0..N {
        let mut sampler = Sampler::new(1, Stream::GlobalPhotons, 0, index);
        let (Start([u_light, ..]), _) = Start::draw(&mut sampler, guide.as_ref());
        counts[scene.lights.emitter(u_light).unwrap().0 as usize] += 1;
    }
    let seen = f64::from(counts[200..203].iter().sum::<u32>()) / N as f64;
    println!("{seen:.3} of the photons for three lamps of 400");
    assert!(seen > 0.5);
    assert!(counts.iter().all(|&count| f64::from(count) > 0.02 * N as f64 / 400.0), "{counts:?}");
}

/// Every reason for a light to be unseen is told.
#[test]
fn why_lights_and_casters_are_unseen() {
    let room = r#"<shape type="cube"><boolean name="flip_normals" value="true"/><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>"#;
    let sealed = r#"<shape type="cube"><transform name="to_world"><translate x="9"/></transform>
        <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>"#;
    let point = |at: &str, intensity: &str| {
        format!(
            r#"<emitter type="point"><point name="position" value="{at}"/><rgb name="intensity" value="{intensity}"/></emitter>"#
        )
    };
    let ball = |at: &str, inside: &str| {
        format!(
            r#"<shape type="sphere"><point name="center" value="{at}"/><float name="radius" value="0.2"/>{inside}</shape>"#
        )
    };
    let glass = r#"<bsdf type="dielectric"/>"#;
    let away = r#"<shape type="rectangle"><transform name="to_world"><translate z="40"/></transform><emitter type="area"/></shape>"#;
    let inward = ball("9, 0.5, 0", r#"<boolean name="flip_normals" value="true"/><emitter type="area"/>"#);
    let xml = [
        room,
        sealed,
        &point("0, 0.8, 0", "1"),
        &point("0.1, 0.8, 0", "0"),
        &point("9, 0.8, 0", "1"),
        away,
        &inward,
        &ball("0, -0.5, 0", glass),
        &ball("9.6, 0.6, 0.6", glass),
        &ball("0, 20, 0", glass),
    ]
    .concat();
    let scene = scene(r#"origin="0, 0.5, 0.9" target="0, -1, -0.3" up="0, 1, 0""#, &xml);
    let survey = |settings: &[&str]| {
        let options = options(Kind::Photonmap, settings, 0, 1);
        let mut state = State::new(&scene, &options, 0).unwrap();
        state.render(&scene, &options, &mut |_, _| std::ops::ControlFlow::Continue(()));
        state.statistics.survey
    };
    let told = survey(&[]);
    told.lines().iter().for_each(|line| println!("{line}"));
    let light = |kind: &str, why: &str| {
        let found = told.lights.iter().any(|light| {
            light.name.contains(kind) && light.why_none.as_deref().unwrap_or("seen").contains(why)
        });
        assert!(found, "no {kind} light is told to be {why}");
    };
    light("light 0 (point)", "seen");
    light("light 1 (point)", "black");
    light("light 2 (point)", "hidden");
    light("mesh", "faces away");
    light("sphere", "normals point inward");
    let whys: Vec<&str> =
        told.casters.iter().map(|caster| caster.why_none.as_deref().unwrap_or("seen")).collect();
    assert_eq!(whys.len(), 3, "{whys:?}");
    for why in ["seen", "nothing is seen", "no light reaches it"] {
        assert!(whys.iter().any(|w| w.contains(why)), "{why} is not in {whys:?}");
    }
}
