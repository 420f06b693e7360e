//! A scheme with the records made under it.

use super::index::Answer;
use super::level::Level;
use super::radiosity::Radiosity;
use super::records::{Rules, Store};
use crate::cache::payload::{Harmonics, Irradiance, Projector};
use crate::cache::record::{RadiusRule, Record};
use crate::cache::scheme::Scheme;
use crate::gather::{Arriving, Deeper, LobeCoefficients};
use crate::geometry::SurfacePoint;
use crate::math::Color;
use std::sync::Arc;

/// A scheme with the records made under it: level 0 for what the camera sees, level k for points k
/// bounces behind that. Every level has an irradiance cache; the first ones may have a radiance
/// cache, too. Copies share their levels.
#[derive(Clone)]
pub struct Cache {
    scheme: Arc<Scheme>,
    pub(in crate::cache) extent: f32,
    /// Light paths have no bound on their length, so that every level holds the same quantity and
    /// any may stand in for another.
    unlimited: bool,
    pub(in crate::cache) levels: Vec<Level>,
    /// What makes and reads radiance records, if there are any.
    projector: Option<Arc<Projector>>,
}

impl Cache {
    /// An empty cache for light paths of at most `max_bounces` interactions after the camera hit
    /// (`u32::MAX`: no bound). It has the scheme's levels, but no more than the paths have bounces.
    pub fn new(scheme: impl Into<Arc<Scheme>>, max_bounces: u32) -> Self {
        let scheme = scheme.into();
        let count = u32::from(scheme.levels).min(max_bounces);
        let unlimited = max_bounces == u32::MAX;
        let mut cache =
            Self { scheme, extent: 0.0, unlimited, levels: Vec::new(), projector: None };
        for level in 0..count {
            let empty = cache.rules().store(level as u8, Vec::new());
            cache.levels.push(Level {
                irradiance: Arc::new(empty),
                radiance: None,
                radiosity: None,
            });
        }
        cache
    }

    /// The same cache with radiance caches on as many levels as the scheme says. Nothing changes
    /// where the cache has radiance caches already or the scheme caches no radiance.
    #[must_use]
    pub fn with_radiance(mut self) -> Self {
        if self.projector.is_some() || self.scheme.glossy.is_none() {
            return self;
        }
        let scheme = Arc::new(self.scheme.for_radiance());
        let count = usize::from(scheme.levels);
        self.projector = Some(Arc::new(Projector::new(scheme)));
        let rules = self.radiance_rules().expect("there is a projector now");
        let empty = |k: usize| Some(Arc::new(rules.store(k as u8, Vec::new())));
        let empty: Vec<_> = (0..self.levels.len().min(count)).map(empty).collect();
        self.levels.iter_mut().zip(empty).for_each(|(level, empty)| level.radiance = empty);
        self
    }

    /// The scheme.
    pub fn scheme(&self) -> &Arc<Scheme> {
        &self.scheme
    }

    /// The length that radii and errors are relative to, 0 until there are points: the extent of
    /// the first points that the cache was filled for ([`extent`](crate::geometry::extent)).
    pub fn extent(&self) -> f32 {
        self.extent
    }

    /// The same cache with another extent, without its records.
    #[must_use]
    pub fn with_extent(mut self, extent: f32) -> Self {
        self.extent = extent;
        for level in 0..self.level_count() {
            let empty = Arc::new(self.rules().store(level, Vec::new()));
            let radiance = self.radiance_rules().map(|r| Arc::new(r.store(level, Vec::new())));
            let level = &mut self.levels[usize::from(level)];
            level.irradiance = empty;
            level.radiosity = None;
            level.radiance = level.radiance.take().and(radiance);
        }
        self
    }

    /// Number of levels, filled or not.
    pub fn level_count(&self) -> u8 {
        self.levels.len() as u8
    }

    /// A level, if it exists.
    pub fn level(&self, level: u8) -> Option<&Level> {
        self.levels.get(usize::from(level))
    }

    /// The irradiance records of a level; none if it does not exist.
    pub fn records(&self, level: u8) -> &[Record<Irradiance>] {
        self.level(level).map_or(&[], |l| l.irradiance.records())
    }

