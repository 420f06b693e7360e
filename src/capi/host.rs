//! The host's callback as the tracer of a hosted scene.

use super::abi::{
    LUMI_HOST_CONCURRENT, LUMI_HOST_ENV_IN_MISS, LUMI_HOST_FULL, lumi_host_desc, lumi_ray_batch,
    only,
};
use super::status::{Fault, Outcome};
use crate::error::{Error, Result};
use crate::ffi::mxcsr::as_caller;
use crate::geometry::Aabb;
use crate::hosted::{Batch, Description, Host};
use std::ffi::c_void;
use std::ops::Range;

type Trace = unsafe extern "C" fn(*mut c_void, *mut lumi_ray_batch) -> i32;

struct Callback {
    trace: Trace,
    user: *mut c_void,
}

// SAFETY: the host's pointer is only handed back to the host's function, on the threads that its
// flags allow.
unsafe impl Send for Callback {}
// SAFETY: as above.
unsafe impl Sync for Callback {}

impl Callback {
    fn call(&self, batch: &mut Batch, range: Range<usize>) -> Result<()> {
        let n = range.len();
        let mut desc = lumi_ray_batch {
            struct_size: size_of::<lumi_ray_batch>() as u32,
            n: n as u32,
            origin: batch.origin[range.clone()].as_ptr().cast(),
            dir: batch.dir[range.clone()].as_ptr().cast(),
            bounce: batch.bounce[range.clone()].as_ptr(),
            seed: batch.seed[range.clone()].as_ptr(),
            radiance: batch.radiance[range.clone()].as_mut_ptr().cast(),
            distance: batch.distance[range.clone()].as_mut_ptr(),
            normal: batch.normal[range.clone()].as_mut_ptr().cast(),
            albedo: batch.albedo[range].as_mut_ptr().cast(),
        };
        // SAFETY: the arrays have n elements and live during the call; the host has promised to
        // fill no more than that. A failing host unwinds no further than this `extern "C"`
        // call.
        let code = as_caller(|| unsafe { (self.trace)(self.user, &raw mut desc) });
        if code != 0 {
            return Err(Error::Host(format!("the host's tracer stopped with code {code}")));
        }
        if desc.n as usize != n {
            let text =
                format!("the host's tracer was given {n} rays and says that they are {}", desc.n);
            return Err(Error::Host(text));
        }
        Ok(())
    }
}

/// The host of `desc`.
pub(super) fn host_of(desc: &lumi_host_desc) -> Outcome<Host> {
    only(LUMI_HOST_CONCURRENT | LUMI_HOST_FULL | LUMI_HOST_ENV_IN_MISS, desc.flags, "host")?;
    let trace = desc.trace.ok_or_else(|| Fault::argument("host: the tracer is NULL"))?;
    let has = |flag: u32| desc.flags & flag != 0;
    let or = |rays: u32, default: usize| if rays == 0 { default } else { rays as usize };
    let description = Description {
        bounds: Aabb { min: desc.bounds_min.into(), max: desc.bounds_max.into() },
        scene_hash: desc.scene_hash,
        all_bounces: has(LUMI_HOST_FULL),
        concurrent: has(LUMI_HOST_CONCURRENT),
        environment: has(LUMI_HOST_ENV_IN_MISS),
        preferred_batch: or(desc.preferred_batch, Description::PREFERRED_BATCH),
        max_batch: or(desc.max_batch, u32::MAX as usize),
    };
    let callback = Callback { trace, user: desc.user };
    Ok(Host::new(description, move |batch, range| callback.call(batch, range))?)
}
