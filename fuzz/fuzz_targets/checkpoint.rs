//! Part files: as they are, or put together here of a header and sums, as the fuzzer cannot make checksums.
#![no_main]

use caustica::image_io::MAX_PIXELS;
use caustica::integrator::Layout;
use caustica::part_file;
use libfuzzer_sys::fuzz_target;
use xxhash_rust::xxh3::xxh3_128;

const MAGIC: &[u8] = b"CAUSPART";

/// Of the header as JSON, a zero, and sums that are repeated or cut as the header wants.
fn part(data: &[u8]) -> Vec<u8> {
    let end = data.iter().position(|&b| b == 0).unwrap_or(data.len());
    let (json, sums) = (&data[..end], data.get(end + 1..).unwrap_or(&[]));
    let mut file = [MAGIC, &1u32.to_le_bytes(), &(json.len() as u32).to_le_bytes(), json].concat();
    file.extend(xxh3_128(&file).to_le_bytes());
    let layout = serde_json::from_slice::<serde_json::Value>(json)
        .ok()
        .and_then(|header| serde_json::from_value::<Layout>(header.get("layout")?.clone()).ok());
    let length = layout.map_or(0, |layout| layout.bytes()).min(1 << 16) as usize;
    if sums.is_empty() {
        file.resize(file.len() + length, 0);
    } else {
        file.extend(sums.iter().cycle().take(length));
    }
    file.extend(xxh3_128(&file).to_le_bytes());
    file
}

fuzz_target!(init: caustica_fuzz::init(), |data: &[u8]| {
    let file = if data.starts_with(MAGIC) { data } else { &part(data) };
    let path = caustica_fuzz::put("scene.part", file);
    let Some((header, mut state)) = caustica_fuzz::check(part_file::read(&path)) else { return };
    assert_eq!(header.range(), state.range());
    assert!(state.film().contents().1.len() <= file.len());
    let rendering = state.resolve();
    assert!((rendering.image.pixels.len() as u64) <= MAX_PIXELS);
    assert_eq!(header.identity.difference(&header.identity), None);
    // Never its own successor.
    assert!(state.merge(&state.clone()).is_err());
});
