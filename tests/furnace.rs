//! White furnace: inside a closed diffuse surface of albedo ρ that emits L everywhere, radiance is L/(1−ρ) in every
//! direction. A sphere, because the cap within chord r of a point has area exactly πr²: density estimation has no
//! bias there.

mod common;

use caustica::integrator::Kind;
use common::{assert_close, backends, mean, parse, render};
use glam::Vec3;

fn furnace(albedo: f32) -> String {
    format!(
        r#"<scene version="3.0.0">
            <integrator type="path"/>
            <sensor type="perspective">
                <float name="fov" value="70"/>
                <transform name="to_world"><lookat origin="0.3, 0.2, -0.5" target="0, 0, 1" up="0, 1, 0"/></transform>
                <film type="hdrfilm"><rfilter type="box"/></film>
            </sensor>
            <shape type="sphere">
                <boolean name="flip_normals" value="true"/>
                <bsdf type="diffuse"><rgb name="reflectance" value="{albedo}"/></bsdf>
                <emitter type="area"><rgb name="radiance" value="1, 2, 0.5"/></emitter>
            </shape>
        </scene>"#
    )
}

#[test]
fn radiance_is_l_over_one_minus_albedo() {
    let emitted = Vec3::new(1.0, 2.0, 0.5);
    for backend in backends() {
        for albedo in [0.0f32, 0.5, 0.8] {
            let scene = parse(&furnace(albedo), 24, backend);
            let expected = emitted / (1.0 - albedo);
            let runs: [(Kind, &[&str], u32); 4] = [
                (Kind::Path, &[], 64),
                (Kind::Photonmap, &[], 16),
                (Kind::Photonmap, &["final_gather=false"], 16),
                (Kind::Photonmap, &["final_gather=false", "direct=map"], 16),
            ];
            for (kind, settings, passes) in runs {
                let image = render(&scene, kind, settings, passes).image;
                let what = format!("{} {kind:?} {settings:?} albedo {albedo}", backend.name());
                assert_close(mean(&image), expected, 0.01, &what);
            }
        }
    }
}
