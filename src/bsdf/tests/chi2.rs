//! Pearson's χ² test of `sample` against `pdf_w`: histogram of directions in (cosθ, φ) against the integral of the
//! pdf over each cell. Samples that are no smooth direction make one more cell.

use super::*;
use std::f64::consts::TAU;

const COS_CELLS: usize = 16;
const PHI_CELLS: usize = 24;
const SAMPLES: u64 = 100_000;
/// Of one wrong alarm among all tests together, which Šidák's correction distributes over them.
const LEVEL: f64 = 0.01;

/// Three-point Gauss–Legendre on [0, 1].
const NODES: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// A rectangle of (cosθ, φ): area is solid angle.
#[derive(Clone, Copy)]
struct Cell {
    cos: f64,
    phi: f64,
    d_cos: f64,
    d_phi: f64,
}

impl Cell {
    fn quarters(self) -> [Cell; 4] {
        let (d_cos, d_phi) = (self.d_cos / 2.0, self.d_phi / 2.0);
        let quarter =
            |i: f64, j: f64| Cell { cos: self.cos + i * d_cos, phi: self.phi + j * d_phi, d_cos, d_phi };
        [quarter(0.0, 0.0), quarter(0.0, 1.0), quarter(1.0, 0.0), quarter(1.0, 1.0)]
    }

    fn gauss(self, pdf_w: &impl Fn(Vec3) -> f32) -> f64 {
        let mut sum = 0.0;
        for (x, a) in NODES {
            for (y, b) in NODES {
                let cos = self.cos + x * self.d_cos;
                let (sin_phi, cos_phi) = (self.phi + y * self.d_phi).sin_cos();
                let sin = (1.0 - cos * cos).sqrt();
                let w = Vec3::new((sin * cos_phi) as f32, (sin * sin_phi) as f32, cos as f32);
                sum += a * b * pdf_w(w) as f64;
            }
        }
        sum * self.d_cos * self.d_phi
    }

    /// Adaptive; the first `depth` levels are always divided lest a peak between the nodes be missed.
    fn integrate(self, pdf_w: &impl Fn(Vec3) -> f32, whole: f64, depth: i32) -> f64 {
        let quarters = self.quarters().map(|c| (c, c.gauss(pdf_w)));
        let sum: f64 = quarters.iter().map(|q| q.1).sum();
        if depth <= 0 && ((sum - whole).abs() < 1e-6 || depth < -7) {
            return sum;
        }
        quarters.into_iter().map(|(c, s)| c.integrate(pdf_w, s, depth - 1)).sum()
    }
}

/// Probability that χ² with `degrees` of freedom exceeds `x`: the regularised upper incomplete gamma function
/// Q(degrees/2, x/2), by series or continued fraction (Press et al., Numerical Recipes, §6.2).
fn p_value(degrees: usize, x: f64) -> f64 {
    let (a, x) = (degrees as f64 / 2.0, x / 2.0);
    // ln Γ of an integer or half-integer by recurrence.
    let mut ln_gamma = if degrees % 2 == 0 { 0.0 } else { std::f64::consts::PI.sqrt().ln() };
    let mut k = if degrees % 2 == 0 { 1.0 } else { 0.5 };
    while k < a - 0.25 {
        ln_gamma += k.ln();
        k += 1.0;
    }
    let front = if x > 0.0 { (a * x.ln() - x - ln_gamma).exp() } else { 0.0 };
    if x < a + 1.0 {
        let (mut term, mut sum) = (1.0 / a, 1.0 / a);
        for n in 1..2000 {
            term *= x / (a + n as f64);
            sum += term;
        }
        1.0 - sum * front
    } else {
        let mut b = x + 1.0 - a;
        let (mut c, mut d) = (f64::INFINITY, 1.0 / b);
        let mut h = d;
        for n in 1..2000 {
            let an = -(n as f64) * (n as f64 - a);
            b += 2.0;
            d = 1.0 / (an * d + b);
            c = b + an / c;
            h *= d * c;
        }
        front * h
    }
}

