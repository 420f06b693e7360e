//! Handles: numbers that stand for shared objects, and that are found out when they are stale.
//!
//! A handle is a slot's number with the slot's generation; the generation moves on when the object
//! goes, so a released handle never names the object that came after. Each slot counts, in one
//! word, the references that the host holds and the calls that are under way. Only the step that
//! brings both to zero takes the object out, so a call keeps its object even when another thread
//! releases the last reference meanwhile. `tests/loom` goes through all interleavings of this file.

use super::sync::{AtomicU64, Cell, Mutex, Ordering};
use std::sync::PoisonError;

/// Generation in the upper half, then the host's references, then the calls under way.
const GENERATION: u32 = 32;
const REFERENCE: u64 = 1 << 16;
const CALL: u64 = 1;
const COUNT: u64 = 0xffff;

/// Lowest 16 bits of every handle: no address of anything aligned looks like one.
const MARK: u64 = 0x4c55;

fn generation(word: u64) -> u64 {
    word >> GENERATION
}

fn references(word: u64) -> u64 {
    (word >> 16) & COUNT
}

fn calls(word: u64) -> u64 {
    word & COUNT
}

struct Slot<T> {
    word: AtomicU64,
    value: Cell<Option<T>>,
}

/// Objects and the handles that name them.
pub struct Table<T> {
    slots: Box<[Slot<T>]>,
    free: Mutex<Vec<u16>>,
}

// SAFETY: a slot's value is written only by the thread that owns the slot alone, before its word
// admits others and after it has shut them out; in between it is only read, from many threads, and
// dropped by whichever thread is last.
unsafe impl<T: Send + Sync> Send for Table<T> {}
// SAFETY: as above.
unsafe impl<T: Send + Sync> Sync for Table<T> {}

/// An object during a call.
pub struct Pinned<'a, T> {
    table: &'a Table<T>,
    number: u16,
}

impl<T> Table<T> {
    /// A table for at most `size` objects at once, which must be below 65536.
    pub fn new(size: u16) -> Self {
        let slot = || Slot { word: AtomicU64::new(1 << GENERATION), value: Cell::new(None) };
        Self {
            slots: (0..size).map(|_| slot()).collect(),
            free: Mutex::new((0..size).rev().collect()),
        }
    }

    fn free(&self) -> impl std::ops::DerefMut<Target = Vec<u16>> + '_ {
        self.free.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes `value` in; its handle has one reference. `None` when the table is full.
    pub fn insert(&self, value: T) -> Option<u64> {
        let number = self.free().pop()?;
        let slot = &self.slots[usize::from(number)];
        // SAFETY: the slot came off the free list, so no reference and no call names it: it is this
        // thread's alone.
        slot.value.with_mut(|v| unsafe { *v = Some(value) });
        // Release: who sees the reference sees the value.
        let word = slot.word.fetch_add(REFERENCE, Ordering::Release);
        Some(generation(word) << GENERATION | u64::from(number) << 16 | MARK)
    }

    fn slot(&self, handle: u64) -> Option<(&Slot<T>, u16)> {
        let number = (handle >> 16) as u16;
        let slot = self.slots.get(usize::from(number))?;
        (handle & 0xffff == MARK).then_some((slot, number))
    }

    /// Replaces the word of the handle's slot by `change(word)` if the handle is live; `None` if it
    /// is not, or `change` refuses.
    fn change(&self, handle: u64, change: impl Fn(u64) -> Option<u64>) -> Option<(u64, u16)> {
        let (slot, number) = self.slot(handle)?;
        let mut word = slot.word.load(Ordering::Acquire);
        loop {
            if generation(word) != generation(handle) || references(word) == 0 {
                return None;
            }
            let next = change(word)?;
            match slot.word.compare_exchange_weak(word, next, Ordering::AcqRel, Ordering::Acquire) {
                Ok(_) => return Some((next, number)),
                Err(now) => word = now,
            }
        }
    }

