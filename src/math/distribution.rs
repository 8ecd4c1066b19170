//! Discrete distributions.

/// A discrete distribution over indices, proportional to given weights.
#[derive(Clone, Debug, Default)]
pub struct Discrete {
    /// `cdf[i]` is the probability of an index below `i + 1`; the last is 1.
    cdf: Vec<f32>,
    total: f64,
}

impl Discrete {
    /// From non-negative, finite weights. With all weights zero nothing can be sampled.
    pub fn new(weights: impl IntoIterator<Item = f32>) -> Self {
        let mut cdf: Vec<f32> = weights.into_iter().collect();
        let total: f64 = cdf.iter().map(|&w| w as f64).sum();
        let scale = if total > 0.0 { 1.0 / total } else { 0.0 };
        let mut sum = 0.0f64;
        for w in &mut cdf {
            sum += *w as f64;
            *w = (sum * scale) as f32;
        }
        Discrete { cdf, total }
    }

    /// The sum of the weights.
    pub fn total(&self) -> f64 {
        self.total
    }

    /// How many indices there are.
    pub fn len(&self) -> usize {
        self.cdf.len()
    }

    /// Whether there is no index at all.
    pub fn is_empty(&self) -> bool {
        self.cdf.is_empty()
    }

    /// Probability of index `i`.
    pub fn prob(&self, i: usize) -> f32 {
        self.cdf[i] - if i > 0 { self.cdf[i - 1] } else { 0.0 }
    }

    /// The index that `u` in [0, 1) selects, its probability, and `u` rescaled to [0, 1) for reuse. `None` if all
    /// weights are zero.
    pub fn sample(&self, u: f32) -> Option<(usize, f32, f32)> {
        if self.total <= 0.0 {
            return None;
        }
        let i = self.cdf.partition_point(|&c| c <= u).min(self.cdf.len() - 1);
        let below = if i > 0 { self.cdf[i - 1] } else { 0.0 };
        let prob = self.cdf[i] - below;
        (prob > 0.0).then(|| (i, prob, ((u - below) / prob).clamp(0.0, 1.0 - f32::EPSILON / 2.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frequencies_match_probabilities() {
        let d = Discrete::new([1.0, 0.0, 3.0, 4.0]);
        let mut count = [0; 4];
        for i in 0..8000 {
            let (k, prob, u) = d.sample((i as f32 + 0.5) / 8000.0).unwrap();
            assert_eq!(prob, d.prob(k));
            assert!((0.0..1.0).contains(&u));
            count[k] += 1;
        }
        assert_eq!(count, [1000, 0, 3000, 4000]);
        assert!(Discrete::new([0.0]).sample(0.5).is_none());
        assert!(Discrete::new([]).sample(0.5).is_none());
    }
}
