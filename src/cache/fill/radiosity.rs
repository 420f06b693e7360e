//! Filling the radiosity cache: where its records lie, which records the rays of others end in, and
//! the sum over all bounces.
//!
//! Each record traces its rays once. What they find is the light of sources and shares of the
//! irradiance of other records, so the irradiance of all records is the solution of a system of
//! linear equations, which sweeps over the shares solve: one bounce of light each. All bounces cost
//! no ray more than one. The idea is that of radiosity [Goral84], with records of the irradiance
//! cache in the place of patches.

use super::points::{FillStats, LevelPoints};
use super::world::{Casting, FillPlan, Found, Share, Transfer, World};
use crate::cache::payload::{Irradiance, Lit};
use crate::cache::record::Record;
use crate::cache::scheme::RadiositySettings;
use crate::cache::store::Cache;
use crate::error::{Error, Result, check_room};
use crate::gather::Layout;
use crate::geometry::SurfacePoint;
use crate::math::Color;
use crate::progress::{Phase, Progress};
use crate::sampling::{hash, stream};
use rayon::prelude::*;
use std::collections::HashMap;

/// Bounces after which light reaches the surfaces that get records.
const BOUNCES: u64 = 3;
/// Sweeps end when one changes the light by less than this share.
const SETTLED: f32 = 1e-4;
/// Most sweeps.
const SWEEPS: usize = 1000;
/// Bytes that what one ray found takes, with its shares.
const BYTES_PER_RAY: u64 = 160;

/// What a record receives.
struct Row {
    at: SurfacePoint,
    casting: Casting,
    /// By its light samples.
    direct: Color,
    rays: Vec<Found>,
}

impl Row {
    /// Irradiance straight from light sources.
    fn lit(&self) -> Color {
        self.direct + self.rays.iter().map(|r| r.direct).sum::<Color>()
    }
}

impl Cache {
    /// Fills the radiosity cache with the light that what is seen from `visible` receives, beside
    /// the records that there are.
    pub(super) fn fill_radiosity(
        &mut self, (world, transfer): (&dyn World, &dyn Transfer), visible: &[SurfacePoint],
        plan: &FillPlan, progress: &Progress,
    ) -> Result<FillStats> {
        let settings = self.scheme().radiosity.unwrap_or_default();
        let seed = hash(&[plan.seed, stream::RADIOSITY]);
        let points = self.radiosity_points(world, visible, seed);
        progress.start(Phase::Solve, 2 * points.len() as u64);
        let known = self.radiosity().map_or(&[][..], |r| r.records());
        let (first, old) = (known.len(), light_of(known));
        let mut placed = self.placing_radiosity(known.to_vec());
        let level = LevelPoints::from(points);
        let mut stats = placed.fill(transfer.distances(), 0, &level, seed, progress)?;
        let mut records = placed.records(0).to_vec();
        let new = records.len() - first;
        if new == 0 {
            return Ok(stats);
        }
        progress.extend(new as u64 * u64::from(settings.rays));
        let bytes = new as u64 * u64::from(settings.rays) * BYTES_PER_RAY;
        check_room(format_args!("the rays of {new} records of all light"), bytes)?;

        let bits = |p: &SurfacePoint| p.position.to_array().map(f32::to_bits);
        let places: HashMap<[u32; 3], &SurfacePoint> =
            level.points.iter().map(|p| (bits(p), p)).collect();
        let strata = Layout::concentric(settings.rays).rays() as u32;
        let aimed = (self.scheme().gather.bright * strata as f32).round() as u32;
        let every: Vec<u32> = (0..strata + aimed).collect();
        let mut rows: Vec<Row> = records[first..]
            .par_iter()
            .map(|r| {
                let plain = SurfacePoint::plain(r.position, r.normal);
                let at = places.get(&bits(&plain)).map_or(plain, |p| **p);
                let [x, y, z] = bits(&plain).map(u64::from);
                let seed = hash(&[seed, x, y, z]);
                let (rays, lights) = (settings.rays, settings.lights);
                let casting = Casting { rays, aimed, lights, seed };
                Row { at, casting, direct: transfer.direct(&at, casting), rays: Vec::new() }
            })
            .collect();

        let blurred = Self::radiosity_of(&placed, records.clone());
        rows.par_iter_mut().for_each(|row| {
            if !progress.is_cancelled() {
                row.rays = transfer.cast(&row.at, row.casting, &every, &blurred);
                progress.advance(every.len() as u64);
            }
        });
        for (record, row) in records[first..].iter_mut().zip(&rows) {
            record.payload.lit = Some(Lit { irradiance: row.lit(), sharp: false });
        }
        set_light(&mut records[first..], &solve(&rows, &old));
        // Now that the light is known, so is where it changes too fast for records. Rays that ended
        // there are cast again.
        let even = Self::radiosity_of(&placed, records.clone());
        let sharp = even.sharp(&lit_points(transfer, settings, seed));
        for &id in &sharp {
            records[id as usize].payload.lit.iter_mut().for_each(|lit| lit.sharp = true);
        }
        let edged = Self::radiosity_of(&placed, records.clone());
        rows.par_iter_mut().for_each(|row| {
            let again = |r: &Found| r.shares.iter().any(|s| sharp.binary_search(&s.record).is_ok());
            let numbers: Vec<u32> =
                (0..).zip(&row.rays).filter(|(_, r)| again(r)).map(|(k, _)| k).collect();
            let found = transfer.cast(&row.at, row.casting, &numbers, &edged);
            numbers.into_iter().zip(found).for_each(|(k, r)| row.rays[k as usize] = r);
        });
        set_light(&mut records[first..], &solve(&rows, &old));
        if progress.is_cancelled() {
            return Err(Error::Cancelled);
        }
        stats.gather_rays += rows.iter().map(|r| r.rays.len() as u64).sum::<u64>();
        let radiosity = Self::radiosity_of(&placed, records);
        self.set_radiosity(radiosity);
        Ok(stats)
    }