    /// The object of `handle` for the time of a call; `None` if the handle is stale or was never
    /// one.
    pub fn pin(&self, handle: u64) -> Option<Pinned<'_, T>> {
        let (_, number) = self.change(handle, |w| (calls(w) < COUNT).then_some(w + CALL))?;
        Some(Pinned { table: self, number })
    }

    /// Adds a reference; false if the handle is stale or has too many.
    pub fn retain(&self, handle: u64) -> bool {
        self.change(handle, |w| (references(w) < COUNT).then_some(w + REFERENCE)).is_some()
    }

    /// Drops a reference; false if the handle is stale.
    pub fn release(&self, handle: u64) -> bool {
        let Some((word, number)) = self.change(handle, |w| Some(w - REFERENCE)) else {
            return false;
        };
        self.settle(word, number);
        true
    }

    /// Takes the object out if `word`, which this thread has just stored, has neither reference nor
    /// call: then no other thread can come in.
    fn settle(&self, word: u64, number: u16) {
        if references(word) > 0 || calls(word) > 0 {
            return;
        }
        let slot = &self.slots[usize::from(number)];
        // SAFETY: without references no call can begin and none is under way, and only one step
        // reaches zero: the slot is this thread's alone.
        let value = slot.value.with_mut(|v| unsafe { (*v).take() });
        slot.word.store(((generation(word) + 1) & 0xffff_ffff) << GENERATION, Ordering::Release);
        self.free().push(number);
        // Last: dropping an object may release others.
        drop(value);
    }
}

impl<T> std::ops::Deref for Pinned<'_, T> {
    type Target = T;

    #[inline]
    fn deref(&self) -> &T {
        let slot = &self.table.slots[usize::from(self.number)];
        // SAFETY: the call counts, so the value is there and nobody writes it until the guard is
        // gone.
        slot.value.with(|v| unsafe { (*v).as_ref().unwrap_unchecked() })
    }
}

impl<T> Drop for Pinned<'_, T> {
    fn drop(&mut self) {
        let word =
            self.table.slots[usize::from(self.number)].word.fetch_sub(CALL, Ordering::AcqRel)
                - CALL;
        self.table.settle(word, self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::atomic::AtomicUsize;

    #[test]
    fn a_stale_handle_names_nothing_not_even_its_successor() {
        let table = Table::new(1);
        let a = table.insert("a").unwrap();
        assert!(table.insert("full").is_none());
        assert!(table.retain(a) && table.release(a));
        assert_eq!(*table.pin(a).unwrap(), "a");
        assert!(
            table.release(a) && !table.release(a) && !table.retain(a) && table.pin(a).is_none()
        );
        let b = table.insert("b").unwrap();
        assert!(a != b && table.pin(a).is_none() && !table.release(a));
        assert_eq!(*table.pin(b).unwrap(), "b");
        for wild in [0, 1, u64::MAX, b ^ 1, b ^ (1 << 40), b + (1 << 16)] {
            assert!(table.pin(wild).is_none() && !table.release(wild), "{wild:x}");
        }
    }

    #[test]
    fn a_call_keeps_its_object() {
        let table = Table::new(2);
        let alive = Arc::new(());
        let handle = table.insert(alive.clone()).unwrap();
        let pinned = table.pin(handle).unwrap();
        assert!(table.release(handle));
        assert!(table.pin(handle).is_none(), "nobody new comes in");
        assert_eq!(Arc::strong_count(&*pinned), 2);
        drop(pinned);
        assert_eq!(Arc::strong_count(&alive), 1);
    }

    #[test]
    fn threads_that_use_and_release_at_once() {
        struct Counted<'a>(&'a AtomicUsize);
        impl Drop for Counted<'_> {
            fn drop(&mut self) {
                self.0.fetch_add(1, Ordering::SeqCst);
            }
        }
        // An interpreter takes a thousand times as long.
        let rounds = if cfg!(miri) { 20 } else { 2000 };
        let dropped = AtomicUsize::new(0);
        let table = Table::new(8);
        std::thread::scope(|s| {
            for _ in 0..4 {
                s.spawn(|| {
                    for _ in 0..rounds {
                        let handle = table.insert(Counted(&dropped)).unwrap();
                        std::thread::scope(|s| {
                            s.spawn(|| drop(table.pin(handle)));
                            assert!(table.release(handle));
                        });
                        assert!(table.pin(handle).is_none());
                    }
                });
            }
        });
        assert_eq!(dropped.load(Ordering::SeqCst), 4 * rounds);
        assert_eq!(table.free().len(), 8);
    }
}
