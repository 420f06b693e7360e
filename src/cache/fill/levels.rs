//! The one driver of the fill: all levels, deepest first, in any world.

use super::gatherer::Gatherer;
use super::points::{Appearances, FillStats, LevelPoints, ShadingPoint, extent_of};
use super::refinement::refine;
use super::rounds::Filling;
use super::world::{FillPlan, Towards, World};
use crate::cache::payload::{Harmonics, Irradiance, Payload, Projection, Reflector};
use crate::cache::record::Record;
use crate::cache::scheme::Placement;
use crate::cache::store::{Cache, Level, Store};
use crate::error::{Error, Result, check_room};
use crate::gather::RadianceProbe;
use crate::geometry::SurfacePoint;
use crate::progress::{Phase, Progress};
use crate::sampling::{hash, stream};
use rayon::prelude::*;
use std::sync::Arc;

/// Footprint of points that the camera does not see, as a share of the extent.
const DEEPER_FOOTPRINT: f32 = 0.010;

/// What fills did so far.
#[derive(Clone, Debug)]
pub struct FillReport {
    /// For the irradiance cache of each level.
    pub irradiance: Vec<FillStats>,
    /// For the radiance cache of each level.
    pub radiance: Vec<FillStats>,
}

impl FillReport {
    /// A report of nothing, for the levels of `cache`.
    pub fn new(cache: &Cache) -> Self {
        let none = |count: u8| vec![FillStats::default(); usize::from(count)];
        Self { irradiance: none(cache.level_count()), radiance: none(cache.radiance_level_count()) }
    }

    /// Rays of all gathers.
    pub fn gather_rays(&self) -> u64 {
        self.irradiance.iter().chain(&self.radiance).map(|f| f.gather_rays).sum()
    }

    /// How often refinement lowered the allowed error of a record.
    pub fn reductions(&self) -> u64 {
        self.irradiance.iter().chain(&self.radiance).map(|f| f.reductions).sum()
    }
}

impl Cache {
    /// What records are wanted at a point of `level` whose glossy lobes ask for `order` bands:
    /// irradiance, or radiance where lobes ask for it or the scheme has radiance on all surfaces.
    pub fn shading_point(
        &self, level: u8, number: u32, point: SurfacePoint, order: u8,
    ) -> ShadingPoint {
        let scheme = self.scheme();
        let everywhere = scheme.whole() && level < self.radiance_level_count();
        let order = if everywhere { scheme.glossy().order } else { order };
        ShadingPoint { number, point, irradiance: order == 0, order }
    }

    /// Fills all levels with what `points` need beside the records that there are, deepest first;
    /// on each level irradiance before radiance. Gathers read what deeper levels know of both.
    /// Where the scheme asks for refinement, the first level is refined. Adds to `report`, and
    /// returns for each point how many records of its kind existed when it was visited.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; the levels have the records so far then. [`Error::OutOfMemory`]; the
    /// level that was being filled has the records of before.
    pub fn fill_levels(
        &mut self, world: &dyn World, points: &[ShadingPoint], plan: &FillPlan,
        report: &mut FillReport, progress: &Progress,
    ) -> Result<Vec<u32>> {
        let mut births = vec![u32::MAX; points.len()];
        let count = self.level_count();
        if count == 0 {
            // Light without bounces has nothing to cache.
            return Ok(births);
        }
        // The points of a level stand in two lists, and once more while it is filled.
        let bytes = 4 * size_of_val(points) as u64;
        check_room(format_args!("{} shading points", points.len()), bytes)?;
        let places: Vec<SurfacePoint> = points.iter().map(|p| p.point).collect();
        self.settle(&places);
        world.prepare(&places, plan.seed);
        // A radiosity cache takes the place of all levels behind the first.
        let transfer = world.transfer().filter(|_| self.takes_radiosity());
        let count = if transfer.is_some() { 1 } else { count };
        if let Some(transfer) = transfer {
            let solved = self.fill_radiosity((world, &*transfer), &places, plan, progress)?;
            report.irradiance[1].add(&solved);
        }
        let mut levels = vec![points.to_vec()];
        for level in 1..count {
            let next = self.next_points(world, level, &levels[usize::from(level) - 1], plan);
            levels.push(next);
        }
        let wanted = |p: &ShadingPoint| u64::from(p.irradiance) + u64::from(p.order > 0);
        progress.start(Phase::Fill, levels.iter().flatten().map(wanted).sum());
        for (level, points) in (0..count).zip(levels).rev() {
            let round = if level == 0 { plan.round } else { 0 };
            for radiance in [false, true] {
                if radiance && level >= self.radiance_level_count() {
                    continue;
                }
                let chosen = |p: &ShadingPoint| if radiance { p.order > 0 } else { p.irradiance };
                let (numbers, chosen): (Vec<usize>, Vec<ShadingPoint>) =
                    points.iter().copied().enumerate().filter(|(_, p)| chosen(p)).unzip();
                let points = level_points(&chosen, round);
                let made = self.fill_level(
                    world,
                    (level, radiance),
                    &chosen,
                    &points,
                    plan.seed,
                    report,
                    progress,
                )?;
                if level == 0 {
                    numbers.iter().zip(made).for_each(|(&i, birth)| births[i] = birth);
                }
            }
        }
        Ok(births)
    }

