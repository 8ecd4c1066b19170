//! What neighbouring pixels tell about each other: local regression of the albedo-free picture on where a pixel is, to
//! second order so that light that curves over the window is not flattened, and to first on what it sees (after Bitterli
//! et al. 2016, "Nonlinearly Weighted First-order Regression for Denoising Monte Carlo Renderings").
//!
//! Weights compare patches of the picture in units of its noise (non-local means, Buades et al. 2005; variances as in
//! Rousselle et al. 2012), so pixels lend to each other only what noise cannot tell apart: the bandwidth shrinks as passes
//! add up, and edges and shadows stay. The weights for one half of the passes come from the other, so that noise does not
//! choose itself. The features of each half are as noisy as its picture, by the same camera samples; predicting at the
//! features' precise means takes the noise of the pixel's own edges out, too.

use rayon::prelude::*;

/// Half the width of the window that lends, pixels.
const R: usize = 7;
/// Features beside position on the film.
pub(super) const FEATURES: usize = 6;
/// Terms of place on the film, up to the second order.
const PLACE: usize = 5;
/// Unknowns: place on the film, features, and last the constant.
const K: usize = PLACE + FEATURES + 1;
/// Entries of the normal equations: the lower triangle, and right-hand sides.
const ENTRIES: usize = K * (K + 1) / 2 + 3 * K;
/// Tiles are so wide and high: their weights stay in the second-level cache, the sums of a row in the first.
const TILE: [usize; 2] = [64, 8];
/// Pixels whose equations are solved at a time.
const LANES: usize = 8;
/// Pixels around a tile that are read: window and patch.
const PAD: usize = R + 1;
/// Keeps slopes near zero that nothing in the picture determines. A pixel weighs 1 at most.
const RIDGE: f64 = 1e-3;

/// The least share of itself that an unknown's pivot may be left with: what is less is rounding, for 225 products were added in
/// f32, and a root of it would blow up all that follow.
const DETERMINED: f64 = 2e-5;

/// Features that differ more do not tell more: slopes must not outweigh the constant where little is known of either.
const FAR: f32 = 2.0;

/// Variance that counts as none.
const NO_NOISE: f32 = 1e-6;

/// One half of the passes at a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Input {
    /// Radiance over albedo, of a mean between 0.5 and 10 or so.
    pub(super) value: [f32; 3],
    /// Features less their precise values have a scale of about 1.
    pub(super) features: [f32; FEATURES],
}

/// Planes of numbers, each padded by [`PAD`] on the left and top and by as much and a tile on the right and bottom.
struct Planes {
    stride: usize,
    size: usize,
    data: Vec<f32>,
}

impl Planes {
    fn new<const N: usize>((width, height): (usize, usize), value: impl Fn(usize) -> [f32; N]) -> Planes {
        let (stride, rows) = (width + 2 * PAD + TILE[0], height + 2 * PAD + TILE[1]);
        let size = stride * rows;
        let mut data = vec![0.0; N * size];
        for row in 0..rows {
            let y = row.saturating_sub(PAD).min(height - 1);
            for column in 0..stride {
                let x = column.saturating_sub(PAD).min(width - 1);
                for (plane, v) in value(y * width + x).into_iter().enumerate() {
                    data[plane * size + row * stride + column] = v;
                }
            }
        }
        Planes { stride, size, data }
    }

    /// `N` numbers from the pixel (x, y) rightwards; both may be -PAD.
    fn row<const N: usize>(&self, plane: usize, x: isize, y: isize) -> &[f32; N] {
        let pad = PAD as isize;
        let at = plane * self.size + (y + pad) as usize * self.stride + (x + pad) as usize;
        self.data[at..].first_chunk().unwrap_or(&[0.0; N])
    }
}

/// What one half tells the regression.
struct Half {
    value: Planes,
    features: Planes,
}

