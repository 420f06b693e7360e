//! Rays against triangles: closest hit and occlusion, for single rays and for bundles, by Embree or
//! by a BVH in Rust.

mod placement;
#[cfg(feature = "embree")]
mod embree;
mod traverse;
mod build;
mod triangle;
mod bvh;

pub use crate::ffi::ray::{Hit, Ray};

use self::placement::Placement;
use crate::error::{Error, Result};
use crate::geometry::Geometry;
use std::sync::OnceLock;
use std::time::Instant;

/// Who traces the rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// Intel's Embree, when compiled in.
    Embree,
    /// The BVH in Rust, always there.
    Bvh,
}

impl Default for Backend {
    /// Embree if it is compiled in and starts on this machine, else the BVH.
    fn default() -> Self {
        static CHOICE: OnceLock<Backend> = OnceLock::new();
        *CHOICE.get_or_init(|| {
            if Accel::build(&Geometry::default(), Self::Embree).is_ok() {
                Self::Embree
            } else {
                Self::Bvh
            }
        })
    }
}

impl Backend {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Embree, Self::Bvh];

    /// The name in the command line and in reports: `embree` or `bvh`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Embree => "embree",
            Self::Bvh => "bvh",
        }
    }
}

impl std::str::FromStr for Backend {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|b| b.name() == name).ok_or_else(|| {
            Error::InvalidArgument(format!(
                "{name:?} is not a backend: choose \"embree\" or \"bvh\""
            ))
        })
    }
}

impl std::fmt::Display for Backend {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// What the caller knows about the order of many rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coherence {
    /// Camera rays of neighbouring pixels: almost parallel.
    Camera,
    /// Rays from one region in all directions, sorted so that neighbours point alike.
    Bundle,
}

/// A scene's triangles, ready for rays from any number of threads.
///
/// Equal input gives equal bits: a hit depends on the geometry, the ray, and for
/// [`Accel::intersect_many`] on the rays of its packet, never on threads. (Embree's last bits also
/// depend on the CPU's generation: with and without AVX2 and AVX-512 it runs different code.) Where
/// two triangles are hit at exactly the same distance, the BVH returns the lower (instance,
/// triangle); Embree returns the one that its traversal meets first.
pub struct Accel {
    tracer: Tracer,
    /// Instances that share the hierarchy of their mesh.
    shared: Vec<bool>,
    build_seconds: f64,
}

enum Tracer {
    #[cfg(feature = "embree")]
    Embree(crate::ffi::embree::Scene),
    Bvh(bvh::Bvh),
}

/// Calls the same function of whichever tracer there is.
macro_rules! trace {
    ($self:ident, $tracer:ident => $call:expr) => {
        match &$self.tracer {
            #[cfg(feature = "embree")]
            Tracer::Embree($tracer) => $call,
            Tracer::Bvh($tracer) => $call,
        }
    };
}

impl Accel {
    /// Builds the hierarchy. A geometry without triangles is allowed: every ray misses it.
    ///
    /// # Errors
    /// `Error::Device` if the back end is not compiled in or does not start; `Error::OutOfMemory`;
    /// `Error::InvalidArgument` if an instance names no mesh or an index no vertex.
    pub fn build(geometry: &Geometry, backend: Backend) -> Result<Self> {
        let start = Instant::now();
        placement::check(geometry)?;
        let placement = Placement::of(geometry);
        let tracer = match backend {
            #[cfg(feature = "embree")]
            Backend::Embree => Tracer::Embree(embree::build(geometry, &placement)?),
            #[cfg(not(feature = "embree"))]
            Backend::Embree => {
                return Err(Error::Device(
                    "this lumicache was compiled without Embree: choose the backend \"bvh\", or compile with the feature \"embree\"".into(),
                ));
            }
            Backend::Bvh => Tracer::Bvh(bvh::Bvh::new(geometry, &placement)),
        };
        let shared =
            (0..geometry.instances.len()).map(|i| placement.to_object(i).is_some()).collect();
        Ok(Self { tracer, shared, build_seconds: start.elapsed().as_secs_f64() })
    }

    /// True if rays are mapped into the object space of an instance, which costs precision; else
    /// its triangles were mapped into the world.
    #[inline]
    pub fn is_shared(&self, instance: u32) -> bool {
        self.shared[instance as usize]
    }

    /// The closest hit of a ray.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Hit {
        trace!(self, tracer => tracer.intersect(ray))
    }

    /// Whether anything is on a ray.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        trace!(self, tracer => tracer.occluded(ray))
    }

    /// The closest hits of many rays; rays that follow one another should be alike. Both slices
    /// must have the same length.
    ///
    /// Embree traces consecutive slices of 16 (of 8 on a CPU without AVX-512) as a packet, the last
    /// one partly filled. Such hits may differ from [`Accel::intersect`]'s in the last bits and
    /// on exact ties; with [`Coherence::Bundle`] no test has shown a difference.
    pub fn intersect_many(&self, rays: &[Ray], coherence: Coherence, hits: &mut [Hit]) {
        debug_assert_eq!(rays.len(), hits.len());
        trace!(self, tracer => tracer.intersect_packets(rays, coherence == Coherence::Camera, hits));
    }

    /// Whether anything is on each of many rays; rays that follow one another should be alike. Both
    /// slices must have the same length.
    pub fn occluded_many(&self, rays: &[Ray], blocked: &mut [bool]) {
        debug_assert_eq!(rays.len(), blocked.len());
        trace!(self, tracer => tracer.occluded_packets(rays, blocked));
    }

    /// Seconds for the closest hits of `rays` without this interface around the tracer; `None` for
    /// the BVH, which has no other.
    pub(crate) fn bare_seconds(&self, rays: &[Ray]) -> Option<f64> {
        trace!(self, tracer => tracer.bare_seconds(rays))
    }

    /// Who traces.
    pub fn backend(&self) -> Backend {
        match self.tracer {
            #[cfg(feature = "embree")]
            Tracer::Embree(_) => Backend::Embree,
            Tracer::Bvh(_) => Backend::Bvh,
        }
    }

    /// Name and version of the tracer, such as `Embree 3.13.5`.
    pub fn version(&self) -> String {
        match &self.tracer {
            #[cfg(feature = "embree")]
            Tracer::Embree(scene) => scene.device().version(),
            Tracer::Bvh(_) => bvh::VERSION.to_owned(),
        }
    }

    /// Bytes of the hierarchy and its copy of the triangles.
    pub fn memory_bytes(&self) -> usize {
        match &self.tracer {
            #[cfg(feature = "embree")]
            Tracer::Embree(scene) => scene.device().memory_bytes(),
            Tracer::Bvh(bvh) => bvh.memory_bytes(),
        }
    }

    /// How long [`Accel::build`] took.
    pub fn build_seconds(&self) -> f64 {
        self.build_seconds
    }
}