    /// Takes the extent of `points`, unless it is known.
    fn settle(&mut self, points: &[SurfacePoint]) {
        if self.extent() == 0.0 && !points.is_empty() {
            *self = self.clone().with_extent(extent_of(points));
        }
    }

    /// Points of `level`, from which light reaches `before`.
    fn next_points(
        &self, world: &dyn World, level: u8, before: &[ShadingPoint], plan: &FillPlan,
    ) -> Vec<ShadingPoint> {
        let before: Vec<SurfacePoint> = before.iter().map(|p| p.point).collect();
        let seed = hash(&[plan.seed, stream::DEEPER_POINTS, u64::from(level)]);
        let radiance = level < self.radiance_level_count();
        let found = world.next_points(&before, level, radiance, plan.deeper_points, seed);
        let footprint = DEEPER_FOOTPRINT * self.extent();
        let wanted = |(k, (point, order))| {
            self.shading_point(level, k, SurfacePoint { footprint, ..point }, order)
        };
        (0..).zip(found).map(wanted).collect()
    }

    /// Fills one cache of one level, and refines the first level where the scheme asks for it.
    #[expect(clippy::too_many_arguments, reason = "the state of one fill")]
    fn fill_level(
        &mut self, world: &dyn World, (level, radiance): (u8, bool), chosen: &[ShadingPoint],
        points: &LevelPoints, seed: u64, report: &mut FillReport, progress: &Progress,
    ) -> Result<Vec<u32>> {
        let (probe, reflector) = (world.probe(), world.reflector());
        let stats = if radiance {
            if let (0, Some(towards), Some(reflector)) = (level, world.towards_viewer(), reflector)
            {
                self.see_from(reflector, towards);
            }
            self.fill_radiance(probe, reflector, level, points, seed, progress)?
        } else {
            self.fill(probe, level, points, seed, progress)?
        };
        let sum = if radiance { &mut report.radiance } else { &mut report.irradiance };
        let sum = &mut sum[usize::from(level)];
        sum.add(&stats);
        if level == 0
            && self.scheme().refinement.is_some()
            && let Some(looks) = world.appearances(chosen, radiance)
        {
            let refined = if radiance {
                self.refine_radiance(probe, reflector, level, points, &looks, seed, progress)?
            } else {
                self.refine(probe, level, points, &looks, seed, progress)?
            };
            sum.add(&refined);
        }
        if radiance {
            self.derive_irradiance(level);
        }
        Ok(stats.births)
    }