/// Smooths both halves of a picture of `size` (columns, rows). `variance` is that of one half at each pixel, `precise` the
/// features' precise values; both and the features are finite. Values that are not count as black.
pub(super) fn smooth(
    size: (usize, usize),
    inputs: &[[Input; 2]],
    variance: &[[f32; 3]],
    precise: &[[f32; FEATURES]],
) -> Vec<[[f32; 3]; 2]> {
    let (width, height) = size;
    let sound = |i: usize| {
        let finite = |v: &[f32]| v.iter().all(|v| v.is_finite());
        inputs[i].iter().all(|half| finite(&half.value))
    };
    let sounds: Vec<bool> = (0..width * height).map(sound).collect();
    let halves = [0, 1].map(|h| Half {
        value: Planes::new(size, |i| if sounds[i] { inputs[i][h].value } else { [0.0; 3] }),
        features: Planes::new(size, |i| inputs[i][h].features),
    });
    let variance = Planes::new(size, |i| variance[i]);
    let precise = Planes::new(size, |i| precise[i]);
    let tiles_x = width.div_ceil(TILE[0]);
    let tiles = tiles_x * height.div_ceil(TILE[1]);
    let smoothed: Vec<[Tile; 2]> = (0..tiles)
        .into_par_iter()
        .with_max_len(1)
        .map(|tile| {
            let corner = [(tile % tiles_x) * TILE[0], (tile / tiles_x) * TILE[1]];
            [0, 1].map(|h| {
                let (own, other) = (&halves[h], &halves[1 - h]);
                let (variance, precise) = (&variance, &precise);
                smooth_tile(corner, &Sources { size, own, guide: &other.value, variance, precise })
            })
        })
        .collect();
    let pixel = |i: usize| {
        let (x, y) = (i % width, i / width);
        let tile = &smoothed[(y / TILE[1]) * tiles_x + x / TILE[0]];
        [0, 1].map(|h| tile[h][(y % TILE[1]) * TILE[0] + x % TILE[0]])
    };
    (0..width * height).map(pixel).collect()
}

type Tile = Vec<[f32; 3]>;

/// What one half of a picture is smoothed from.
struct Sources<'a> {
    /// Columns and rows.
    size: (usize, usize),
    own: &'a Half,
    /// The values of the other half, which choose the weights.
    guide: &'a Planes,
    variance: &'a Planes,
    precise: &'a Planes,
}

/// With AVX2 where the CPU has it: the same operations, more at a time, 1.8 times as fast.
#[allow(unsafe_code)]
fn smooth_tile(corner: [usize; 2], sources: &Sources) -> Tile {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        #[target_feature(enable = "avx2")]
        unsafe fn compiled(corner: [usize; 2], sources: &Sources) -> Tile {
            smooth_tile_plainly(corner, sources)
        }
        // SAFETY: the CPU has AVX2, as was asked just above.
        return unsafe { compiled(corner, sources) };
    }
    smooth_tile_plainly(corner, sources)
}

