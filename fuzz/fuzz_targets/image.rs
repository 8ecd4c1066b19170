//! Images of all formats, as textures and as environment maps.
#![no_main]

use caustica::image_io;
use caustica::light::Envmap;
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
    let bitmap = Bitmap::new(image.clone(), Interpolation::Bilinear, [Wrap::Repeat; 2], Affine2::IDENTITY);
    let texture = Texture::Bitmap(bitmap.expect("it has pixels"));
    texture.eval(&[], &Vec2::new(0.3, -0.7).into());
    if image.pixels.len() < 1 << 16 {
        let _ = Envmap::new(image, 1.0, Affine3A::IDENTITY);
    }
});
