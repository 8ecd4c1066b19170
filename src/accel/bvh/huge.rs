//! Arrays in huge pages: rays touch memory all over, and with small pages half of their misses are misses of the TLB
//! as well.

use crate::{Error, Result};
use bytemuck::Pod;
use memmap2::MmapMut;
use std::marker::PhantomData;
use std::ops::Index;

/// A slice of fixed length.
pub(super) struct Huge<T> {
    map: MmapMut,
    of: PhantomData<T>,
}

impl<T: Pod> Huge<T> {
    /// `len` items (and room for one if there are none), all bits zero and then filled by `fill`.
    ///
    /// # Errors
    /// [`Error::Runtime`] if there is not that much memory.
    pub(super) fn new(len: usize, fill: impl FnOnce(&mut [T])) -> Result<Huge<T>> {
        // Pages are aligned for any type of ours.
        let bytes = len.max(1) * size_of::<T>();
        let map = MmapMut::map_anon(bytes);
        let mut map = map.map_err(|e| Error::Runtime(format!("no memory for {bytes} bytes of BVH: {e}")))?;
        // A wish that a system may not know.
        #[cfg(target_os = "linux")]
        let _ = map.advise(memmap2::Advice::HugePage);
        fill(bytemuck::cast_slice_mut(&mut map[..len * size_of::<T>()]));
        Ok(Huge { map, of: PhantomData })
    }

    #[cfg(test)]
    pub(super) fn bytes(&self) -> usize {
        self.map.len()
    }
}

impl<T: Pod> Index<usize> for Huge<T> {
    type Output = T;

    // Not by way of a slice: its length costs a division, and small scenes feel that.
    #[inline(always)]
    fn index(&self, i: usize) -> &T {
        bytemuck::from_bytes(&self.map[i * size_of::<T>()..][..size_of::<T>()])
    }
}
