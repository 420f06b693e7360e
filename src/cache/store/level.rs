//! The levels of a cache.

use super::radiosity::Radiosity;
use super::records::Store;
use crate::cache::payload::{Harmonics, Irradiance};
use std::sync::Arc;

/// The records of one level of bounces. Copies share them.
#[derive(Clone)]
pub struct Level {
    pub(in crate::cache) irradiance: Arc<Store<Irradiance>>,
    pub(in crate::cache) radiance: Option<Arc<Store<Harmonics>>>,
    /// What the irradiance records know beside, if they are of all light.
    pub(in crate::cache) radiosity: Option<Arc<Radiosity>>,
}

impl Level {
    /// The irradiance cache.
    pub fn irradiance(&self) -> &Store<Irradiance> {
        &self.irradiance
    }

    /// The radiance cache, if the level has one.
    pub fn radiance(&self) -> Option<&Store<Harmonics>> {
        self.radiance.as_deref()
    }

    /// Bytes that records and indexes occupy.
    pub fn bytes(&self) -> usize {
        self.irradiance.bytes()
            + self.radiance.as_ref().map_or(0, |r| r.bytes())
            + self.radiosity.as_ref().map_or(0, |r| r.bytes())
    }
}
