//! Scattering functions made of others: blends, and those about a perturbed normal.

use super::*;

pub(super) const RULES: [Perturbation; 4] = [
    Perturbation { flip_invalid: true, shadowing: true },
    Perturbation { flip_invalid: false, shadowing: false },
    Perturbation { flip_invalid: true, shadowing: false },
    Perturbation { flip_invalid: false, shadowing: true },
];

fn rough_glass() -> Bsdf<'static> {
    Bsdf::rough_dielectric(1.5, Microfacet::new(Distribution::Ggx, 0.4, 0.4), Rgb::ONE, TINT_T)
}

fn rough_metal() -> Bsdf<'static> {
    let m = Microfacet::new(Distribution::Beckmann, 0.3, 0.15);
    Bsdf::rough_conductor(METAL_ETA, METAL_K, m, Rgb::ONE)
}

fn tilted(bsdf: Bsdf<'static>, rules: Perturbation) -> Bsdf<'static> {
    bsdf.perturbed(Vec3::new(0.4, -0.2, 0.8).normalize(), Vec3::new(0.9, 0.3, 0.1), rules)
}

fn layer(rough: Option<&'static RoughCoating>) -> Layer<'static> {
    Layer { eta: PLASTIC, specular: TINT_R, absorption: Rgb::new(0.0, 0.1, 0.5), rough }
}

pub(super) fn bsdfs() -> Vec<(&'static str, Bsdf<'static>)> {
    let plastic = Bsdf::plastic(Coating::new(PLASTIC), PAINT, Rgb::ONE, false);
    let blend = Bsdf::blend(rough_glass(), Bsdf::diffuse(PAINT).two_sided(), 0.3);
    vec![
        ("blend", blend.clone()),
        ("blend of blend, mask and mirror", Bsdf::blend(blend, plastic.clone().masked(0.4), 0.6)),
        ("two-sided blend", Bsdf::blend(rough_metal(), plastic, 0.5).two_sided()),
        ("tilted diffuse", tilted(Bsdf::diffuse(PAINT), RULES[0])),
        ("tilted diffuse as in 0.6", tilted(Bsdf::diffuse(PAINT), RULES[1])),
        ("tilted metal", tilted(rough_metal(), RULES[2]).two_sided()),
        ("tilted glass", tilted(rough_glass(), RULES[3])),
        ("coated diffuse", Bsdf::diffuse(PAINT).coated(layer(None))),
        ("coated metal", rough_metal().coated(layer(None)).two_sided()),
        ("roughly coated diffuse", Bsdf::diffuse(PAINT).coated(layer(Some(&COATINGS.beckmann)))),
        ("tilted glass and a mask", Bsdf::blend(tilted(rough_glass(), RULES[0]), Bsdf::null(), 0.2)),
    ]
}

#[test]
fn blends_are_sums() {
    let (a, b) = (rough_metal(), Bsdf::diffuse(PAINT));
    let (wo, wi) = (Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.5, 0.1, 0.8).normalize());
    for weight in [0.0, 0.3, 1.0, 7.0, f32::NAN] {
        let w = if weight > 0.0 { f32::min(weight, 1.0) } else { 0.0 };
        let blend = Bsdf::blend(a.clone(), b.clone(), weight);
        for share in [Share::All, Share::BroadEye, Share::BroadLight] {
            let eval = |bsdf: &Bsdf| bsdf.eval(wo, wi, Mode::Flux, share);
            assert!((eval(&blend) - (eval(&a) * (1.0 - w) + eval(&b) * w)).length() < 1e-6, "{weight}");
        }
        assert_eq!(blend.has_rough(), w < 1.0);
        assert!(blend.has_smooth() && !blend.has_delta() && !blend.transmits());
        assert!((blend.albedo() - a.albedo().lerp(b.albedo(), w)).length() < 1e-6);
    }
}

/// A layer without a surface of its own changes nothing; others take the same from light in both directions.
#[test]
fn layers() {
    let nothing = Layer { eta: 1.0, specular: Rgb::ONE, absorption: Rgb::ZERO, rough: None };
    let bare = rough_metal();
    let coated = bare.clone().coated(nothing);
    for (wo, wi) in directions().flat_map(|wo| directions().map(move |wi| (wo, wi))) {
        let eval = |b: &Bsdf, wo, wi| b.eval(wo, wi, Mode::Radiance, Share::All);
        assert!(
            (eval(&coated, wo, wi) - eval(&bare, wo, wi)).abs().max_element()
                < 1e-4 * (1.0 + eval(&bare, wo, wi).max_element())
        );
        for rough in [None, Some(&COATINGS.ggx)] {
            let both = Bsdf::diffuse(PAINT).coated(layer(rough));
            let (there, back) = (eval(&both, wo, wi) * wo.z.abs(), eval(&both, wi, wo) * wi.z.abs());
            assert!((there - back).abs().max_element() <= 1e-4 * there.max_element(), "{wo} {wi}");
        }
    }
    for (_, bsdf) in bsdfs().into_iter().filter(|(name, _)| name.contains("coated")) {
        for wo in directions() {
            let weight = |i| {
                let (u_lobe, u, _) = random(22, i);
                bsdf.sample(wo, u_lobe, u, Mode::Flux).map_or(Rgb::ZERO, |s| s.weight)
            };
            let sum: Rgb = (0..4096).map(weight).sum();
            assert!(sum.max_element() < 4096.0 * 1.01, "{wo}: {}", sum / 4096.0);
        }
    }
}

/// A normal that is not perturbed changes nothing, but for rounding.
#[test]
fn upright_normals_change_nothing() {
    for rules in RULES {
        for bsdf in [rough_metal(), rough_glass(), Bsdf::diffuse(PAINT)] {
            let upright = bsdf.clone().perturbed(Vec3::Z, Vec3::X, rules);
            for (wo, wi) in directions().flat_map(|wo| directions().map(move |wi| (wo, wi))) {
                for mode in [Mode::Radiance, Mode::Flux] {
                    let (f, expected) =
                        (upright.eval(wo, wi, mode, Share::All), bsdf.eval(wo, wi, mode, Share::All));
                    let error = (f - expected).abs().max_element();
                    assert!(error <= 1e-4 * expected.max_element(), "{wo} {wi}: {f} {expected}");
                }
            }
        }
    }
}

/// What a photon carries from light to eye is what the eye would see, times the ratio of cosines to the shading normal.
#[test]
fn photons_carry_what_the_eye_would_see() {
    for rules in RULES {
        for (name, bsdf) in
            [("metal", rough_metal()), ("glass", rough_glass()), ("diffuse", Bsdf::diffuse(PAINT))]
        {
            let bsdf = tilted(bsdf, rules);
            let mut seen = 0;
            for i in 0..2000 {
                let (_, _, mut sampler) = random(20, i);
                let (eye, light) = (warp::sphere(sampler.next_2d()), warp::sphere(sampler.next_2d()));
                let radiance = bsdf.eval(eye, light, Mode::Radiance, Share::All);
                let flux = bsdf.eval(light, eye, Mode::Flux, Share::All);
                let expected = radiance * (eye.z / light.z).abs();
                let error = (flux - expected).abs().max_element();
                assert!(
                    error <= 2e-3 * expected.max_element() + 1e-6,
                    "{name} {eye} {light}: {flux} {expected}"
                );
                seen += (radiance != Rgb::ZERO) as u32;
            }
            assert!(seen > 300, "{name}: {seen}");
        }
    }
}

/// Sampling misses nothing that `eval` has: the mean of the samples' weights is the integral, for photons too.
#[test]
fn samples_cover_what_eval_has() {
    const N: u64 = 1 << 16;
    for (name, bsdf) in bsdfs() {
        for (wo, mode) in directions().flat_map(|wo| [(wo, Mode::Radiance), (wo, Mode::Flux)]) {
            // Stratified: the error falls faster than 1/√N.
            let (mut sampled, mut integral) = (Rgb::ZERO, Rgb::ZERO);
            for i in 0..N {
                let (u_lobe, u, mut sampler) = random(21, i);
                sampled += match bsdf.sample(wo, u_lobe, u, mode) {
                    Some(s) if !s.delta => s.weight,
                    _ => Rgb::ZERO,
                };
                let wi = warp::sphere(sampler.next_2d());
                integral += bsdf.eval(wo, wi, mode, Share::All) / warp::SPHERE_PDF_W;
            }
            let (sampled, integral) = (sampled / N as f32, integral / N as f32);
            let error = (sampled - integral).abs().max_element();
            assert!(
                error < 0.03 * integral.max_element() + 2e-3,
                "{name} {wo} {mode:?}: {sampled} {integral}"
            );
        }
    }
}

/// Eye, light, value and pdf, from Mitsuba 3.9.1's `normalmap` over a constant texture.
#[test]
fn tilted_normals_are_those_of_mitsuba() {
    type Row = (&'static str, usize, [f32; 3], [f32; 3], [f32; 3], f32);
    #[rustfmt::skip]
    let rows: [Row; 20] = [
        ("glass", 0, [0.217518, -0.918031, 0.33152], [-0.493481, -0.85806, 0.142158], [0.000292822, 0.000292822, 0.000292822], 0.00104171),
        ("glass", 0, [0.515437, -0.327245, -0.791982], [0.01857, -0.0374937, 0.999124], [0.0, 0.0, 0.0], 0.0),
        ("glass", 0, [-0.298339, 0.0873336, -0.950456], [0.374076, 0.266342, -0.888329], [0.00424565, 0.00424565, 0.00424565], 0.0044561),
        ("glass", 0, [0.0499845, -0.785449, 0.616905], [-0.86914, -0.390737, 0.303183], [0.0, 0.0, 0.0], 0.0),
        ("glass", 0, [-0.597738, 0.801596, -0.0123442], [-0.153004, -0.706213, 0.691269], [0.0, 0.0, 0.0], 0.0),
        ("glass", 1, [0.534915, 0.807721, 0.247897], [-0.491824, -0.61569, -0.615658], [0.656943, 0.985415, 0.875924], 2.61407),
        ("glass", 1, [0.655735, -0.698958, -0.28543], [-0.461432, 0.322641, 0.826428], [0.081425, 0.081425, 0.081425], 0.0927166),
        ("glass", 1, [0.325209, -0.269869, 0.906317], [-0.976833, 0.165058, -0.136212], [0.0, 0.0, 0.0], 0.0),
        ("glass", 1, [0.0757295, 0.85966, 0.505222], [0.586365, -0.799, -0.133323], [0.0, 0.0, 0.0], 0.0),
        ("glass", 1, [0.203436, -0.870314, 0.448517], [0.547971, -0.668705, -0.502554], [0.0, 0.0, 0.0], 0.0),
        ("diffuse", 0, [0.525099, 0.850991, 0.00917675], [0.878649, 0.306246, 0.366319], [0.0955999, 0.0382399, 0.01912], 0.202571),
        ("diffuse", 0, [0.60017, -0.740113, 0.303362], [-0.49416, 0.138008, 0.858347], [0.0798476, 0.0319391, 0.0159695], 0.160251),
        ("diffuse", 0, [-0.75252, 0.0925331, 0.652036], [0.0936153, 0.355698, 0.929901], [0.123145, 0.0492579, 0.0246289], 0.246665),
        ("diffuse", 0, [0.501195, -0.0109967, 0.865264], [-0.075284, -0.914469, 0.397592], [0.0779042, 0.0311617, 0.0155808], 0.16353),
        ("diffuse", 0, [-0.711878, -0.55558, 0.429604], [0.569349, 0.434734, 0.697745], [0.120157, 0.0480627, 0.0240313], 0.242762),
        ("diffuse", 1, [0.649246, 0.0258629, 0.760139], [0.629338, -0.10663, 0.769782], [0.154357, 0.0617429, 0.0308714], 0.308714),
        ("diffuse", 1, [-0.0748017, -0.110528, 0.991054], [-0.827379, 0.164758, 0.536934], [0.0113992, 0.00455969, 0.00227984], 0.0227984),
        ("diffuse", 1, [0.224258, -0.0357854, 0.973873], [0.678437, -0.463736, 0.5698], [0.142388, 0.0569553, 0.0284776], 0.284776),
        ("diffuse", 1, [0.264977, -0.509215, 0.818833], [-0.238305, -0.940023, 0.244064], [0.0500003, 0.0200001, 0.0100001], 0.100001),
        ("diffuse", 1, [0.138514, 0.987286, 0.0779744], [-0.0949046, 0.120624, 0.988151], [0.0, 0.0, 0.0], 0.0),
    ];
    for (name, rules, eye, light, f, pdf_w) in rows {
        let bsdf = match name {
            "glass" => rough_glass(),
            _ => Bsdf::diffuse(PAINT),
        };
        let bsdf = bsdf.perturbed(Vec3::new(0.4, -0.2, 0.8).normalize(), Vec3::X, RULES[rules]);
        let (eye, light) = (Vec3::from(eye), Vec3::from(light));
        let ours = bsdf.eval(eye, light, Mode::Radiance, Share::All);
        assert!(
            (ours - Rgb::from(f)).abs().max_element() < 2e-3 * f[0] + 1e-5,
            "{name} {eye} {light}: {ours} {f:?}"
        );
        // Where no light can be seen, Mitsuba has no pdf either; photons need one.
        if f != [0.0; 3] {
            let ours = bsdf.pdf_w(eye, light, Mode::Radiance);
            assert!(close(ours, pdf_w, 4e-3), "{name} {eye} {light}: pdf {ours} {pdf_w}");
        }
    }
}

/// What scatters from below when it is alone does so in others.
#[test]
fn they_scatter_below_as_what_is_in_them_does() {
    let matt = || Bsdf::diffuse(PAINT);
    let composed = |nested: Bsdf<'static>| {
        [
            tilted(nested.clone(), RULES[0]),
            Bsdf::blend(rough_metal(), nested.clone(), 0.5),
            nested.clone().coated(layer(None)),
            nested.clone().coated(layer(Some(&COATINGS.beckmann))),
            tilted(Bsdf::blend(Bsdf::null(), nested.clone().coated(layer(None)), 0.4), RULES[1]),
            nested,
        ]
    };
    let below = Vec3::new(0.1, 0.2, -0.9).normalize();
    for (both, nested) in [(false, matt()), (true, matt().two_sided())] {
        for (i, bsdf) in composed(nested).into_iter().enumerate() {
            let shines =
                directions().any(|wi| bsdf.eval(below, wi, Mode::Flux, Share::All).max_element() > 0.0);
            assert_eq!((bsdf.scatters_on(below), shines), (both, both), "{i}");
            assert!(bsdf.scatters_on(-below));
        }
    }
}
