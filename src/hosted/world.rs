//! The scene of a host as the world of a cache.

use super::probe::HostProbe;
use crate::cache::{Appearances, ShadingPoint, World};
use crate::gather::RadianceProbe;
use crate::geometry::SurfacePoint;

impl World for HostProbe<'_> {
    fn probe(&self) -> &dyn RadianceProbe {
        self
    }

    fn next_points(
        &self, before: &[SurfacePoint], level: u8, _: bool, count: usize, seed: u64,
    ) -> Vec<(SurfacePoint, u8)> {
        let found = self.meet(before, count, u32::from(level), seed);
        found.into_iter().map(|point| (point, 0)).collect()
    }

    /// Little is known of the surfaces of a host: records are not refined.
    fn appearances(&self, _: &[ShadingPoint], _: bool) -> Option<Appearances<'_>> {
        None
    }
}