    /// Makes irradiance records until every point of `points` on `level` is covered, beside those
    /// that the level has already. Deeper levels must be filled already, if the gathers are to use
    /// them. The same arguments give the same records on any number of threads.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; the level has the records so far then. [`Error::OutOfMemory`]; the
    /// level has the records of before.
    pub fn fill(
        &mut self, probe: &dyn RadianceProbe, level: u8, points: &LevelPoints, seed: u64,
        progress: &Progress,
    ) -> Result<FillStats> {
        self.settle(&points.points);
        let gatherer = Gatherer::new(self.rules(), probe, self.behind(level + 1), (), level, seed);
        let before = copied(level, self.level(level).map(Level::irradiance))?;
        let (store, stats) = extend::<Irradiance>(gatherer, before, points, progress);
        if let Some(store) = store {
            self.levels[usize::from(level)].irradiance = Arc::new(store);
        }
        stats
    }

    /// As [`Cache::fill`], in the radiance cache of `level`. `reflector` tells how surfaces
    /// reflect, for schemes that place records by outgoing radiance. Nothing is made where the
    /// level has no radiance cache.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; the level has the records so far then. [`Error::OutOfMemory`]; the
    /// level has the records of before.
    pub fn fill_radiance(
        &mut self, probe: &dyn RadianceProbe, reflector: Option<&dyn Reflector>, level: u8,
        points: &LevelPoints, seed: u64, progress: &Progress,
    ) -> Result<FillStats> {
        self.settle(&points.points);
        let Some(gatherer) = self.radiance_gatherer(probe, reflector, level, seed) else {
            return Ok(FillStats::default());
        };
        let before = copied(level, self.level(level).and_then(Level::radiance))?;
        let (store, stats) = extend::<Harmonics>(gatherer, before, points, progress);
        if let Some(store) = store {
            self.levels[usize::from(level)].radiance = Some(Arc::new(store));
        }
        stats
    }

    /// Refines the irradiance records of a filled level until they have fully converged with
    /// respect to `points` [Krivanek06, Algorithm 1]:
    ///
    /// 1. each point has a record that is valid there, and
    /// 2. where more than one is valid, leaving one of them out makes no visible difference,
    ///    `|Y(L1) - Y(L2)| <= c Y(L1) + max(σ(L1), σ(L2))`, L1 the radiance with the record and L2
    ///    without it, direct light included in both, c the scheme's `contrast`.
    ///
    /// Of the records that violate the second condition at x, the one of the lowest weight is kept
    /// from x by lowering its error to a_i = err_i(x) - ε, err_i with the term of the normals,
    /// which the paper forgets here: without it records on curved surfaces shrink further than
    /// the point asks, to nothing where positions coincide. No record goes below
    /// [`RadiusRule::floor`](crate::cache::RadiusRule::floor); one that has arrived there may
    /// go on violating the condition. Points left without a record get new ones, whose error is
    /// 1.4 times that of the nearest one.
    ///
    /// The lengths of the points' lists are not bounded, so none of the contributions that the
    /// condition is about is left out.
    ///
    /// Gathers do not see the level meanwhile.
    ///
    /// # Errors
    /// [`Error::Cancelled`], and the level has the records so far then; [`Error::OutOfMemory`], and
    /// the level has no records then; [`Error::InvalidArgument`] if points and appearances are not
    /// of one length or the level is not filled.
    pub fn refine(
        &mut self, probe: &dyn RadianceProbe, level: u8, points: &LevelPoints,
        appearances: &Appearances, seed: u64, progress: &Progress,
    ) -> Result<FillStats> {
        let records = copied(level, self.level(level).map(Level::irradiance))?;
        if records.is_empty() && !points.points.is_empty() {
            let what = format!("level {level} cannot be refined before it is filled");
            return Err(Error::InvalidArgument(what));
        }
        self.replace(level, Vec::new());
        let gatherer = Gatherer::new(self.rules(), probe, self.behind(level + 1), (), level, seed);
        let (store, stats) = refine(gatherer, records, points, appearances, progress)?;
        self.levels[usize::from(level)].irradiance = Arc::new(store);
        stats
    }

