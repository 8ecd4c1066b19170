//! Mitsuba scenes, up to pictures of a few pixels by both integrators.
#![no_main]

use caustica::integrator::{Budget, Kind, Options, Params, State};
use libfuzzer_sys::fuzz_target;
use std::ops::ControlFlow;

fuzz_target!(init: caustica_fuzz::init(), |data: &[u8]| {
    let Some(scene) = caustica_fuzz::load(&caustica_fuzz::put("scene.xml", data), Some((4, 4))) else { return };
    for integrator in [Kind::Photonmap, Kind::Path] {
        let params = Params { global_photons: 64, caustic_photons: 64, ..Params::default() };
        let options = Options { integrator, params, seed: 0, budget: Budget::Passes(2), aovs: true };
        let mut state = State::new(&scene, &options, 0).expect("the film has pixels");
        state.render(&scene, &options, &mut |_, _| ControlFlow::Continue(()));
        state.resolve();
    }
});
