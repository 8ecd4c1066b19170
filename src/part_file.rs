//! Part files: the sums of a range of passes, kept. A checkpoint is one, and so is what one machine of many renders.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | `CAUSPART` |
//! | 4 | version of the format |
//! | 4 | length of the header |
//! | … | the [`Header`] as JSON |
//! | 16 | XXH3-128 of all before |
//! | … | the film's sums, and what guides it ([`crate::film::Film::contents`]) |
//! | 16 | XXH3-128 of all before |
//!
//! Numbers are little-endian.

use crate::accel::Backend;
use crate::image_io::replace_file;
use crate::integrator::{Layout, Options, State, Statistics};
use crate::scene::Scene;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Write};
use std::ops::Range;
use std::path::Path;
use xxhash_rust::xxh3::Xxh3;

const MAGIC: [u8; 8] = *b"CAUSPART";

/// Goes up whenever the sums or the header change their meaning.
const FORMAT: u32 = 3;

/// Generous: a header has about 1 KiB.
const MAX_HEADER: u32 = 1 << 20;

/// Passes are numbered below this, so that sums of pass numbers never overflow.
pub const MAX_PASSES: u32 = i32::MAX as u32;

/// Enough for any render, and sums of these do not overflow.
const MAX_COUNT: u64 = 1 << 62;

/// What a pass' pixels depend on beside its number. Only passes of equal identity may be added.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Caustica's version.
    pub version: String,
    /// [`Scene::fingerprint`].
    pub scene: String,
    /// The ray backend.
    pub backend: String,
    /// The integrator.
    pub integrator: String,
    /// Its parameters by name.
    pub params: BTreeMap<String, String>,
    /// The seed.
    pub seed: u64,
    /// Full size of the film.
    pub size: (u32, u32),
    /// The film's crop window: x, y, width, height.
    pub crop: (u32, u32, u32, u32),
    /// Whether parts and auxiliary layers are kept.
    pub aovs: bool,
}

impl Identity {
    /// The identity of passes that this program renders.
    pub fn new(scene: &Scene, backend: Backend, options: &Options) -> Identity {
        let params = options.params.named().into_iter().map(|(name, value)| (name.into(), value));
        Identity {
            version: env!("CARGO_PKG_VERSION").into(),
            scene: scene.fingerprint(),
            backend: backend.name().into(),
            integrator: options.integrator.name().into(),
            params: params.collect(),
            seed: options.seed,
            size: scene.film.size,
            crop: scene.film.crop,
            aovs: options.aovs,
        }
    }

    /// How passes of this identity were rendered and those of `expected` were not, e.g. `with seed 3, not 4`.
    pub fn difference(&self, expected: &Identity) -> Option<String> {
        let differ = |what: &str, a: &str, b: &str| (a != b).then(|| format!("{what} {a}, not {b}"));
        let size = |i: &Identity| format!("{}x{}", i.size.0, i.size.1);
        let crop = |i: &Identity| format!("{:?}", i.crop);
        let param = || {
            let names = self.params.keys().chain(expected.params.keys());
            let value = |i: &Identity, name| i.params.get(name).map_or("absent", String::as_str).to_owned();
            names.into_iter().find_map(|name| {
                differ(&format!("with {name} ="), &value(self, name), &value(expected, name))
            })
        };
        differ("by caustica", &self.version, &expected.version)
            .or_else(|| differ("at size", &size(self), &size(expected)))
            .or_else(|| differ("with the crop window", &crop(self), &crop(expected)))
            .or_else(|| differ("with the integrator", &self.integrator, &expected.integrator))
            .or_else(|| differ("with the backend", &self.backend, &expected.backend))
            .or_else(|| differ("with seed", &self.seed.to_string(), &expected.seed.to_string()))
            .or_else(param)
            .or_else(|| match (self.aovs, expected.aovs) {
                (true, false) => Some("with --aovs, not without".into()),
                (false, true) => Some("without --aovs, not with".into()),
                _ => None,
            })
            .or_else(|| {
                (self.scene != expected.scene)
                    .then(|| "from another scene: its file, a file it names, or a -D differs".into())
            })
    }
}

/// What a part file says before its sums.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Header {
    /// What was rendered.
    pub identity: Identity,
    /// The scene's file as it was named, for the image's attributes.
    pub scene: String,
    first: u32,
    /// Passes in each half of the film.
    passes: [u32; 2],
    layout: Layout,
    statistics: Statistics,
}

impl Header {
    /// The passes whose sums follow.
    pub fn range(&self) -> Range<u32> {
        self.first..self.first + self.passes[0] + self.passes[1]
    }

    fn is_sound(&self) -> bool {
        let end = self.passes.iter().try_fold(self.first, |sum, &n| sum.checked_add(n));
        let (.., width, height) = self.identity.crop;
        let Statistics { rays, photons, .. } = &self.statistics;
        let counts = [*rays, photons.emitted, photons.global_stored, photons.caustic_stored];
        end.is_some_and(|end| self.first < end && end <= MAX_PASSES)
            && self.layout.size == (width, height)
            && self.layout.aovs == self.identity.aovs
            && width > 0
            && height > 0
            && counts.iter().all(|&n| n <= MAX_COUNT)
    }
}

