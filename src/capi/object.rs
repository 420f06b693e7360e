//! The objects behind the handles.

use super::cache::CacheObject;
use super::device::DeviceObject;
use super::handles::{Pinned, Table};
use super::scene::SceneObject;
use super::status::{Fault, LUMI_ERROR_OUT_OF_MEMORY, Outcome, Touched, touch};
use super::types::{lumi_cache_s, lumi_device_s, lumi_scene_s};
use std::marker::PhantomData;
use std::sync::atomic::Ordering;
use std::sync::{Arc, LazyLock};

/// Most devices, scenes and caches at once.
const MOST_OBJECTS: u16 = 4096;

static OBJECTS: LazyLock<Table<Object>> = LazyLock::new(|| Table::new(MOST_OBJECTS));

const _: () = assert!(size_of::<usize>() == 8, "handles need 64 bits");

/// What a handle stands for.
pub(super) enum Object {
    Device(Arc<DeviceObject>),
    Scene(Arc<SceneObject>),
    Cache(Arc<CacheObject>),
}

/// A kind of object with its handle.
pub(super) trait Kind: Sized + 'static {
    /// What the handle points to, as far as C knows.
    type Opaque;
    const NAME: &'static str;
    fn of(object: &Object) -> Option<&Arc<Self>>;
    fn into_object(self: Arc<Self>) -> Object;
    fn touched(&self) -> &Touched;
}

macro_rules! kind {
    ($type:ty, $opaque:ty, $variant:ident, $name:literal) => {
        impl Kind for $type {
            type Opaque = $opaque;
            const NAME: &'static str = $name;
            fn of(object: &Object) -> Option<&Arc<Self>> {
                if let Object::$variant(o) = object { Some(o) } else { None }
            }
            fn into_object(self: Arc<Self>) -> Object {
                Object::$variant(self)
            }
            fn touched(&self) -> &Touched {
                &self.touched
            }
        }
    };
}

kind!(DeviceObject, lumi_device_s, Device, "device");
kind!(SceneObject, lumi_scene_s, Scene, "scene");
kind!(CacheObject, lumi_cache_s, Cache, "cache");

impl Object {
    fn name(&self) -> &'static str {
        match self {
            Self::Device(_) => DeviceObject::NAME,
            Self::Scene(_) => SceneObject::NAME,
            Self::Cache(_) => CacheObject::NAME,
        }
    }
}

/// An object for the time of a call.
pub(super) struct Borrowed<K> {
    pinned: Pinned<'static, Object>,
    kind: PhantomData<K>,
}

impl<K: Kind> Borrowed<K> {
    /// The object, to be kept.
    pub fn arc(&self) -> &Arc<K> {
        K::of(&self.pinned).expect("its kind was checked")
    }
}

impl<K: Kind> std::ops::Deref for Borrowed<K> {
    type Target = K;

    fn deref(&self) -> &K {
        self.arc()
    }
}

fn number<T>(handle: *mut T) -> u64 {
    handle.addr() as u64
}

fn stale<K: Kind>(is_null: bool) -> Fault {
    let what = if is_null { "NULL" } else { "no handle, or a released one" };
    Fault::argument(format!("the {} is {what}", K::NAME))
}

/// The object of `handle`; its device's log hears of failures of the call under way.
pub(super) fn borrow<K: Kind>(handle: *mut K::Opaque) -> Outcome<Borrowed<K>> {
    let pinned = OBJECTS.pin(number(handle)).ok_or_else(|| stale::<K>(handle.is_null()))?;
    let Some(object) = K::of(&pinned) else {
        return Err(Fault::argument(format!(
            "a {} was expected, the handle is that of a {}",
            K::NAME,
            pinned.name()
        )));
    };
    if object.touched().broken.load(Ordering::Acquire) {
        return Err(Fault::operation(format!(
            "an internal error has left the {} useless: release it",
            K::NAME
        )));
    }
    touch(object.touched().clone());
    Ok(Borrowed { pinned, kind: PhantomData })
}

/// Writes a new handle of `object` to `out`.
pub(super) fn publish<K: Kind>(object: Arc<K>, out: *mut *mut K::Opaque) -> Outcome {
    let full = || {
        Fault::new(LUMI_ERROR_OUT_OF_MEMORY, format!("there are {MOST_OBJECTS} objects already"))
    };
    let handle = OBJECTS.insert(object.into_object()).ok_or_else(full)?;
    // SAFETY: the callers check that `out`, where the host wants the handle, is not NULL.
    unsafe { out.write(std::ptr::without_provenance_mut(handle as usize)) };
    Ok(())
}

/// Sets the handle that a failing call leaves behind, and says if there is no place for one.
pub(super) fn clear<T>(out: *mut *mut T) -> Outcome {
    if out.is_null() {
        return Err(Fault::argument("the place for the handle is NULL"));
    }
    // SAFETY: not NULL, and the caller passes the address of a handle.
    unsafe { out.write(std::ptr::null_mut()) };
    Ok(())
}

pub(super) fn retain<K: Kind>(handle: *mut K::Opaque) -> Outcome {
    let pinned = OBJECTS.pin(number(handle)).ok_or_else(|| stale::<K>(handle.is_null()))?;
    check_kind::<K>(&pinned)?;
    if OBJECTS.retain(number(handle)) {
        Ok(())
    } else {
        Err(Fault::operation(format!(
            "the {} has been released meanwhile, or is retained 65535 times",
            K::NAME
        )))
    }
}

pub(super) fn release<K: Kind>(handle: *mut K::Opaque) -> Outcome {
    if handle.is_null() {
        return Ok(());
    }
    let pinned = OBJECTS.pin(number(handle)).ok_or_else(|| stale::<K>(false))?;
    check_kind::<K>(&pinned)?;
    if OBJECTS.release(number(handle)) { Ok(()) } else { Err(stale::<K>(false)) }
}

fn check_kind<K: Kind>(object: &Object) -> Outcome {
    K::of(object).map(|_| ()).ok_or_else(|| {
        Fault::argument(format!(
            "a {} was expected, the handle is that of a {}",
            K::NAME,
            object.name()
        ))
    })
}
