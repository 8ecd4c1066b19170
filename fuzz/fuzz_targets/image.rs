//! Images of all formats, as textures and as environment maps.
#![no_main]

use caustica::image_io::{self, Domain};
use caustica::light::Envmap;
use caustica::math::Rgb;
use caustica::texture::{Bitmap, Interpolation, Texture, Wrap};
use glam::{Affine2, Affine3A, Vec2};
use libfuzzer_sys::fuzz_target;

fn init() {
    caustica_fuzz::init();
    // Panics that the library catches are none of ours. Those that it does not catch end the process even so.
    std::panic::set_hook(Box::new(|_| {}));
}

fuzz_target!(init: init(), |data: &[u8]| {
    // TGA alone is known by its name, all others by how they begin.
    let path = caustica_fuzz::put("image.tga", data);
    let Some(image) = caustica_fuzz::check(image_io::read(&path)) else { return };
    assert_eq!(image.pixels.len(), image.width * image.height);
    let [finite, positive] =
        [Domain::Finite, Domain::NonNegative].map(|domain| image.check(domain, Rgb::ONE).is_ok());
    assert!(finite || !positive);
    let bitmap = Bitmap::new(image.clone(), Interpolation::Bilinear, [Wrap::Repeat; 2], Affine2::IDENTITY);
    let texture = Texture::Bitmap(bitmap.expect("it has pixels"));
    let value = texture.eval(&[], &Vec2::new(0.3, -0.7).into());
    assert!(!positive || value.min_element() >= 0.0);
    if image.pixels.len() < 1 << 16 {
        assert!(positive || Envmap::new(image, 1.0, Affine3A::IDENTITY).is_err());
    }
});