    /// Points whose light reaches what is seen from `visible`.
    fn radiosity_points(
        &self, world: &dyn World, visible: &[SurfacePoint], seed: u64,
    ) -> Vec<SurfacePoint> {
        let settings = self.scheme().radiosity.unwrap_or_default();
        let mut points = Vec::new();
        let mut before = visible.to_vec();
        for bounce in 0..BOUNCES {
            let seed = hash(&[seed, bounce]);
            let next = world.next_points(&before, 1, false, settings.points as usize, seed);
            before = next.into_iter().map(|(point, _)| point).collect();
            points.extend_from_slice(&before);
        }
        let footprint = settings.min_radius * self.extent();
        points.iter_mut().for_each(|p| p.footprint = footprint);
        points
    }
}

/// Points that light sources light up, with the irradiance straight from there.
fn lit_points(
    transfer: &dyn Transfer, settings: RadiositySettings, seed: u64,
) -> Vec<(SurfacePoint, Color)> {
    let direct = |(k, at): (u64, SurfacePoint)| {
        let seed = hash(&[seed, stream::APPEARANCE, k]);
        // Light samples alone.
        (at, transfer.direct(&at, Casting { rays: 0, aimed: 0, lights: settings.lights, seed }))
    };
    (0..).zip(transfer.lit()).collect::<Vec<_>>().into_par_iter().map(direct).collect()
}

/// All light and direct light of `records`.
fn light_of(records: &[Record<Irradiance>]) -> Vec<[Color; 2]> {
    let both = |r: &Record<Irradiance>| {
        [r.payload.irradiance, r.payload.lit.unwrap_or_default().irradiance]
    };
    records.iter().map(both).collect()
}

/// Sets the light of `records`.
fn set_light(records: &mut [Record<Irradiance>], light: &[Color]) {
    records.iter_mut().zip(light).for_each(|(r, light)| r.payload.irradiance = *light);
}

/// The irradiance of the records that `rows` are of, `E_i = known_i + Σ_j share_ij E_j`. Those
/// before them have all the light and the direct light of `old`.
fn solve(rows: &[Row], old: &[[Color; 2]]) -> Vec<Color> {
    let direct: Vec<Color> = rows.iter().map(Row::lit).collect();
    let known =
        |(row, direct): (&Row, &Color)| row.rays.iter().fold(*direct, |sum, r| sum + r.known);
    let known: Vec<Color> = rows.iter().zip(&direct).map(known).collect();
    let mut light = known.clone();
    for _ in 0..SWEEPS {
        let of = |share: &Share| {
            let record = share.record as usize;
            let [all, direct] = match record.checked_sub(old.len()) {
                Some(new) => [light[new], direct[new]],
                None => old[record],
            };
            share.factor * if share.all { all } else { (all - direct).max(Color::ZERO) }
        };
        let next: Vec<Color> = rows
            .par_iter()
            .zip(&known)
            .map(|(row, known)| {
                row.rays.iter().flat_map(|r| &r.shares).fold(*known, |sum, s| sum + of(s))
            })
            .collect();
        let (mut change, mut all) = (0.0, 0.0);
        for (new, old) in next.iter().zip(&light) {
            change += (*new - *old).abs().element_sum();
            all += new.element_sum();
        }
        light = next;
        if change <= SETTLED * all {
            break;
        }
    }
    light
}
