//! Rays against committed scenes: one by one, and in packets as wide as the CPU's registers.

use super::raw;
use super::scene::Scene;
use crate::ffi::ray::{Hit, Ray};
use std::time::Instant;

/// `RTC_INVALID_GEOMETRY_ID`, a cast that bindgen skips.
const INVALID_ID: u32 = u32::MAX;

/// Embree 3 passes options in a context, which it also writes to: one for each call.
#[cfg(not(embree4))]
mod options {
    use super::{INVALID_ID, raw};

    pub type Intersect = raw::RTCIntersectContext;
    pub type Occluded = raw::RTCIntersectContext;

    pub fn intersect(coherent: bool) -> Intersect {
        let flags = if coherent {
            raw::RTC_INTERSECT_CONTEXT_FLAG_COHERENT
        } else {
            raw::RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT
        };
        Intersect { flags, filter: None, instID: [INVALID_ID] }
    }

    pub fn occluded() -> Occluded {
        intersect(false)
    }
}

/// Embree 4 passes options in arguments, and is told which kinds of geometry our scenes have.
#[cfg(embree4)]
mod options {
    use super::raw;
    use std::ptr::null_mut;

    pub type Intersect = raw::RTCIntersectArguments;
    pub type Occluded = raw::RTCOccludedArguments;

    const FEATURES: raw::RTCFeatureFlags =
        raw::RTC_FEATURE_FLAG_TRIANGLE | raw::RTC_FEATURE_FLAG_INSTANCE;

    pub fn intersect(coherent: bool) -> Intersect {
        let flags = if coherent {
            raw::RTC_RAY_QUERY_FLAG_COHERENT
        } else {
            raw::RTC_RAY_QUERY_FLAG_INCOHERENT
        };
        Intersect {
            flags,
            feature_mask: FEATURES,
            context: null_mut(),
            filter: None,
            intersect: None,
        }
    }

    pub fn occluded() -> Occluded {
        Occluded {
            flags: raw::RTC_RAY_QUERY_FLAG_INCOHERENT,
            feature_mask: FEATURES,
            context: null_mut(),
            filter: None,
            occluded: None,
        }
    }
}

/// A call of `$function(before..., ray, options)`: Embree 4 moved the options from before the ray
/// to behind it.
macro_rules! call {
    ($function:ident($($before:expr),*; $ray:expr; $options:expr)) => {{
        #[cfg(not(embree4))]
        rtc!($function; $($before),*, $options, $ray);
        #[cfg(embree4)]
        rtc!($function; $($before),*, $ray, $options);
    }};
}

/// The ray in Embree's single form.
fn single(ray: &Ray) -> raw::RTCRay {
    raw::RTCRay {
        org_x: ray.origin.x,
        org_y: ray.origin.y,
        org_z: ray.origin.z,
        tnear: ray.tmin,
        dir_x: ray.dir.x,
        dir_y: ray.dir.y,
        dir_z: ray.dir.z,
        time: 0.0,
        tfar: ray.tmax,
        mask: u32::MAX,
        id: 0,
        flags: 0,
    }
}

/// Our numbers of a hit: an instance geometry has its own number, a world-space geometry is
/// numbered by its instance.
#[inline]
fn hit(t: f32, u: f32, v: f32, triangle: u32, geometry: u32, instance: u32) -> Hit {
    if geometry == INVALID_ID {
        return Hit::MISS;
    }
    Hit { t, u, v, instance: if instance == INVALID_ID { geometry } else { instance }, triangle }
}