#[inline(always)]
fn smooth_tile_plainly([x0, y0]: [usize; 2], sources: &Sources) -> Tile {
    let &Sources { size: (width, height), own, guide, variance, precise } = sources;
    const N: usize = TILE[0];
    const WIDE: usize = N + 2;
    let r = R as isize;
    let offsets = || (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| (dx, dy)));

    // The pixels of a row that lie on the film, as their neighbours do.
    let columns = (width - x0).min(N) as isize;
    let within = |dx: isize| {
        let first = (-(x0 as isize + dx)).clamp(0, columns);
        let end = (width as isize - (x0 as isize + dx)).clamp(first, columns);
        first as usize..end as usize
    };
    let rows = (height - y0).min(TILE[1]);
    let (x0, y0) = (x0 as isize, y0 as isize);

    // All weights first, so that the sums of a row can stay in the first-level cache.
    let mut weights = vec![[[0.0f32; N]; TILE[1]]; (2 * R + 1) * (2 * R + 1)];
    let mut distances = [[0.0f32; WIDE]; TILE[1] + 2];
    for ((dx, dy), weights) in offsets().zip(&mut weights) {
        for (j, row) in distances.iter_mut().enumerate() {
            *row = [0.0; WIDE];
            let y = y0 + j as isize - 1;
            for channel in 0..3 {
                let g: &[f32; WIDE] = guide.row(channel, x0 - 1, y);
                let h: &[f32; WIDE] = guide.row(channel, x0 - 1 + dx, y + dy);
                let v: &[f32; WIDE] = variance.row(channel, x0 - 1, y);
                let u: &[f32; WIDE] = variance.row(channel, x0 - 1 + dx, y + dy);
                for i in 0..WIDE {
                    let d = g[i] - h[i];
                    row[i] += (d * d - (v[i] + v[i].min(u[i]))) / (NO_NOISE + v[i] + u[i]);
                }
            }
        }
        let within = within(dx);
        for (j, w) in weights[..rows].iter_mut().enumerate() {
            if !(0..height as isize).contains(&(y0 + j as isize + dy)) {
                continue;
            }
            let (a, b, c) = (&distances[j], &distances[j + 1], &distances[j + 2]);
            for i in 0..N {
                let patch = |row: &[f32; WIDE]| row[i] + row[i + 1] + row[i + 2];
                let d = (patch(a) + patch(b) + patch(c)) * (1.0 / 27.0);
                // exp(−d), nearly, and zero from 4 on.
                let s = (1.0 - 0.25 * d.max(0.0)).max(0.0);
                w[i] = (s * s) * (s * s);
            }
            w[..within.start].fill(0.0);
            w[within.end..].fill(0.0);
        }
    }

    let mut smoothed = Vec::with_capacity(N * rows);
    for j in 0..rows {
        let y = y0 + j as isize;
        let mut sums = [[0.0f32; N]; ENTRIES];
        for ((dx, dy), weights) in offsets().zip(&weights) {
            let w = &weights[j];
            if *w == [0.0; N] {
                continue;
            }
            let within = within(dx);
            let mut x = [[1.0f32; N]; K];
            let (u, v) = (dx as f32 / R as f32, dy as f32 / R as f32);
            for (x, place) in x.iter_mut().zip([u, v, u * u, u * v, v * v]) {
                *x = [place; N];
            }
            for f in 0..FEATURES {
                let q: &[f32; N] = own.features.row(f, x0 + dx, y + dy);
                let p: &[f32; N] = precise.row(f, x0, y);
                for i in 0..N {
                    x[PLACE + f][i] = (q[i] - p[i]).clamp(-FAR, FAR);
                }
            }
            let values: [&[f32; N]; 3] =
                std::array::from_fn(|channel| own.value.row(channel, x0 + dx, y + dy));
            let mut entry = 0;
            for k in 0..K {
                let mut wx = [0.0f32; N];
                for i in 0..N {
                    wx[i] = w[i] * x[k][i];
                }
                for other in x[..=k].iter().chain(values) {
                    let sum = &mut sums[entry][within.clone()];
                    add_product(sum, &wx[within.clone()], &other[within.clone()]);
                    entry += 1;
                }
            }
        }
        for first in (0..N).step_by(LANES) {
            smoothed.extend(constants(&sums, first));
        }
    }
    smoothed
}

/// Over slices: a loop of fixed length would be unrolled, and then not vectorised.
#[inline(always)]
fn add_product(sum: &mut [f32], a: &[f32], b: &[f32]) {
    for ((sum, a), b) in sum.iter_mut().zip(a).zip(b) {
        *sum += a * b;
    }
}

