//! The samples of one hemisphere.

use super::probe::{Bundle, Deeper, HitChange, RadianceProbe};
use super::strata::{Density, Layout};
use crate::geometry::SurfacePoint;
use crate::math::{Color, Frame, Vec3, luminance};
use crate::sampling::{hash, stream};

/// The cosine ξ at a hit is not taken below this where estimates divide by it: 1/cos ξ has no
/// finite variance.
pub(super) const MIN_COS_HIT: f32 = 0.05;

/// Interleaved groups of samples whose means tell their variance.
pub(super) const GROUPS: usize = 8;

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

    /// The same with as many as `count` rays towards small bright surfaces.
    #[must_use]
    pub fn with_bright(mut self, count: u32) -> Self {
        self.bundle.towards_bright = count;
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
        self.fold();
    }

    /// Adds what the rays beside those of the strata brought to the strata in which they lie. Where
    /// that is more than a stratum's own ray brought, its place is the brightest of theirs.
    fn fold(&mut self) {
        let (n, b) = (self.layout.rays(), &mut self.bundle);
        if b.len() == n {
            return;
        }
        b.found.resize(n, Color::ZERO);
        let mut brightest = vec![(0.0, 0); n];
        let mut groups = [0.0; GROUPS];
        for k in n..b.len() {
            let cell = self.layout.at(b.density, b.dir_local[k]);
            b.found[cell] += b.radiance[k];
            let light = luminance(b.radiance[k]);
            if light > brightest[cell].0 {
                brightest[cell] = (light, k);
            }
            groups[k % GROUPS] += light * b.dir_local[k].z / (n as f32 * b.pdf[k]);
            for change in &mut b.change {
                let found = change.get(k).copied().unwrap_or(Color::ZERO);
                if let Some(sum) = change.get_mut(cell) {
                    *sum += found;
                }
            }
        }
        for (cell, (_, k)) in
            brightest.into_iter().enumerate().filter(|(_, (light, _))| *light > 0.0)
        {
            if luminance(b.found[cell]) > luminance(b.radiance[cell]) {
                b.dir_local[cell] = b.dir_local[k];
                b.pdf[cell] = b.pdf[k];
                b.distance[cell] = b.distance[k];
                b.normal[cell] = b.normal[k];
                b.kind[cell] = b.kind[k];
            }
            b.radiance[cell] += b.found[cell];
        }
        let mean = groups.iter().sum::<f32>() / GROUPS as f32;
        b.found_variance = groups.iter().map(|g| (g - mean).powi(2)).sum::<f32>() * GROUPS as f32
            / (GROUPS - 1) as f32;
        b.truncate(n);
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
