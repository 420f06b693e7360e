//! The samples of one hemisphere.

use super::probe::{Bundle, Deeper, HitChange, RadianceProbe};
use super::strata::{Density, Layout};
use crate::geometry::SurfacePoint;
use crate::math::{Color, Frame, Vec3};
use crate::sampling::{hash, stream};

/// The cosine ξ at a hit is not taken below this where estimates divide by it: 1/cos ξ has no
/// finite variance.
pub(super) const MIN_COS_HIT: f32 = 0.05;

/// The samples of one hemisphere and the estimates made from them.
///
/// Estimates weigh sample k by `Ω_k = 1/(N p_k)`, so they hold for any density.
pub struct HemisphereSamples {
    pub(super) frame: Frame,
    pub(super) layout: Layout,
    pub(super) bundle: Bundle,
}

impl HemisphereSamples {
    /// An empty gather; its buffers are reused by every [`HemisphereSamples::gather`].
    pub fn new(layout: Layout, density: Density) -> Self {
        Self {
            frame: Frame::from_normal(Vec3::Z),
            layout,
            bundle: Bundle { density, ..Bundle::default() },
        }
    }

    /// The same with `count` light paths joined to every gather.
    #[must_use]
    pub fn with_light_paths(mut self, count: u32) -> Self {
        self.bundle.light_paths = count;
        self
    }

    /// The same gather that asks how the radiance of hits changes by the method `how`.
    #[must_use]
    pub fn with_change(mut self, how: HitChange) -> Self {
        self.bundle.hit_change = how;
        self
    }

    /// The change of the radiance of hits along each tangent, if the probe told it.
    pub(super) fn change(&self) -> Option<[&[Color]; 2]> {
        let [s, t] = &self.bundle.change;
        (s.len() == self.bundle.len() && t.len() == s.len() && !s.is_empty()).then_some([s, t])
    }

    /// Casts the rays of one hemisphere around `at`. `seed` fixes the jitter and every random
    /// choice of the probe.
    pub fn gather(
        &mut self, probe: &dyn RadianceProbe, at: &SurfacePoint, level: u8, deeper: &dyn Deeper,
        seed: u64,
    ) {
        self.frame = at.frame;
        self.bundle.reset(self.layout.rays());
        self.layout.directions(
            self.bundle.density,
            seed,
            &mut self.bundle.dir_local,
            &mut self.bundle.pdf,
        );
        self.bundle.seed = hash(&[seed, stream::RAYS]);
        probe.incoming(at, level, deeper, &mut self.bundle);
    }

    /// The frame that local directions refer to.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The arrangement of the samples.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// The samples themselves.
    pub fn bundle(&self) -> &Bundle {
        &self.bundle
    }

    /// Ω_k = 1/(N p_k), the solid angle that sample `k` stands for.
    #[inline]
    pub(super) fn solid_angle(&self, k: usize) -> f32 {
        1.0 / (self.bundle.len() as f32 * self.bundle.pdf[k])
    }
}