/// The constants of the regressions at [`LANES`] pixels: by Cholesky decomposition, where the last unknown is known first.
/// Slopes that nothing determines are zero; a constant that the slopes cannot be told from is the weighted mean.
#[inline(always)]
fn constants(sums: &[[f32; TILE[0]]; ENTRIES], first: usize) -> [[f32; 3]; LANES] {
    // In f64: the constant's pivot is a small difference where one pixel is all there is.
    type Lanes = [f64; LANES];
    let mut l = [[[0.0; LANES]; K]; K];
    let mut z = [[[0.0; LANES]; 3]; K];
    let mut entries =
        sums.iter().map(|sums| -> Lanes { std::array::from_fn(|i| f64::from(sums[first + i])) });
    let (mut weight, mut means) = ([0.0; LANES], [[0.0; LANES]; 3]);
    let mut next = || entries.next().unwrap_or([0.0; LANES]);
    let subtract = |s: &mut Lanes, a: &Lanes, b: &Lanes| {
        for ((s, a), b) in s.iter_mut().zip(a).zip(b) {
            *s -= a * b;
        }
    };
    for k in 0..K {
        for j in 0..=k {
            let mut s = next();
            let whole = s;
            for (a, b) in l[k][..j].iter().zip(&l[j]) {
                subtract(&mut s, a, b);
            }
            weight = whole;
            let ridge = if k + 1 < K { RIDGE } else { 0.0 };
            l[k][j] = match j == k {
                true => std::array::from_fn(|i| {
                    let (pivot, whole) = (s[i] + ridge, whole[i] + ridge);
                    // A division by infinity leaves nothing.
                    if pivot > DETERMINED * whole { pivot.sqrt() } else { f64::INFINITY }
                }),
                false => std::array::from_fn(|i| s[i] / l[j][j][i]),
            };
        }
        let (known, rest) = z.split_at_mut(k);
        for (channel, z) in rest[0].iter_mut().enumerate() {
            let mut s = next();
            means[channel] = s;
            for (z, l) in known.iter().zip(&l[k]) {
                subtract(&mut s, &z[channel], l);
            }
            *z = std::array::from_fn(|i| s[i] / l[k][k][i]);
        }
    }
    let (z, l) = (&z[K - 1], &l[K - 1][K - 1]);
    std::array::from_fn(|i| {
        [0, 1, 2].map(|channel| {
            let constant = match l[i].is_finite() {
                true => z[channel][i] / l[i],
                false => means[channel][i] / weight[i],
            };
            constant.max(0.0) as f32
        })
    })
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::math::{Sampler, Stream};

    /// Features that repeat each other leave pivots that are rounding; what is smoothed stays within what was there.
    #[test]
    fn features_that_say_the_same_do_not_blow_up() {
        let size = (40, 24);
        for seed in 0..20 {
            let random = |i: usize, n: u64| Sampler::new(seed, Stream::Eye, n, i as u64).next_1d();
            let input = |i: usize, half: u64| {
                let f = 3.0 * random(i, 10 + half);
                let value = [0, 1, 2].map(|c| 0.5 + random(i, 3 * half + c));
                Input { value, features: [f, f, -f, 2.0 * f, f, -1.5 * f] }
            };
            let inputs: Vec<[Input; 2]> = (0..size.0 * size.1).map(|i| [0, 1].map(|h| input(i, h))).collect();
            let variance = vec![[0.1; 3]; inputs.len()];
            let precise = vec![[2.9; FEATURES]; inputs.len()];
            let smoothed = smooth(size, &inputs, &variance, &precise);
            let worst = smoothed.iter().flatten().flatten().fold(0.0, |a: f32, &v| a.max(v));
            assert!(worst < 20.0 && smoothed.iter().flatten().flatten().all(|v| v.is_finite()), "{worst}");
        }
    }

    /// Wider registers change no bit.
    #[test]
    fn avx2_does_as_plain_code_does() {
        let size = (TILE[0] + 3, TILE[1] + 2);
        let random = |plane: u64| {
            move |i: usize| -> [f32; FEATURES] {
                let mut sampler = Sampler::new(1, Stream::Eye, plane, i as u64);
                std::array::from_fn(|_| sampler.next_1d())
            }
        };
        let three = |plane: u64| move |i: usize| -> [f32; 3] { std::array::from_fn(|c| random(plane)(i)[c]) };
        let own = Half { value: Planes::new(size, three(0)), features: Planes::new(size, random(1)) };
        let (guide, variance) = (Planes::new(size, three(2)), Planes::new(size, three(3)));
        let precise = Planes::new(size, random(4));
        let sources = Sources { size, own: &own, guide: &guide, variance: &variance, precise: &precise };
        for corner in [[0, 0], [TILE[0], TILE[1]]] {
            let (fast, plain) = (smooth_tile(corner, &sources), smooth_tile_plainly(corner, &sources));
            assert!(fast.iter().flatten().any(|&v| v > 0.0));
            assert_eq!(bytemuck::cast_slice::<_, u32>(&fast), bytemuck::cast_slice::<_, u32>(&plain));
        }
    }
}
