//! Arrays in the host's memory: checked once, then read and written by index.

use super::common::{LUMI_VIEW_SHARED, lumi_view};
use crate::capi::status::{Outcome, ensure};
use crate::geometry::Buffer;
use crate::math::Vec3;
use bytemuck::Pod;
use std::sync::Arc;

/// Most elements of any array.
const MAX_COUNT: usize = u32::MAX as usize;

/// An array of `N` numbers per element to read.
#[derive(Clone, Copy)]
pub(in crate::capi) struct Input<T, const N: usize> {
    data: *const [T; N],
    stride: usize,
    count: usize,
}

/// An array of `N` numbers per element to write, or NULL where the host wants none.
pub(in crate::capi) struct Output<T, const N: usize> {
    data: *mut [T; N],
    stride: usize,
    count: usize,
}

// SAFETY: the host promises that the memory it passes stays readable until the call returns, and
// writes nothing to it meanwhile.
unsafe impl<T: Sync, const N: usize> Sync for Input<T, N> {}
// SAFETY: as above.
unsafe impl<T: Send, const N: usize> Send for Input<T, N> {}

/// The stride, and that all of the array can be in memory.
fn check<T, const N: usize>(count: usize, stride: usize, what: &str) -> Outcome<usize> {
    let element = size_of::<[T; N]>();
    let stride = if stride == 0 { element } else { stride };
    let end = count.saturating_sub(1).checked_mul(stride).and_then(|n| n.checked_add(element));
    let possible = count <= MAX_COUNT && end.is_some_and(|n| n <= isize::MAX as usize);
    ensure!(possible, "{what}: {count} elements {stride} bytes apart are more than can be");
    let apart = stride >= element;
    ensure!(apart, "{what}: elements of {element} bytes cannot be {stride} bytes apart");
    Ok(stride)
}

impl<T: Copy, const N: usize> Input<T, N> {
    /// `count` elements; `None` for NULL.
    pub fn new(data: *const T, count: usize, stride: usize, what: &str) -> Outcome<Option<Self>> {
        let stride = check::<T, N>(count, stride, what)?;
        Ok((!data.is_null()).then_some(Self { data: data.cast(), stride, count }))
    }

    /// As [`Input::new`]; NULL is an error unless the array is empty.
    pub fn required(data: *const T, count: usize, stride: usize, what: &str) -> Outcome<Self> {
        let stride = check::<T, N>(count, stride, what)?;
        ensure!(!data.is_null() || count == 0, "{what} is NULL");
        Ok(Self { data: data.cast(), stride, count })
    }

    /// A view whose format must be `format`; `None` if it is not there.
    pub fn of_view(view: &lumi_view, format: u32, what: &str) -> Outcome<Option<Self>> {
        if view.data.is_null() && view.count == 0 {
            return Ok(None);
        }
        let given = view.format;
        ensure!(given == format, "{what} has the format {given}, expected {format}");
        Self::required(view.data.cast(), view.count, view.stride, what).map(Some)
    }

    pub fn len(&self) -> usize {
        self.count
    }

    /// Element `i`.
    #[inline]
    pub fn get(&self, i: usize) -> [T; N] {
        assert!(i < self.count);
        // SAFETY: i is below the count that the host gave for this address and stride, and the
        // extent was checked; alignment is not asked for.
        unsafe { self.data.byte_add(i * self.stride).read_unaligned() }
    }

    pub fn iter(&self) -> impl ExactSizeIterator<Item = [T; N]> + '_ {
        (0..self.count).map(|i| self.get(i))
    }
}

impl Input<f32, 3> {
    #[inline]
    pub fn vector(&self, i: usize) -> Vec3 {
        self.get(i).into()
    }
}

impl<T: Copy, const N: usize> Output<T, N> {
    /// Room for `count` elements.
    pub fn new(data: *mut T, count: usize, stride: usize, what: &str) -> Outcome<Self> {
        Ok(Self { data: data.cast(), stride: check::<T, N>(count, stride, what)?, count })
    }

    /// Whether there is an array.
    pub fn is_wanted(&self) -> bool {
        !self.data.is_null()
    }

    /// Sets element `i` where there is an array.
    #[inline]
    pub fn set(&mut self, i: usize, value: impl Into<[T; N]>) {
        assert!(i < self.count);
        if !self.data.is_null() {
            // SAFETY: i is below the count that the host gave for this address and stride, and the
            // extent was checked; alignment is not asked for.
            unsafe { self.data.byte_add(i * self.stride).write_unaligned(value.into()) };
        }
    }
}

/// A dense array that stays in the host's memory.
struct Lent<T> {
    data: *const T,
    count: usize,
}

// SAFETY: the host promises that memory which it shares stays readable and unchanged until scene
// and caches are released.
unsafe impl<T: Sync> Sync for Lent<T> {}
// SAFETY: as above.
unsafe impl<T: Send> Send for Lent<T> {}

impl<T: Pod> AsRef<[T]> for Lent<T> {
    fn as_ref(&self) -> &[T] {
        // SAFETY: the address is aligned and not NULL, all `count` elements were read when the
        // array was checked, and any bits are a T.
        unsafe { std::slice::from_raw_parts(self.data, self.count) }
    }
}

/// The elements of `view`, which was checked, in the host's memory; `None` if the host does not
/// share them, or if they are not dense and aligned as ours are.
pub(in crate::capi) fn lent<T: Pod + Send + Sync>(view: &lumi_view) -> Option<Buffer<T>> {
    let data = view.data.cast::<T>();
    let dense = view.stride == 0 || view.stride == size_of::<T>();
    let usable = view.flags & LUMI_VIEW_SHARED != 0
        && dense
        && data.is_aligned()
        && !data.is_null()
        && view.count > 0;
    usable.then(|| Buffer::lent(Arc::new(Lent { data, count: view.count })))
}