    /// As [`Cache::refine`] for radiance records. They are compared by the radiance that leaves the
    /// points by all their lobes, so that their density follows the sharpness of the lobes and the
    /// direction of view.
    ///
    /// # Errors
    /// Those of [`Cache::refine`].
    #[expect(clippy::too_many_arguments, reason = "those of fill_radiance and the appearances")]
    pub fn refine_radiance(
        &mut self, probe: &dyn RadianceProbe, reflector: Option<&dyn Reflector>, level: u8,
        points: &LevelPoints, appearances: &Appearances, seed: u64, progress: &Progress,
    ) -> Result<FillStats> {
        let Some(gatherer) = self.radiance_gatherer(probe, reflector, level, seed) else {
            return Ok(FillStats::default());
        };
        let records = copied(level, self.level(level).and_then(Level::radiance))?;
        let (store, stats) = refine(gatherer, records, points, appearances, progress)?;
        self.levels[usize::from(level)].radiance = Some(Arc::new(store));
        stats
    }

    fn radiance_gatherer<'a>(
        &'a self, probe: &'a dyn RadianceProbe, reflector: Option<&'a dyn Reflector>, level: u8,
        seed: u64,
    ) -> Option<Gatherer<'a, Harmonics>> {
        let context = Projection { projector: self.projector()?, reflector };
        self.level(level)?.radiance()?;
        let (rules, seed) = (self.radiance_rules()?, hash(&[seed, stream::RADIANCE_RECORDS]));
        Some(Gatherer::new(rules, probe, self.behind(level + 1), context, level, seed))
    }

    /// Gives the radiance records of the first level the areas that another viewer needs, `towards`
    /// being the direction to the viewer from a position, where the scheme places records by what
    /// the viewer sees; else nothing changes. Fences and orders stay as they are.
    pub fn see_from(&mut self, reflector: &dyn Reflector, towards: &Towards) {
        let (Some(projector), Some(rules)) = (self.projector(), self.radiance_rules()) else {
            return;
        };
        if rules.scheme.glossy().metric.placement() != Placement::View {
            return;
        }
        let rule = rules.when_filled(0);
        let projection = Projection { projector, reflector: Some(reflector) };
        let mut placed = self.radiance_records(0).to_vec();
        placed.par_iter_mut().for_each(|r| projection.place(r, towards(r.position), &rule));
        let store = rules.clamped_store(0, placed);
        self.levels[0].radiance = Some(Arc::new(store));
    }
}

/// What the records `before` and those that `points` need become, `None` if no new one was needed,
/// and what was done. The latter is [`Error::Cancelled`] where the former are only the records so
/// far.
fn extend<P: Payload>(
    gatherer: Gatherer<P>, before: Vec<Record<P>>, points: &LevelPoints, progress: &Progress,
) -> (Option<Store<P>>, Result<FillStats>) {
    let count = before.len();
    let mut filling = Filling::new(gatherer, before);
    let end = filling.run(points, progress);
    let Filling { records, stats, .. } = filling;
    if let Err(error @ Error::OutOfMemory(_)) = end {
        return (None, Err(error));
    }
    let store = (records.len() > count).then(|| gatherer.rules.store(gatherer.level, records));
    (store, end.map(|()| stats))
}

/// The records of a store of `level`, which stay where they are until others take their place.
fn copied<P: Payload>(level: u8, store: Option<&Store<P>>) -> Result<Vec<Record<P>>> {
    let Some(store) = store else { return Ok(Vec::new()) };
    // What finds them is made anew, too.
    check_room(format_args!("the records of level {level}"), 2 * store.bytes() as u64)?;
    Ok(store.records().to_vec())
}

fn level_points(chosen: &[ShadingPoint], round: usize) -> LevelPoints {
    let points = chosen.iter().map(|p| p.point).collect();
    LevelPoints { points, orders: chosen.iter().map(|p| p.order).collect(), round }
}
