//! Samples that far outshine all around them and that one half of the passes alone has seen. In a regression one of
//! them pulls all others of its window down, some below zero. What they have too much is taken out before it, and
//! given to more pixels of like brightness and orientation after it, so that no light is lost.

use super::regression::{FEATURES, Input};
use rayon::prelude::*;

/// Half the width of the window whose brightness a pixel is held against.
const AROUND: usize = 2;
/// How many times brighter than its surroundings, and than the other half there, a pixel may be. (measured,
/// living-room and classroom, relmse after 4 and 16 passes: .070 .023 .059 .036 without it; .070 .0194 .055 .0334 with
/// 4; .062 .0200 .050 .0343 with 8; .062 .0213 .052 .0349 with 16; .084 .0207 .067 .0327 with 2.5)
const MOST: [f32; 2] = [8.0, 2.0];
/// Half the width of the window that shares the excess.
const SHARERS: usize = 12;
/// Standard deviations of those that share: in pixels, and in the logarithm of brightness.
const SPREAD: f32 = 6.0;
const CONTRAST: f32 = 0.5;
/// Of the squared differences between normals, as they are scaled in features.
const TURNED: f32 = 1.0;

/// What a half of a pixel has too much.
pub(super) struct Excess {
    pixel: usize,
    half: usize,
    value: [f32; 3],
}

fn brightness(value: &[f32; 3]) -> f32 {
    value.iter().sum::<f32>() / 3.0
}

/// The pixels of the window around `pixel`, half so wide, of an image of such `width`, as far as it has any.
fn window(pixel: usize, half: usize, width: usize, height: usize) -> impl Iterator<Item = (usize, f32)> {
    let (x, y) = (pixel % width, pixel / width);
    let range = move |i: usize, n: usize| i.saturating_sub(half)..(i + half + 1).min(n);
    range(y, height).flat_map(move |v| {
        range(x, width).map(move |u| (v * width + u, (u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2)) as f32))
    })
}

/// Takes out of `inputs`, row by row, what outshines its surroundings.
pub(super) fn take(width: usize, inputs: &mut [[Input; 2]]) -> Vec<Excess> {
    let height = inputs.len() / width.max(1);
    // Of both halves the darker: it has not seen what the other one has by chance.
    let sure: Vec<f32> = inputs
        .iter()
        .map(|halves| {
            let [a, b] = [0, 1].map(|h| brightness(&halves[h].value));
            if a.is_finite() && b.is_finite() { a.min(b).max(0.0) } else { 0.0 }
        })
        .collect();
    let limit = |pixel: usize| {
        let (mut sum, mut count) = (0.0, 0.0);
        for (other, _) in window(pixel, AROUND, width, height) {
            (sum, count) = (sum + sure[other], count + 1.0);
        }
        (MOST[0] * sum / count).max(MOST[1] * sure[pixel])
    };
    let taken = inputs.par_iter_mut().enumerate().flat_map_iter(|(pixel, halves)| {
        // Most are as bright in both halves, and need no look around.
        let brightest = halves.iter().map(|input| brightness(&input.value)).fold(0.0, f32::max);
        let limit = if brightest > MOST[1] * sure[pixel] { limit(pixel) } else { f32::INFINITY };
        halves.iter_mut().enumerate().filter_map(move |(half, input)| {
            let bright = brightness(&input.value);
            // False for NaN.
            (bright > limit && bright.is_finite()).then(|| {
                let keep = limit / bright;
                let value = input.value.map(|v| v * (1.0 - keep));
                input.value = input.value.map(|v| v * keep);
                Excess { pixel, half, value }
            })
        })
    });
    taken.collect()
}

