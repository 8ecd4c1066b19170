//! Geometry, lights and films that hardly are any.

use crate::common::{assert_mean, backends, mean, parse, render};
use crate::{View, camera, for_all, still_life, watched};
use caustica::image_io::{self, Channels, Image, Layer, Metadata, SampleType};
use caustica::integrator::Kind;
use caustica::math::Rgb;

const FLOOR: &str = r#"<shape type="rectangle"><transform name="to_world"><scale value="2"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>"#;

fn view() -> String {
    camera(60.0, [0.0, -0.3, 2.0], [0.0; 3], 1.0, 0.0)
}

fn lamp(placement: &str) -> String {
    format!(
        r#"<shape type="rectangle"><transform name="to_world"><scale value="0.5"/><rotate x="1" angle="180"/>{placement}</transform>
            <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
            <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#
    )
}

/// Whatever the scene, pixels are sane; where its picture has a known mean, it has that.
#[test]
fn odd_scenes() {
    let view = view();
    let sun = r#"<emitter type="directional"><vector name="direction" value="0, 0, -1"/><rgb name="irradiance" value="1"/></emitter>"#;
    let lit = 0.5 / std::f64::consts::PI;
    let sky = r#"<emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#;
    let flat = |kind: &str, inner: &str, scale: &str| {
        format!(
            r#"<shape type="{kind}">{inner}<transform name="to_world"><scale value="{scale}"/><translate z="0.5"/></transform>
                <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#
        )
    };
    let point = r#"<emitter type="point"><point name="position" value="0, 0, 0"/><rgb name="intensity" value="1"/></emitter>"#;
    let cases = [
        ("nothing that shines", FLOOR.replace("rectangle", "disk"), Some(0.0)),
        ("only a sky", sky.into(), Some(1.0)),
        ("only a sun", sun.into(), Some(0.0)),
        ("only a point light", point.into(), Some(0.0)),
        (
            "only a lamp, from behind",
            lamp("").replace("180", "0").replace("0.5", "9").replace("z=", "z=-"),
            None,
        ),
        ("a floor without light", FLOOR.into(), Some(0.0)),
        ("a point light in the floor", format!("{FLOOR}{point}"), None),
        ("two floors in one place", format!("{FLOOR}{FLOOR}{sun}"), Some(lit)),
        (
            "a rectangle of hardly any area",
            format!("{FLOOR}{sun}{}", flat("rectangle", "", "1e-15, 1e-15, 1")),
            Some(lit),
        ),
        ("a small ball", format!("{FLOOR}{sun}{}", flat("sphere", "", "1e-15")), Some(lit)),
        ("a lamp on the floor", format!("{FLOOR}{}", lamp("")), None),
        ("a lamp just above the floor", format!("{FLOOR}{}", lamp(r#"<translate z="1e-6"/>"#)), None),
        (
            "a ball of light half in the floor",
            format!("{FLOOR}{}", flat("sphere", "", "0.5").replace("z=\"0.5\"", "z=\"0\"")),
            None,
        ),
        ("a ball of light touching the floor", format!("{FLOOR}{}", flat("sphere", "", "0.5")), None),
    ];
    for (name, body, expected) in cases {
        for_all(name, &format!("{view}{body}"), (9, 9), move |view| {
            match expected {
                // Light on a floor smaller than the picture's edge: the map shows the kernel's noise.
                Some(0.0) => assert_eq!(mean(&view.render(1, 2).image), Rgb::ZERO, "{}", view.what),
                Some(e) => assert_mean(&view.means(8), e, 2e-3, 0.03, &view.what),
                None => drop(view.render(1, 3)),
            }
        });
    }
}

/// What makes no sense is refused in one sentence.
#[test]
fn refusals() {
    let rectangle = |scale| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><scale value="{scale}"/></transform></shape>"#
        )
    };
    let dir = tempfile::tempdir().unwrap();
    let needle = dir.path().join("needle.obj");
    std::fs::write(&needle, "v 0 0 1\nv 1 0 1\nv -2 0 1\nf 1 2 3\n").unwrap();
    let broken = |name: &str, text: &str| {
        let file = dir.path().join(name);
        std::fs::write(&file, text).unwrap();
        let kind = file.extension().unwrap().to_string_lossy();
        format!(r#"<shape type="{kind}"><string name="filename" value="{}"/></shape>"#, file.display())
    };
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n";
    let cases = [
        // The file is named, and the line.
        (broken("nan.obj", "v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n"), "nan.obj:2: 'nan' is not finite"),
        (broken("inf.obj", "v 0 0 0\nv 1 0 0\nv 0 -inf 0\nf 1 2 3\n"), "inf.obj:3: '-inf' is not finite"),
        (broken("nan.ply", ply), "nan.ply:11: vertex 1 is not finite"),
        (
            format!(
                r#"<shape type="obj"><string name="filename" value="{}"/><emitter type="area"/></shape>"#,
                needle.display()
            ),
            "no area",
        ),
        (String::new(), "no shapes and no emitters"),
        (rectangle("1, 0, 1"), "singular or overflows"),
        (rectangle("1, 1e39, 1"), "singular or overflows"),
        (
            r#"<shape type="sphere"><bsdf type="roughdielectric"><float name="int_ior" value="1"/>
                <float name="ext_ior" value="1"/></bsdf></shape>"#
                .into(),
            "different indices",
        ),
    ];
    for (body, message) in cases {
        let file = dir.path().join("scene.xml");
        std::fs::write(&file, format!(r#"<scene version="3.0.0">{}{body}</scene>"#, view())).unwrap();
        let error = caustica::scene::load(&file, &[], None).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
}

/// Of two surfaces in one place each pixel shows one, whichever the backend prefers, and no mixture; always the same one.
#[test]
fn two_materials_in_one_place() {
    let sheet = |rgb: &str| FLOOR.replace(r#"value="0.5""#, &format!(r#"value="{rgb}""#));
    let sun = r#"<emitter type="directional"><vector name="direction" value="0, 0, -1"/><rgb name="irradiance" value="1"/></emitter>"#;
    let body = format!("{}{}{}{sun}", view(), sheet("0.5, 0, 0"), sheet("0, 0.5, 0"));
    let xml = format!(r#"<scene version="3.0.0">{body}</scene>"#);
    for_all("two materials in one place", &body, (16, 16), move |view| {
        if view.what.contains("map") {
            return;
        }
        let image = view.render(1, 1).image;
        let lit = 0.5 / std::f32::consts::PI;
        let mut shown = [0, 0];
        for (i, pixel) in image.pixels.iter().enumerate() {
            let which = (pixel.y > pixel.x) as usize;
            shown[which] += 1;
            let expected = if which == 0 { Rgb::X } else { Rgb::Y } * lit;
            assert!(
                (*pixel - expected).abs().max_element() < 1e-4 * lit,
                "{}: pixel {i}: {pixel}",
                view.what
            );
        }
        println!("{}: {shown:?} pixels show the first and the second", view.what);
        let backend = backends().find(|b| view.what.contains(b.name())).unwrap();
        let (kind, settings) = (view.kind, view.settings.clone());
        let again = View { scene: parse(&xml, 16, backend), kind, settings, what: view.what.clone() };
        assert!(again.render(1, 1).image == image, "{}: not the same one", view.what);
    });
}

/// A million copies of one triangle are one.
#[test]
fn a_million_copies_of_a_triangle() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("copies.obj");
    std::fs::write(&file, "v -9 -9 0\nv 9 -9 0\nv 0 18 0\n".to_owned() + &"f 1 2 3\n".repeat(1_000_000))
        .unwrap();
    let body = format!(
        r#"{}<shape type="obj"><string name="filename" value="{}"/>
            <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
        <emitter type="directional"><vector name="direction" value="0, 0, -1"/><rgb name="irradiance" value="1"/></emitter>"#,
        view(),
        file.display()
    );
    // By paths alone: a ray meets them all, and takes milliseconds.
    let xml = format!(r#"<scene version="3.0.0">{body}</scene>"#);
    for backend in backends() {
        let xml = xml.clone();
        let seen = watched("a million copies", move || {
            mean(&render(&parse(&xml, 4, backend), Kind::Path, &[], 1).image)
        });
        let off = (seen * (std::f32::consts::PI / 0.5) - 1.0).abs().max_element();
        assert!(off < 1e-4, "{}: {seen}", backend.name());
    }
}

/// Triangles without area in a lamp neither shine nor take light from the others.
#[test]
fn a_lamp_partly_without_area() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("lamp.obj");
    let lamp = |triangles: &str| {
        let corners = "v -9 -9 1\nv 9 -9 1\nv 9 9 1\nv -9 9 1\nv 0 0 1\n";
        std::fs::write(&file, format!("{corners}{triangles}")).unwrap();
        format!(
            r#"{}{FLOOR}<shape type="obj"><string name="filename" value="{}"/>
                <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
                <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>"#,
            camera(60.0, [0.0, -0.3, 0.9], [0.0; 3], 1.0, 0.0),
            file.display()
        )
    };
    // The form factor of a square of half side 9 at distance 1, in the middle; it hardly changes around there.
    let (a, q) = (9.0f64, 82f64.sqrt());
    let exact = 0.5 * 4.0 * 2.0 * a / q * (a / q).atan() / (2.0 * std::f64::consts::PI);
    let body = lamp("f 1 1 1\nf 4 3 2\nf 5 3 1\nf 1 4 2\nf 2 2 3\n");
    for_all("a lamp partly without area", &body, (9, 9), move |view| {
        let map = view.what.contains("map");
        let (bias, precision) = if map { (0.01, 0.06) } else { (2e-3, 0.03) };
        assert_mean(&view.means(24), exact, bias, precision, &view.what);
    });
}

/// Needles and specks among the triangles of a lit fan: they cover nothing, so the floor below is as bright as ever.
#[test]
fn slivers() {
    use std::fmt::Write;
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("slivers.obj");
    let mut obj = String::new();
    for i in 0..200 {
        let (y, x) = (i as f64 * 0.7).sin_cos();
        let thin = 10f64.powi(-(i % 40));
        let _ =
            writeln!(obj, "v 0 0 0.2\nv {x} {y} 0.2\nv {} {} 0.2", x - y * thin * 1e-4, y + x * thin * 1e-4);
        let _ = writeln!(obj, "f {} {} {}", 3 * i + 1, 3 * i + 2, 3 * i + 3);
    }
    std::fs::write(&file, obj).unwrap();
    let body = format!(
        r#"{}{FLOOR}<shape type="obj"><string name="filename" value="{}"/><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
        <emitter type="constant"><rgb name="radiance" value="1"/></emitter>"#,
        view(),
        file.display()
    );
    for_all("slivers", &body, (9, 9), |view| assert_mean(&view.means(4), 0.5, 0.01, 0.05, &view.what));
}

#[test]
fn films() {
    let body = still_life(1.0, 0.0, 1.0);
    for size in [(1, 1), (2, 1), (16384, 1), (1, 4096)] {
        for_all(&format!("film {size:?}"), &body, size, move |view| {
            let rendering = view.render(1, 2);
            assert_eq!((rendering.image.width, rendering.image.height), (size.0 as usize, size.1 as usize));
            assert!(mean(&rendering.image).min_element() > 0.0, "{}", view.what);
        });
    }
}

/// One texel of an otherwise black sky: both integrators find the irradiance of what that texel shows, bilinearly.
#[test]
fn one_texel_sun() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("sun.exr");
    let (width, height) = (512, 256);
    let mut pixels = vec![Rgb::ZERO; width * height];
    // 45° above the horizon, which the sky's y axis is at a right angle to.
    pixels[(height / 4) * width + 100] = Rgb::splat(1e5);
    let layer =
        Layer { name: String::new(), image: Image { width, height, pixels }, channels: Channels::Rgb };
    image_io::write_exr(&file, &[layer], &Metadata::default(), SampleType::Float).unwrap();
    let body = format!(
        r#"{}{FLOOR}<emitter type="envmap"><string name="filename" value="{}"/>
            <transform name="to_world"><rotate x="1" angle="90"/></transform></emitter>"#,
        view(),
        file.display()
    );
    // A tent of that height over texels on both sides; rows are narrower by sinθ.
    let (step, theta) = (std::f64::consts::PI / height as f64, (height / 4) as f64 + 0.5);
    let theta = theta * step;
    let exact = 0.5 / std::f64::consts::PI * 1e5 * step * step * theta.sin() * theta.cos();
    for_all("sun", &body, (9, 9), move |view| assert_mean(&view.means(2), exact, 5e-3, 0.03, &view.what));
}
