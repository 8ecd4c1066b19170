//! Caustic photons are aimed: most of them meet something sharp first, and what they bring is what unaimed ones bring.

mod common;

use caustica::light::Targets;
use caustica::math::{Ray, Sampler, Stream};
use caustica::photon::{Emission, Guide, Splatter, Start, Store, trace};
use caustica::scene::Scene;
use common::{backends, learn, load, mean_and_error, parse, shared};

/// The share of emitted caustic photons whose first hit is sharp.
fn share(scene: &Scene) -> f64 {
    let guide = learn(scene, Store::Caustic, 1 << 14, 8);
    const N: u64 = 1 << 16;
    let aimed = (0..N).filter(|&index| {
        let mut sampler = Sampler::new(1, Stream::CausticPhotons, 0, index);
        let (at, _) = Start::draw(&mut sampler, guide.as_ref());
        let start = at.emit(scene, &scene.casters);
        let hit = start.and_then(|start| scene.intersect(&Ray::new(start.o, start.d)));
        hit.is_some_and(|hit| scene.material(hit.shape).lobes().sharp)
    });
    aimed.count() as f64 / N as f64
}

/// A glass ball of 10 cm in a hall of 100 m, with a roof or without one.
fn hall(light: &str, roof: bool) -> Scene {
    let roof = match roof {
        true => {
            r#"<shape type="rectangle"><transform name="to_world"><scale value="50"/><rotate x="1" angle="90"/>
            <translate value="0, 20, 0"/></transform></shape>"#
        }
        false => "",
    };
    let wall = |angle: u32| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><scale x="50" y="10" z="1"/>
            <translate value="0, 10, -50"/><rotate y="1" angle="{angle}"/></transform></shape>"#
        )
    };
    let walls: String = [0, 90, 180, 270].map(wall).concat();
    let xml = format!(
        r#"<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="10"/>
            <transform name="to_world"><lookat origin="5, 1, 4" target="2, 0, 3" up="0, 1, 0"/></transform></sensor>
        <shape type="rectangle"><transform name="to_world"><scale value="50"/><rotate x="1" angle="-90"/></transform></shape>
        {walls}{roof}{light}
        <shape type="sphere"><point name="center" value="2, 0.06, 3"/><float name="radius" value="0.05"/>
            <bsdf type="dielectric"/></shape></scene>"#
    );
    parse(&xml, 32, backends().next().unwrap())
}

