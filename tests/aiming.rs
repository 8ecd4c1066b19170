//! Caustic photons are aimed: most of them meet something sharp first, and what they bring is what unaimed ones bring.

mod common;

use caustica::math::{Ray, Sampler, Stream};
use caustica::photon::Guide;
use caustica::scene::Scene;
use common::{backends, load, parse, shared};

/// The share of emitted caustic photons whose first hit is sharp.
fn share(scene: &Scene, guided: bool) -> f64 {
    let guide = if guided { Guide::learn(scene) } else { None };
    const N: u64 = 1 << 16;
    let aimed = (0..N).filter(|&index| {
        let mut sampler = Sampler::new(1, Stream::CausticPhotons, 0, index);
        let (l, p, d) = (sampler.next_1d(), sampler.next_2d(), sampler.next_2d());
        let u = [l, p.x, p.y, d.x, d.y];
        let (u, _) = guide.as_ref().map_or((u, 1.0), |g| g.warp(u));
        let start = scene.lights.sample_emission(
            &scene.geometry,
            &scene.textures,
            &scene.casters,
            u[0],
            [u[1], u[2]].into(),
            [u[3], u[4]].into(),
        );
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
    for name in ["cornell-spheres", "ring", "glossy-caustic", "env-caustic", "pool"] {
        let Some(file) = shared(&format!("reference/scenes/{name}.xml")) else { continue };
        let scene = load(&file, 32, backends().next().unwrap());
        println!("{name}: {:.3} {:.3}", share(&scene, false), share(&scene, true));
    }
    for (name, roof, light) in HALL_LIGHTS {
        let scene = hall(light, roof);
        println!("{name}: {:.3} {:.3}", share(&scene, false), share(&scene, true));
    }
    let now = std::time::Instant::now();
    let scene = hall(HALL_LIGHTS[0].2, true);
    Guide::learn(&scene);
    println!("{:?}", now.elapsed());
}