    /// The radiance records of a level; none if it has no radiance cache.
    pub fn radiance_records(&self, level: u8) -> &[Record<Harmonics>] {
        self.level(level).and_then(Level::radiance).map_or(&[], Store::records)
    }

    /// What makes and reads the radiance records, if the cache has radiance caches.
    pub fn projector(&self) -> Option<&Arc<Projector>> {
        self.projector.as_ref()
    }

    /// Number of levels that have a radiance cache.
    pub fn radiance_level_count(&self) -> u8 {
        self.levels.iter().take_while(|l| l.radiance.is_some()).count() as u8
    }

    /// Number of irradiance records on all levels.
    pub fn record_count(&self) -> usize {
        self.levels.iter().map(|l| l.irradiance.len()).sum()
    }

    /// Number of radiance records on all levels.
    pub fn radiance_record_count(&self) -> usize {
        self.levels.iter().filter_map(Level::radiance).map(Store::len).sum()
    }

    /// Bytes that records and indexes occupy.
    pub fn bytes(&self) -> usize {
        self.levels.iter().map(Level::bytes).sum()
    }

    /// Puts `records` in the place of the irradiance records of `level`. Their lengths are clamped
    /// anew to those of their neighbours, if the scheme asks for it.
    ///
    /// # Panics
    /// When the cache has no such level.
    pub fn replace(&mut self, level: u8, records: Vec<Record<Irradiance>>) {
        let store = self.rules().clamped_store(level, records);
        let level = &mut self.levels[usize::from(level)];
        (level.irradiance, level.radiosity) = (Arc::new(store), None);
    }

    /// How many irradiance records of `level`, the first ones, are those of radiance records:
    /// where radiance records answer for all surfaces. They keep the rules of radiance records.
    pub(in crate::cache) fn derived_count(&self, level: u8) -> usize {
        if self.scheme.whole() { self.radiance_records(level).len() } else { 0 }
    }

    /// Gives `level` the irradiance of its radiance records, if these answer for all surfaces.
    pub(in crate::cache) fn derive_irradiance(&mut self, level: u8) {
        let level = &mut self.levels[usize::from(level)];
        if let Some(radiance) = level.radiance.as_ref().filter(|_| self.scheme.whole()) {
            level.irradiance = Arc::new(radiance.irradiance());
        }
    }

    /// Takes over the radiance caches of `other`, a cache under the same scheme, beside the
    /// irradiance records that are here.
    pub fn share_radiance(&mut self, other: &Self) {
        self.projector.clone_from(&other.projector);
        for level in 0..self.level_count().min(other.level_count()) {
            let place = usize::from(level);
            self.levels[place].radiance.clone_from(&other.levels[place].radiance);
            if self.derived_count(level) > 0 {
                let own = self.levels[place].irradiance.clone();
                self.derive_irradiance(level);
                if !own.is_empty() {
                    self.replace(level, [self.records(level), own.records()].concat());
                }
            }
        }
    }

    /// The cache of all light behind the first surface, if it is filled. It takes the place of
    /// level 1.
    pub fn radiosity(&self) -> Option<&Radiosity> {
        self.levels.get(1)?.radiosity.as_deref()
    }

    /// True if the levels behind the first may be a radiosity cache, and hold nothing else.
    pub(in crate::cache) fn takes_radiosity(&self) -> bool {
        let plain = |l: &Level| l.radiosity.is_none() && !l.irradiance.is_empty();
        self.unlimited
            && self.scheme.radiosity.is_some()
            && self.levels.len() > 1
            && !self.levels[1..].iter().any(plain)
    }

    /// A cache that places records of all light beside `known`.
    pub(in crate::cache) fn placing_radiosity(&self, known: Vec<Record<Irradiance>>) -> Self {
        let mut placed = Self::new(self.scheme.for_radiosity(), u32::MAX).with_extent(self.extent);
        if !known.is_empty() {
            placed.replace(0, known);
        }
        placed
    }

    /// The radiosity cache of `records`, which `placed` has placed.
    pub(in crate::cache) fn radiosity_of(
        placed: &Self, records: Vec<Record<Irradiance>>,
    ) -> Radiosity {
        let rules = placed.rules();
        let radii = rules.radii(&records);
        Radiosity::new(Arc::new(rules.store(0, records)), radii)
    }