/// Functions for packets of one width.
macro_rules! packets {
    ($width:ident, $n:literal, $Ray:ident, $RayHit:ident, $intersect:ident, $occluded:ident) => {
        mod $width {
            use super::*;

            /// Which rays of a packet take part: -1 or 0 each.
            #[repr(align(64))]
            pub struct Valid(pub [i32; $n]);

            /// Writes up to a packet's width of `rays` to its lanes and returns which take part:
            /// the valid ones. Debian compiles Embree with its assertions, and one of them would
            /// end the process at a ray that is not a number.
            #[inline]
            fn gather(rays: &[Ray], packet: &mut raw::$Ray) -> Valid {
                let mut valid = Valid([0; $n]);
                for (i, ray) in rays.iter().take($n).enumerate() {
                    valid.0[i] = -i32::from(ray.is_valid());
                    packet.org_x[i] = ray.origin.x;
                    packet.org_y[i] = ray.origin.y;
                    packet.org_z[i] = ray.origin.z;
                    packet.tnear[i] = ray.tmin;
                    packet.dir_x[i] = ray.dir.x;
                    packet.dir_y[i] = ray.dir.y;
                    packet.dir_z[i] = ray.dir.z;
                    packet.tfar[i] = ray.tmax;
                }
                valid
            }

            pub fn intersect(scene: &Scene, rays: &[Ray], coherent: bool, hits: &mut [Hit]) {
                let mut packet = raw::$RayHit::default();
                packet.ray.mask = [u32::MAX; $n];
                for (rays, hits) in rays.chunks($n).zip(hits.chunks_mut($n)) {
                    let valid = gather(rays, &mut packet.ray);
                    packet.hit.geomID = [INVALID_ID; $n];
                    packet.hit.instID = [[INVALID_ID; $n]];
                    trace(scene, &valid, coherent, &mut packet);
                    let (ray, found) = (&packet.ray, &packet.hit);
                    for (i, out) in hits.iter_mut().enumerate() {
                        *out = hit(ray.tfar[i], found.u[i], found.v[i], found.primID[i], found.geomID[i], found.instID[0][i]);
                    }
                }
            }

            pub fn occluded(scene: &Scene, rays: &[Ray], blocked: &mut [bool]) {
                let mut packet = raw::$Ray { mask: [u32::MAX; $n], ..Default::default() };
                for (rays, blocked) in rays.chunks($n).zip(blocked.chunks_mut($n)) {
                    let valid = gather(rays, &mut packet);
                    let mut options = options::occluded();
                    // SAFETY: the scene is committed, the rays that `valid` names are initialised,
                    // and `valid` has the alignment that Embree wants.
                    unsafe { call!($occluded(valid.0.as_ptr(), scene.handle; &mut packet; &mut options)) };
                    for ((out, tfar), valid) in blocked.iter_mut().zip(packet.tfar).zip(valid.0) {
                        *out = valid != 0 && tfar == f32::NEG_INFINITY;
                    }
                }
            }

            pub fn bare_seconds(scene: &Scene, rays: &[Ray]) -> f64 {
                let mut packets: Vec<_> = rays
                    .chunks($n)
                    .map(|rays| {
                        let mut packet = raw::$RayHit::default();
                        packet.ray.mask = [u32::MAX; $n];
                        packet.hit.geomID = [INVALID_ID; $n];
                        packet.hit.instID = [[INVALID_ID; $n]];
                        (gather(rays, &mut packet.ray), packet)
                    })
                    .collect();
                let start = Instant::now();
                for (valid, packet) in &mut packets {
                    trace(scene, valid, false, packet);
                }
                start.elapsed().as_secs_f64()
            }

            #[inline]
            fn trace(scene: &Scene, valid: &Valid, coherent: bool, packet: &mut raw::$RayHit) {
                let mut options = options::intersect(coherent);
                // SAFETY: the scene is committed, the rays that `valid` names are initialised, and
                // `valid` has the alignment that Embree wants.
                unsafe { call!($intersect(valid.0.as_ptr(), scene.handle; packet; &mut options)) };
            }
        }
    };
}

packets!(wide8, 8, RTCRay8, RTCRayHit8, rtcIntersect8, rtcOccluded8);
packets!(wide16, 16, RTCRay16, RTCRayHit16, rtcIntersect16, rtcOccluded16);

impl Scene {
    /// The closest hit of one ray.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Hit {
        if !ray.is_valid() {
            return Hit::MISS;
        }
        let mut query = raw::RTCRayHit { ray: single(ray), ..Default::default() };
        query.hit.geomID = INVALID_ID;
        query.hit.instID = [INVALID_ID];
        let mut options = options::intersect(false);
        // SAFETY: the scene is committed, the ray is initialised.
        unsafe { call!(rtcIntersect1(self.handle; &mut query; &mut options)) };
        hit(
            query.ray.tfar,
            query.hit.u,
            query.hit.v,
            query.hit.primID,
            query.hit.geomID,
            query.hit.instID[0],
        )
    }

    /// Whether anything is on one ray.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        if !ray.is_valid() {
            return false;
        }
        let mut query = single(ray);
        let mut options = options::occluded();
        // SAFETY: the scene is committed, the ray is initialised.
        unsafe { call!(rtcOccluded1(self.handle; &mut query; &mut options)) };
        query.tfar == f32::NEG_INFINITY
    }

    /// The closest hits of many rays, in packets of consecutive ones: 16 where the CPU has AVX-512,
    /// else 8. `coherent` promises that neighbours are nearly parallel.
    pub fn intersect_packets(&self, rays: &[Ray], coherent: bool, hits: &mut [Hit]) {
        match self.width {
            16 => wide16::intersect(self, rays, coherent, hits),
            _ => wide8::intersect(self, rays, coherent, hits),
        }
    }

    /// Whether anything is on each of many rays, in packets of consecutive ones.
    pub fn occluded_packets(&self, rays: &[Ray], blocked: &mut [bool]) {
        match self.width {
            16 => wide16::occluded(self, rays, blocked),
            _ => wide8::occluded(self, rays, blocked),
        }
    }

    /// Seconds that Embree itself takes for `rays` when their packets are laid out before and
    /// nothing happens between its calls: the measure of what [`Scene::intersect_packets`]
    /// adds.
    pub fn bare_seconds(&self, rays: &[Ray]) -> Option<f64> {
        Some(match self.width {
            16 => wide16::bare_seconds(self, rays),
            _ => wide8::bare_seconds(self, rays),
        })
    }
}
