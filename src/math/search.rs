//! Searching long slices with all threads.

use rayon::prelude::*;

/// Items that one thread looks at in one go: asking at every item whether another thread has found one costs more
/// than the search.
const CHUNK: usize = 1 << 12;

/// Index of the first item that is `wanted`.
pub fn first_index<T: Sync>(items: &[T], wanted: impl Fn(&T) -> bool + Sync) -> Option<usize> {
    let chunk = items.par_chunks(CHUNK).position_first(|chunk| chunk.iter().any(&wanted))?;
    let start = chunk * CHUNK;
    items[start..].iter().position(wanted).map(|i| start + i)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_is_found() {
        let mut items = vec![0; 3 * CHUNK + 5];
        assert_eq!(first_index(&items, |i| *i == 1), None);
        for i in [items.len() - 1, 2 * CHUNK, CHUNK + 7, 3] {
            items[i] = 1;
            assert_eq!(first_index(&items, |i| *i == 1), Some(i));
        }
        assert_eq!(first_index(&[] as &[i32], |_| true), None);
    }
}