/// What each half of each pixel is given of the `excess` of those around that look like it in `smooth` and in their
/// `features`.
pub(super) fn given(
    width: usize,
    excess: &[Excess],
    features: &[[f32; FEATURES]],
    smooth: &[[[f32; 3]; 2]],
) -> Vec<[[f32; 3]; 2]> {
    let mut given = vec![[[0.0; 3]; 2]; smooth.len()];
    let height = smooth.len() / width.max(1);
    let level = |pixel: usize| {
        let [a, b] = [0, 1].map(|h| brightness(&smooth[pixel][h]));
        (0.5 * (a + b)).max(1e-4).ln()
    };
    let levels: Vec<f32> = (0..smooth.len()).map(level).collect();
    let share = |excess: &Excess| -> Vec<(usize, f32)> {
        let own = excess.pixel;
        let like = |(other, d2): (usize, f32)| {
            let contrast = (levels[other] - levels[own]) / CONTRAST;
            let turned: f32 = (0..3).map(|i| (features[other][i] - features[own][i]).powi(2)).sum();
            let weight = (-0.5 * (d2 / (SPREAD * SPREAD) + contrast * contrast + turned / TURNED)).exp();
            (other, if weight.is_finite() { weight } else { 0.0 })
        };
        window(own, SHARERS, width, height).map(like).collect()
    };
    // In parallel what takes long, in order what must not depend on the threads.
    const AT_ONCE: usize = 1 << 12;
    for some in excess.chunks(AT_ONCE) {
        let shares: Vec<_> = some.par_iter().map(share).collect();
        for (excess, shares) in some.iter().zip(shares) {
            let sum: f32 = shares.iter().map(|(_, weight)| weight).sum();
            for (other, weight) in shares {
                let value = &mut given[other][excess.half];
                // The pixel itself always counts.
                value.iter_mut().zip(excess.value).for_each(|(v, e)| *v += e * (weight / sum));
            }
        }
    }
    given
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 40;

    fn flat(value: f32) -> Vec<[Input; 2]> {
        vec![[Input { value: [value; 3], features: [0.0; FEATURES] }; 2]; WIDTH * 30]
    }

    fn total(values: impl Iterator<Item = f32>) -> f64 {
        values.map(f64::from).sum()
    }

    #[test]
    fn what_one_half_saw_is_shared_and_not_lost() {
        let mut inputs = flat(1.0);
        inputs[15 * WIDTH + 20][0].value = [500.0, 100.0, 0.0];
        let before = total(inputs.iter().map(|halves| halves[0].value[0]));
        let excess = take(WIDTH, &mut inputs);
        assert_eq!(excess.len(), 1);
        let smooth: Vec<_> = inputs.iter().map(|halves| halves.map(|half| half.value)).collect();
        assert!(smooth.iter().flatten().all(|value| brightness(value) < 1.01 * MOST[0]));
        let given = given(WIDTH, &excess, &vec![[0.0; FEATURES]; inputs.len()], &smooth);
        let after = total(smooth.iter().chain(&given).map(|halves| halves[0][0]));
        assert!((after / before - 1.0).abs() < 1e-5, "{before} {after}");
        assert!(given.iter().all(|halves| halves[1] == [0.0; 3]));
    }

    /// Glints that both halves see stay, and so does what is no number.
    #[test]
    fn what_both_saw_stays() {
        let mut inputs = flat(1.0);
        inputs[15 * WIDTH + 20].iter_mut().for_each(|half| half.value = [500.0; 3]);
        inputs[3].iter_mut().for_each(|half| half.value = [f32::NAN; 3]);
        assert!(take(WIDTH, &mut inputs).is_empty());
    }

    #[test]
    fn light_stays_on_its_side_of_an_edge() {
        let mut inputs = flat(0.01);
        for (i, halves) in inputs.iter_mut().enumerate() {
            if i % WIDTH >= 20 {
                halves.iter_mut().for_each(|half| half.value = [10.0; 3]);
            }
        }
        inputs[15 * WIDTH + 20][1].value = [1000.0; 3];
        let excess = take(WIDTH, &mut inputs);
        let smooth: Vec<_> = inputs.iter().map(|halves| halves.map(|half| half.value)).collect();
        let given = given(WIDTH, &excess, &vec![[0.0; FEATURES]; inputs.len()], &smooth);
        assert!(excess.len() == 1 && given[15 * WIDTH + 19][1][0] < 1e-4);
    }
}
