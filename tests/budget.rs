//! Caustic photons are shared among lights by what the camera sees of them.

mod common;

use caustica::math::{Sampler, Stream};
use caustica::photon::{Emission, Guide, Splatter, Start, Store, trace};
use caustica::scene::Scene;
use common::{backends, learn, mean_and_error, parse};

const SIZE: u32 = 32;

/// Two rooms, parted by a wall: one with a lamp and a glass ball, which the camera sees, and one with 47 more lamps and
/// another ball.
fn rooms() -> Scene {
    let room = |x: f32, lamps: usize| {
        let lamp = |i: usize| {
            let (x, z) = (x + 0.5 * (i % 7) as f32 - 1.5, 0.5 * (i / 7) as f32 - 1.5);
            format!(
                r#"<emitter type="point"><point name="position" value="{x}, 1.9, {z}"/>
                <rgb name="intensity" value="1"/></emitter>"#
            )
        };
        // The inside of a cube, and the ball.
        format!(
            r#"<shape type="cube"><boolean name="flip_normals" value="true"/>
                <transform name="to_world"><scale x="2" y="1" z="2"/><translate x="{x}" y="1"/></transform>
                <bsdf type="diffuse"/></shape>
            <shape type="sphere"><point name="center" value="{x}, 0.6, 0"/><float name="radius" value="0.4"/>
                <bsdf type="dielectric"/></shape>{}"#,
            (0..lamps).map(lamp).collect::<String>()
        )
    };
    let xml = format!(
        r#"<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="60"/>
            <transform name="to_world"><lookat origin="0, 1.5, 1.9" target="0, 0, 0" up="0, 1, 0"/></transform>
            <film type="hdrfilm"><rfilter type="box"/></film></sensor>{}{}</scene>"#,
        room(0.0, 1),
        room(4.0, 47)
    );
    parse(&xml, SIZE, backends().next().unwrap())
}

/// The caustic that the camera sees, pixel by pixel, from `count` photons.
fn caustic(scene: &Scene, guide: Option<&Guide>, count: u64, pass: u32) -> Vec<f64> {
    let splatter = Splatter { scene, hide_emitters: false };
    let emission = Emission { guide, splatter: Some(&splatter), ..Emission::new(Store::Caustic, count, 16) };
    let mut pixels = vec![0.0; (SIZE * SIZE) as usize];
    for splat in trace(scene, 3, pass, &emission).splats {
        pixels[splat.pixel as usize] += f64::from(splat.value.y);
    }
    pixels
}

/// At equal numbers of photons the squared error falls to less than a tenth: by power, 2 % of the photons were the
/// visible lamp's, and now more than 60 % are.
#[test]
fn visible_caustics_get_the_photons() {
    let scene = rooms();
    let guide = learn(&scene, Store::Caustic, 1 << 14, 16);
    let of_light = |light: u32| {
        let drawn = |index| {
            let mut sampler = Sampler::new(1, Stream::CausticPhotons, 0, index);
            let (at, weight) = Start::draw(&mut sampler, guide.as_ref());
            at.emit(&scene, &scene.casters).filter(|start| start.light == light).map(|_| weight)
        };
        (0..1 << 14).filter_map(drawn).count() as f64 / f64::from(1 << 14)
    };
    let shares: Vec<f64> = (0..48).map(of_light).collect();
    println!("{shares:.4?}");
    assert!(shares[0] > 0.6);
    // The others keep some.
    assert!(shares[1..].iter().all(|&share| share > 0.1 / 48.0));
    let reference = caustic(&scene, guide.as_ref(), 1 << 20, 1000);
    let error = |guide: Option<&Guide>| {
        let error = |pass| {
            let picture = caustic(&scene, guide, 1 << 13, pass);
            picture.iter().zip(&reference).map(|(a, b)| (a - b).powi(2)).sum::<f64>()
        };
        (0..8).map(error).sum::<f64>()
    };
    let (before, after) = (error(None), error(guide.as_ref()));
    println!("squared error {before:.3e} by power, {after:.3e} by contribution");
    assert!(after < 0.1 * before);
}

/// However photons are shared, the camera sees the same of caustics, within the 99.9 % confidence interval of the
/// difference of two means of 24 values.
#[test]
fn sharing_is_unbiased() {
    const T: f64 = 3.515;
    let scene = rooms();
    let guide = learn(&scene, Store::Caustic, 1 << 14, 16);
    let mean = |guide: Option<&Guide>, count| {
        let totals: Vec<f64> = (0..24).map(|pass| caustic(&scene, guide, count, pass).iter().sum()).collect();
        mean_and_error(&totals)
    };
    let ((by_power, e0), (guided, e1)) = (mean(None, 1 << 16), mean(guide.as_ref(), 1 << 12));
    let (off, width) = (guided / by_power - 1.0, T * e0.hypot(e1) / by_power);
    println!("{by_power:.4e} and {guided:.4e}: {:.2} % ± {:.2} %", 100.0 * off, 100.0 * width);
    assert!(off.abs() < width && width < 0.05);
}