/// p-value of the hypothesis that `sampled` samples by the pdf of `bsdf`.
fn test(sampled: &Bsdf, bsdf: &Bsdf, wo: Vec3, set: u64) -> f64 {
    let mut observed = vec![0.0; COS_CELLS * PHI_CELLS];
    let mut rest = SAMPLES as f64;
    for i in 0..SAMPLES {
        // Independent samples: stratified ones would fit too well.
        let (u_lobe, u, _) = random(1000 + set * SAMPLES + i, 0);
        let Some(s) = sampled.sample(wo, u_lobe, u, Mode::Flux).filter(|s| !s.delta) else { continue };
        let cos = (s.wi.z as f64 + 1.0) / 2.0;
        let phi = (s.wi.y as f64).atan2(s.wi.x as f64).rem_euclid(TAU) / TAU;
        let row = ((cos * COS_CELLS as f64) as usize).min(COS_CELLS - 1);
        observed[row * PHI_CELLS + ((phi * PHI_CELLS as f64) as usize).min(PHI_CELLS - 1)] += 1.0;
        rest -= 1.0;
    }
    let pdf_w = |wi| bsdf.pdf_w(wo, wi, Mode::Flux);
    let (d_cos, d_phi) = (2.0 / COS_CELLS as f64, TAU / PHI_CELLS as f64);
    let mut cells: Vec<(f64, f64)> = observed
        .into_iter()
        .enumerate()
        .map(|(i, n)| {
            let (row, column) = ((i / PHI_CELLS) as f64, (i % PHI_CELLS) as f64);
            let cell = Cell { cos: row * d_cos - 1.0, phi: column * d_phi, d_cos, d_phi };
            (cell.integrate(&pdf_w, 0.0, 2) * SAMPLES as f64, n)
        })
        .collect();
    let total: f64 = cells.iter().map(|c| c.0).sum();
    assert!(total <= SAMPLES as f64 * 1.001, "the pdf integrates to {}", total / SAMPLES as f64);
    // What is left is no more than an error of quadrature if it is small.
    let left = (SAMPLES as f64 - total).max(0.0);
    cells.push((if left < 1e-4 * SAMPLES as f64 && rest == 0.0 { 0.0 } else { left }, rest));

    // χ² wants five expected samples in a cell.
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut statistic, mut used) = (0.0, 0);
    let mut pool = (0.0, 0.0);
    for (i, cell) in cells.iter().enumerate() {
        pool = (pool.0 + cell.0, pool.1 + cell.1);
        let rest_expected: f64 = cells[i + 1..].iter().map(|c| c.0).sum();
        if pool.0 >= 5.0 && (rest_expected >= 5.0 || rest_expected == 0.0) {
            statistic += (pool.1 - pool.0) * (pool.1 - pool.0) / pool.0;
            used += 1;
            pool = (0.0, 0.0);
        }
    }
    // Nothing may turn up where nothing can.
    assert!(pool.0 >= 1e-6 || pool.1 == 0.0, "{} samples outside of the pdf's support", pool.1);
    if used < 2 { 1.0 } else { p_value(used - 1, statistic) }
}

#[test]
fn samples_follow_the_pdf() {
    let tests: Vec<_> = bsdfs()
        .into_iter()
        .chain(composed::bsdfs())
        .filter(|(_, bsdf)| bsdf.has_smooth())
        .flat_map(|b| directions().map(move |wo| (b.clone(), wo)))
        .collect();
    let threshold = 1.0 - (1.0 - LEVEL).powf(1.0 / tests.len() as f64);
    for (set, ((name, bsdf), wo)) in tests.into_iter().enumerate() {
        let p = test(&bsdf, &bsdf, wo, set as u64);
        assert!(p > threshold, "{name} from {wo}: p = {p:e}, threshold {threshold:e}");
    }
}

#[test]
fn p_values_are_those_of_tables() {
    for (degrees, x, p) in
        [(1, 3.841_459, 0.05), (10, 23.209_251, 0.01), (9, 4.168_159, 0.9), (100, 149.449_253, 0.001)]
    {
        assert!((p_value(degrees, x) - p).abs() < 1e-6, "{degrees} {x}");
    }
}

#[test]
fn a_wrong_pdf_is_noticed() {
    let bsdf = |alpha| {
        let m = Microfacet::new(Distribution::Ggx, alpha, alpha);
        Bsdf::rough_conductor(Rgb::ZERO, Rgb::ONE, m, Rgb::ONE)
    };
    let wo = Vec3::new(0.6, 0.0, 0.8);
    assert!(test(&bsdf(0.4), &bsdf(0.4), wo, 900) > 1e-3);
    assert!(test(&bsdf(0.4), &bsdf(0.42), wo, 900) < 1e-9);
}
