//! Multiple importance sampling (Veach & Guibas 1995).

/// Power heuristic with exponent 2 for two strategies: the weight of the one with density `a`, number of
/// samples times pdf.
pub fn power_heuristic(a: f32, b: f32) -> f32 {
    // Divided through by the larger density, so that no square overflows.
    if a >= b {
        let r = b / a;
        if a > 0.0 && a.is_finite() { 1.0 / (1.0 + r * r) } else { 1.0 }
    } else {
        let r = a / b;
        if b.is_finite() { r * r / (1.0 + r * r) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::power_heuristic;

    #[test]
    fn weights_of_two_strategies_add_to_one_over_all_magnitudes() {
        let pdfs = [1e-38f32, 1e-20, 1e-3, 1.0, 7.0, 1e18, 1e30, 3e38];
        for a in pdfs {
            for b in pdfs {
                let sum = power_heuristic(a, b) + power_heuristic(b, a);
                assert!((sum - 1.0).abs() < 1e-6, "{a} {b}: {sum}");
            }
            assert_eq!(power_heuristic(a, 0.0), 1.0);
            assert_eq!(power_heuristic(0.0, a), 0.0);
            assert_eq!(power_heuristic(f32::INFINITY, a), 1.0);
            assert_eq!(power_heuristic(a, f32::INFINITY), 0.0);
        }
    }
}
