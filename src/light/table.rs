//! Importance of the directions of a light that is not the same in all of them: piecewise constant over a unit square.

use crate::math::{Discrete, Rgb, luminance};
use glam::Vec2;

/// A distribution over the unit square in proportion to luminance, and the mean of what it was made from.
#[derive(Clone, Debug)]
pub(super) struct Table {
    rows: Discrete,
    columns: Vec<Discrete>,
    mean: Rgb,
}

impl Table {
    /// Of `size` cells, each the mean of `sub` by `sub` values of `f`.
    pub(super) fn new((width, height): (usize, usize), sub: usize, f: impl Fn(Vec2) -> Rgb) -> Table {
        let fine = (width * sub, height * sub);
        let mut sum = [0.0f64; 3];
        let mut cells = vec![0.0f32; width * height];
        for y in 0..fine.1 {
            for x in 0..fine.0 {
                let value =
                    f((Vec2::new(x as f32, y as f32) + 0.5) / Vec2::new(fine.0 as f32, fine.1 as f32));
                cells[y / sub * width + x / sub] += luminance(value);
                for (s, v) in sum.iter_mut().zip(value.to_array()) {
                    *s += v as f64;
                }
            }
        }
        // What lies between the samples of a cell is still found, if rarely.
        let floor = 0.01 * cells.iter().sum::<f32>() / cells.len() as f32;
        let columns: Vec<Discrete> =
            cells.chunks(width).map(|row| Discrete::new(row.iter().map(|w| w + floor))).collect();
        Table {
            rows: Discrete::new(columns.iter().map(|c| c.total() as f32)),
            columns,
            mean: Rgb::from_array(sum.map(|s| (s / (fine.0 * fine.1) as f64) as f32)),
        }
    }

    /// Mean of `f`.
    pub(super) fn mean(&self) -> Rgb {
        self.mean
    }

    fn size(&self) -> (f32, f32) {
        (self.columns[0].len() as f32, self.columns.len() as f32)
    }

    /// A point of the unit square and the density there; `None` if all is black.
    pub(super) fn sample(&self, u: Vec2) -> Option<(Vec2, f32)> {
        let (y, prob_y, v) = self.rows.sample(u.y)?;
        let (x, prob_x, h) = self.columns[y].sample(u.x)?;
        let (width, height) = self.size();
        let p = Vec2::new((x as f32 + h) / width, (y as f32 + v) / height);
        Some((p, prob_x * prob_y * (width * height)))
    }

    /// Density of [`Table::sample`] at a point of the unit square.
    pub(super) fn pdf(&self, p: Vec2) -> f32 {
        let (width, height) = self.size();
        let cell = |p: f32, n: f32| (p * n).clamp(0.0, n - 1.0) as usize;
        let (x, y) = (cell(p.x, width), cell(p.y, height));
        self.columns[y].prob(x) * self.rows.prob(y) * (width * height)
    }
}