/// Writes passes to `path`, whose old content is replaced by all of the new or stays. `scene` is the scene's name to
/// keep.
///
/// # Errors
/// [`Error::Runtime`] if it cannot be written.
pub fn write(path: &Path, identity: &Identity, scene: &str, state: &State) -> Result<()> {
    let (passes, contents) = state.film().contents();
    let header = Header {
        identity: identity.clone(),
        scene: scene.into(),
        first: state.range().start,
        passes,
        layout: state.layout(),
        statistics: state.statistics.clone(),
    };
    replace_file(path, |w| {
        let json = serde_json::to_vec(&header)?;
        let mut hasher = Xxh3::new();
        let mut put = |bytes: &[u8], hasher: &mut Xxh3| {
            hasher.update(bytes);
            w.write_all(bytes)
        };
        put(&MAGIC, &mut hasher)?;
        put(&FORMAT.to_le_bytes(), &mut hasher)?;
        put(&(json.len() as u32).to_le_bytes(), &mut hasher)?;
        put(&json, &mut hasher)?;
        put(&hasher.digest128().to_le_bytes(), &mut hasher)?;
        for (bytes, width) in contents {
            if cfg!(target_endian = "little") {
                put(bytes, &mut hasher)?;
            } else {
                for bytes in bytes.chunks(1 << 16) {
                    let mut bytes = bytes.to_vec();
                    swap_if_big_endian(&mut bytes, width);
                    put(&bytes, &mut hasher)?;
                }
            }
        }
        put(&hasher.digest128().to_le_bytes(), &mut hasher)
    })
}

/// Whether a file is one, of whatever format, cut short or not.
pub fn is_part(path: &Path) -> bool {
    let mut magic = [0; MAGIC.len()];
    File::open(path).is_ok_and(|mut file| file.read_exact(&mut magic).is_ok()) && magic == MAGIC
}

/// Reads the header only.
///
/// # Errors
/// [`Error::File`] if the file is missing, no part, or damaged as far as it was read.
pub fn read_header(path: &Path) -> Result<Header> {
    read_with(path, |reader| reader.header())
}

/// Reads a part.
///
/// # Errors
/// [`Error::File`] if the file is missing, no part, or damaged.
pub fn read(path: &Path) -> Result<(Header, State)> {
    read_with(path, |reader| {
        let header = reader.header()?;
        // Of the length checked against the file's, so this is no more memory than there are bytes to fill it.
        let mut state = State::empty(header.layout, header.first);
        state.statistics = header.statistics.clone();
        let (passes, contents) = state.film_mut().contents_mut();
        *passes = header.passes;
        for (bytes, width) in contents {
            reader.fill(bytes)?;
            swap_if_big_endian(bytes, width);
        }
        reader.check_sum()?;
        Ok((header, state))
    })
}

/// Of numbers so many bytes wide.
fn swap_if_big_endian(bytes: &mut [u8], width: usize) {
    if cfg!(target_endian = "big") {
        bytes.chunks_exact_mut(width).for_each(<[u8]>::reverse);
    }
}

fn read_with<T>(path: &Path, read: impl FnOnce(&mut Reader) -> Result<T, String>) -> Result<T> {
    let open = || -> io::Result<Reader> {
        let file = File::open(path)?;
        let metadata = file.metadata()?;
        if !metadata.is_file() {
            return Err(io::Error::other("it is no regular file"));
        }
        Ok(Reader { file, length: metadata.len(), hasher: Xxh3::new() })
    };
    let fail = |message| Error::File { file: path.into(), message };
    let mut reader = open().map_err(|e| match e.kind() {
        io::ErrorKind::NotFound => fail("no such file".into()),
        _ => fail(format!("cannot be read: {e}")),
    })?;
    read(&mut reader).map_err(fail)
}

struct Reader {
    file: File,
    length: u64,
    hasher: Xxh3,
}

impl Reader {
    fn fill(&mut self, bytes: &mut [u8]) -> Result<(), String> {
        // In pieces that are still in the cache when they are hashed.
        for bytes in bytes.chunks_mut(1 << 18) {
            self.file.read_exact(bytes).map_err(|e| match e.kind() {
                io::ErrorKind::UnexpectedEof => CUT.to_string(),
                _ => format!("cannot be read: {e}"),
            })?;
            self.hasher.update(bytes);
        }
        Ok(())
    }

    fn number(&mut self) -> Result<u32, String> {
        let mut bytes = [0; 4];
        self.fill(&mut bytes)?;
        Ok(u32::from_le_bytes(bytes))
    }

    fn check_sum(&mut self) -> Result<(), String> {
        let sum = self.hasher.digest128().to_le_bytes();
        let mut kept = [0; 16];
        self.fill(&mut kept)?;
        if sum == kept { Ok(()) } else { Err(DAMAGED.into()) }
    }

    fn header(&mut self) -> Result<Header, String> {
        let mut magic = [0; MAGIC.len()];
        self.fill(&mut magic).map_err(|_| NO_PART)?;
        if magic != MAGIC {
            return Err(NO_PART.into());
        }
        let format = self.number()?;
        if format != FORMAT {
            return Err(format!(
                "is a part file of format {format}, but this caustica reads format {FORMAT}; use the caustica that wrote it"
            ));
        }
        let length = self.number()?;
        if length > MAX_HEADER {
            return Err(DAMAGED.into());
        }
        let mut json = vec![0; length as usize];
        self.fill(&mut json)?;
        self.check_sum()?;
        let header: Header = serde_json::from_slice(&json).map_err(|_| DAMAGED)?;
        if !header.is_sound() {
            return Err(DAMAGED.into());
        }
        let before = MAGIC.len() as u64 + 8 + u64::from(length) + 16;
        match self.length.cmp(&header.layout.bytes().saturating_add(before + 16)) {
            std::cmp::Ordering::Less => Err(CUT.into()),
            std::cmp::Ordering::Equal => Ok(header),
            std::cmp::Ordering::Greater => Err(DAMAGED.into()),
        }
    }
}

const NO_PART: &str =
    "is no part file; parts are written by 'caustica render' with --checkpoint or --pass-range";
const CUT: &str = "is cut short; use an older copy, or render it again";
const DAMAGED: &str = "is damaged (its checksum is wrong); use an older copy, or render it again";
