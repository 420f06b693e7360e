//! The objects behind the handles.

mod sync;
mod table;

use super::status::{Fault, LUMI_ERROR_OUT_OF_MEMORY, Outcome, Touched, ensure, state, touch};
use std::any::Any;
use std::marker::PhantomData;
use std::sync::atomic::Ordering;
use std::sync::{Arc, LazyLock};
use table::{Pinned, Table};

/// Most devices, scenes and caches at once.
const MOST_OBJECTS: u16 = 4096;

static OBJECTS: LazyLock<Table<Object>> = LazyLock::new(|| Table::new(MOST_OBJECTS));

const _: () = assert!(size_of::<usize>() == 8, "handles need 64 bits");

/// What a handle stands for.
struct Object {
    kind: &'static str,
    value: Arc<dyn Any + Send + Sync>,
}

/// A kind of object with its handle.
pub(super) trait Kind: Sized + Send + Sync + 'static {
    /// What the handle points to, as far as C knows.
    type Opaque;
    const NAME: &'static str;
    fn touched(&self) -> &Touched;
}

/// An object for the time of a call.
pub(super) struct Borrowed<K> {
    pinned: Pinned<'static, Object>,
    kind: PhantomData<K>,
}

impl<K: Kind> Borrowed<K> {
    /// The object, to be kept.
    pub fn arc(&self) -> Arc<K> {
        self.pinned.value.clone().downcast().expect("its kind was checked")
    }
}

impl<K: Kind> std::ops::Deref for Borrowed<K> {
    type Target = K;

    fn deref(&self) -> &K {
        self.pinned.value.downcast_ref().expect("its kind was checked")
    }
}

fn number<T>(handle: *mut T) -> u64 {
    handle.addr() as u64
}

fn stale<K: Kind>(handle: *mut K::Opaque) -> Fault {
    let what = if handle.is_null() { "NULL" } else { "no handle, or a released one" };
    Fault::argument(format!("the {} is {what}", K::NAME))
}

/// The object of `handle`, which is of the right kind.
fn pin<K: Kind>(handle: *mut K::Opaque) -> Outcome<Borrowed<K>> {
    let pinned = OBJECTS.pin(number(handle)).ok_or_else(|| stale::<K>(handle))?;
    if pinned.value.is::<K>() {
        return Ok(Borrowed { pinned, kind: PhantomData });
    }
    let (wanted, given) = (K::NAME, pinned.kind);
    Err(Fault::argument(format!("a {wanted} was expected, the handle is that of a {given}")))
}

/// The object of `handle`; its device's log hears of failures of the call under way.
pub(super) fn borrow<K: Kind>(handle: *mut K::Opaque) -> Outcome<Borrowed<K>> {
    let object = pin::<K>(handle)?;
    if object.touched().broken.load(Ordering::Acquire) {
        let kind = K::NAME;
        let text = format!("an internal error has left the {kind} useless: release it");
        return Err(Fault::operation(text));
    }
    touch(object.touched().clone());
    Ok(object)
}

/// Writes a new handle of `object` to `out`.
pub(super) fn publish<K: Kind>(object: K, out: *mut *mut K::Opaque) -> Outcome {
    let full = || {
        Fault::new(LUMI_ERROR_OUT_OF_MEMORY, format!("there are {MOST_OBJECTS} objects already"))
    };
    let object = Object { kind: K::NAME, value: Arc::new(object) };
    let handle = OBJECTS.insert(object).ok_or_else(full)?;
    // SAFETY: the callers check that `out`, where the host wants the handle, is not NULL.
    unsafe { out.write(std::ptr::without_provenance_mut(handle as usize)) };
    Ok(())
}

/// Sets the handle that a failing call leaves behind, and says if there is no place for one.
pub(super) fn clear<T>(out: *mut *mut T) -> Outcome {
    ensure!(!out.is_null(), "the place for the handle is NULL");
    // SAFETY: not NULL, and the caller passes the address of a handle.
    unsafe { out.write(std::ptr::null_mut()) };
    Ok(())
}

pub(super) fn retain<K: Kind>(handle: *mut K::Opaque) -> Outcome {
    let _pinned = pin::<K>(handle)?;
    let kind = K::NAME;
    let text = format!("the {kind} has been released meanwhile, or is retained 65535 times");
    state(OBJECTS.retain(number(handle)), &text)
}

pub(super) fn release<K: Kind>(handle: *mut K::Opaque) -> Outcome {
    if handle.is_null() {
        return Ok(());
    }
    let _pinned = pin::<K>(handle)?;
    if OBJECTS.release(number(handle)) { Ok(()) } else { Err(stale::<K>(handle)) }
}