    /// Puts a radiosity cache in the place of level 1.
    pub(in crate::cache) fn set_radiosity(&mut self, radiosity: Radiosity) {
        let level = &mut self.levels[1];
        level.irradiance = radiosity.store().clone();
        level.radiosity = Some(Arc::new(radiosity));
    }

    /// Irradiance of indirect light at a point of `level` from the records with ids below `limit`.
    #[inline]
    pub fn lookup(&self, level: u8, at: &SurfacePoint, limit: u32) -> Option<Answer> {
        self.level(level)?.irradiance.lookup(at, limit)
    }

    /// The same from the radiance cache, with the radiance that leaves by `lobe`: see
    /// [`Store::lookup_lobe`].
    pub fn lookup_lobe(
        &self, level: u8, at: &SurfacePoint, limit: u32, lobe: &mut LobeCoefficients,
    ) -> Option<Answer> {
        self.level(level)?.radiance()?.lookup_lobe(self.projector()?, at, limit, lobe)
    }

    /// The rules of irradiance records.
    pub(in crate::cache) fn rules(&self) -> Rules<'_> {
        Rules { scheme: &self.scheme, extent: self.extent }
    }

    /// The rules of radiance records.
    pub(in crate::cache) fn radiance_rules(&self) -> Option<Rules<'_>> {
        let projector = self.projector.as_ref()?;
        Some(Rules { scheme: projector.scheme(), extent: self.extent })
    }

    /// How far the irradiance records of `level` are valid while it fills, smoothing left out.
    pub fn radius_rule(&self, level: u8) -> RadiusRule {
        if self.level(level).is_some_and(|l| l.radiosity.is_some()) {
            let scheme = self.scheme.for_radiosity();
            return Rules { scheme: &scheme, extent: self.extent }.while_filling(0);
        }
        self.rules().while_filling(level)
    }

    /// The same of radiance records, if the cache has radiance caches.
    pub fn radiance_radius_rule(&self, level: u8) -> Option<RadiusRule> {
        Some(self.radiance_rules()?.while_filling(level))
    }

    /// What gathers know of light at hits: all irradiance, and radiance from level `first` on.
    pub fn behind(&self, first: u8) -> Behind<'_> {
        Behind { cache: self, first }
    }
}

/// A cache as gathers and paths see it.
#[derive(Clone, Copy)]
pub struct Behind<'a> {
    cache: &'a Cache,
    /// The first level whose radiance cache answers.
    first: u8,
}

impl Behind<'_> {
    fn radiance_levels(&self) -> impl Iterator<Item = (u8, &Store<Harmonics>)> {
        let levels = (0..).zip(&self.cache.levels).skip(usize::from(self.first));
        levels.map_while(|(k, level)| Some((k, level.radiance()?)))
    }
}

impl Deeper for Behind<'_> {
    /// With bounded paths records of exactly `level` answer: those of another level hold light of
    /// more or fewer bounces. Without a bound all levels hold the same quantity: the first filled
    /// one that covers the point answers, so the most accurate.
    #[inline]
    fn irradiance(&self, level: u8, at: &SurfacePoint) -> Option<Color> {
        let found = if self.cache.unlimited {
            let mut levels = self.cache.levels.iter().filter(|l| l.radiosity.is_none());
            levels.find_map(|l| l.irradiance.lookup(at, u32::MAX))
        } else {
            self.cache.lookup(level, at, u32::MAX)
        };
        found.map(|a| a.irradiance)
    }

    #[inline]
    fn radiosity(&self, at: &SurfacePoint, longest: f32) -> Option<Arriving> {
        self.cache.radiosity()?.lookup(at, longest)
    }

    fn has_radiosity(&self) -> bool {
        self.cache.radiosity().is_some()
    }

    fn has_radiance(&self) -> bool {
        self.radiance_levels().next().is_some()
    }

    fn radiance(
        &self, level: u8, at: &SurfacePoint, lobe: &mut LobeCoefficients,
    ) -> Option<(Color, Color)> {
        let projector = self.cache.projector()?;
        let found = self
            .radiance_levels()
            .filter(|(k, _)| self.cache.unlimited || *k == level)
            .find_map(|(_, store)| store.lookup_lobe(projector, at, u32::MAX, lobe))?;
        Some((found.irradiance, found.glossy))
    }
}