const HALL_LIGHTS: [(&str, bool, &str); 8] = [
    (
        "panel",
        true,
        r#"<shape type="rectangle"><transform name="to_world"><scale value="5"/><rotate x="1" angle="90"/>
        <translate value="0, 19.9, 0"/></transform><emitter type="area"/></shape>"#,
    ),
    (
        "globe",
        true,
        r#"<shape type="sphere"><point name="center" value="20, 10, 0"/><emitter type="area"/></shape>"#,
    ),
    ("point", true, r#"<emitter type="point"><point name="position" value="-30, 15, 0"/></emitter>"#),
    (
        "spot",
        true,
        r#"<emitter type="spot"><float name="cutoff_angle" value="60"/><transform name="to_world">
        <lookat origin="0, 19, 0" target="0, 0, 0" up="1, 0, 0"/></transform></emitter>"#,
    ),
    (
        "sun",
        false,
        r#"<emitter type="directional"><vector name="direction" value="0.4, -1, 0.2"/></emitter>"#,
    ),
    ("sky", false, r#"<emitter type="constant"/>"#),
    (
        "mixed",
        true,
        r#"<emitter type="point"><point name="position" value="-30, 15, 0"/></emitter>
        <emitter type="spot"><transform name="to_world"><lookat origin="0, 19, 0" target="40, 0, 0" up="1, 0, 0"/></transform></emitter>"#,
    ),
    (
        "hidden",
        true,
        r#"<emitter type="point"><point name="position" value="-30, 15, 0"/></emitter>
        <emitter type="point"><rgb name="intensity" value="9"/><point name="position" value="-30, 25, 0"/></emitter>"#,
    ),
];

#[test]
fn most_photons_find_a_caster() {
    let mut shares = Vec::new();
    for name in ["cornell-spheres", "ring", "glossy-caustic", "env-caustic", "pool"] {
        if let Some(file) = shared(&format!("reference/scenes/{name}.xml")) {
            shares.push((name, share(&load(&file, 32, backends().next().unwrap()))));
        }
    }
    shares.extend(HALL_LIGHTS.map(|(name, roof, light)| (name, share(&hall(light, roof)))));
    println!("{shares:.3?}");
    for (name, share) in shares {
        assert!(share >= 0.8, "{name}: only {share:.3} of the photons are aimed well");
    }
}

/// A ball of glass, a box of rough metal, and a mirror on a diffuse floor. The first light reaches the ball by way of the
/// mirror only.
fn room(light: &str) -> Scene {
    let xml = format!(
        r#"<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="70"/>
            <transform name="to_world"><lookat origin="0, 3, 3" target="0, 0, 0" up="0, 1, 0"/></transform>
            <film type="hdrfilm"><rfilter type="box"/></film></sensor>
        <bsdf type="twosided" id="grey"><bsdf type="diffuse"/></bsdf>
        <shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/></transform>
            <ref id="grey"/></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="0.6"/><translate value="0, 1, -1.5"/></transform>
            <bsdf type="conductor"/></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="0.5"/><rotate y="1" angle="90"/>
            <translate value="1, 1, 0"/></transform><ref id="grey"/></shape>
        <shape type="cube"><transform name="to_world"><scale value="0.2"/><rotate y="1" angle="30"/>
            <translate value="-1.5, 0.3, 0.4"/></transform>
            <bsdf type="roughconductor"><float name="alpha" value="0.1"/></bsdf></shape>
        <shape type="sphere"><point name="center" value="0, 1, 0"/><float name="radius" value="0.4"/>
            <bsdf type="dielectric"/></shape>{light}</scene>"#
    );
    parse(&xml, 32, backends().next().unwrap())
}

/// What the caustic photons of one pass bring: to the picture's mean, and to the back and the front of the room.
fn brought(scene: &Scene, guide: Option<&Guide>, pass: u32, count: u64) -> [f64; 3] {
    let splatter = Splatter { scene, hide_emitters: false };
    let emission = Emission { guide, splatter: Some(&splatter), ..Emission::new(Store::Caustic, count, 8) };
    let traced = trace(scene, 3, pass, &emission);
    let half = |sign: f32| {
        let photons = traced.photons.iter().map(|packed| packed.unpack());
        let there = photons.filter(|photon| photon.p.z * sign > 0.0);
        there.map(|photon| photon.flux.y as f64).sum()
    };
    [traced.splats.iter().map(|splat| splat.value.y as f64).sum(), half(-1.0), half(1.0)]
}

/// Student's t of 99.9 % for the difference of two means of 24 values, over three figures of six lights: chance exceeds it
/// once in 50 times for any of them, and seeds are fixed.
const T: f64 = 3.515;

#[test]
fn aiming_does_not_change_the_mean() {
    let lights = [
        r#"<emitter type="point"><point name="position" value="2, 1, 0"/></emitter>"#,
        r#"<emitter type="spot"><float name="cutoff_angle" value="40"/><transform name="to_world">
            <lookat origin="0, 4, 0" target="0, 0, 0" up="1, 0, 0"/></transform></emitter>"#,
        r#"<shape type="rectangle"><transform name="to_world"><scale value="0.5"/><rotate x="1" angle="90"/>
            <translate value="-1, 3, 0"/></transform><ref id="grey"/><emitter type="area"/></shape>"#,
        r#"<shape type="sphere"><point name="center" value="0, 1.7, 0"/><float name="radius" value="0.25"/>
            <emitter type="area"/></shape>"#,
        r#"<emitter type="directional"><vector name="direction" value="0.3, -1, 0.2"/></emitter>"#,
        r#"<emitter type="constant"/>"#,
    ];
    for light in lights {
        let mut scene = room(light);
        let guide = learn(&scene, Store::Caustic, 1 << 14, 8);
        assert!(guide.is_some());
        let passes = |scene: &Scene, guide: Option<&Guide>, count| {
            (0..24).map(|pass| brought(scene, guide, pass, count)).collect::<Vec<_>>()
        };
        let aimed = passes(&scene, guide.as_ref(), 1 << 14);
        scene.casters = Targets::default();
        let unaimed = passes(&scene, None, 1 << 16);
        for i in 0..3 {
            let of = |runs: &[[f64; 3]]| mean_and_error(&runs.iter().map(|run| run[i]).collect::<Vec<_>>());
            let ((a, error_a), (b, error_b)) = (of(&aimed), of(&unaimed));
            let told = format!("{a:.5e} ± {error_a:.1e} aimed, {b:.5e} ± {error_b:.1e} not: {i} of {light}");
            println!("{told}");
            assert!((a - b).abs() <= T * error_a.hypot(error_b), "{told}");
            assert!(error_a < 0.01 * a && error_b < 0.05 * b, "not precise enough: {told}");
        }
    }
}
