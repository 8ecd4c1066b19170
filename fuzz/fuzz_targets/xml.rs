//! Mitsuba scenes, up to a scene that is ready to be rendered.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(init: caustica_fuzz::init(), |data: &[u8]| {
    caustica_fuzz::load(&caustica_fuzz::put("scene.xml", data), None);
});
