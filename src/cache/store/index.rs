//! The spatial index of records: an octree whose leaves list every record that may be valid in
//! them.

use crate::cache::payload::{Axes, Curve, Payload};
use crate::cache::record::{Area, Fences, RadiusRule, Record};
use crate::cache::scheme::Weight;
use crate::geometry::{Aabb, SurfacePoint};
use crate::math::{Color, Mat3, Vec3};
use std::sync::Arc;

/// What the search reads of a record, kept once for each leaf that lists it.
#[derive(Clone, Copy)]
struct Entry {
    position: Vec3,
    inverse_radius: f32,
    normal: Vec3,
    id: u32,
    /// The level's allowed error over the record's own.
    inverse_share: f32,
    /// Index of its fences and of its area, plus `SHAPED` if that is no disc; `PLAIN` if it is one
    /// without fences.
    detail: u32,
}

/// Marks a disc without fences.
const PLAIN: u32 = SHAPED - 1;
/// Marks what is no disc.
const SHAPED: u32 = 1 << 31;

/// What extrapolation reads of a record.
#[derive(Clone, Copy)]
struct Extrapolant {
    irradiance: Color,
    rotation: Mat3,
    translation: Mat3,
    /// The factor on gradients, see [`RadiusRule::radius`]; `translation` contains it.
    slope: f32,
}

/// A node of the octree: eight children in a row, or a leaf's range of entries.
#[derive(Clone, Copy)]
enum Node {
    Inner(u32),
    Leaf { first: u32, count: u32 },
}

/// Leaves with this many records or fewer are not split.
const LEAF: usize = 24;
/// Cells are not split below this share of the harmonic mean radius of their records.
const SMALLEST_CELL: f32 = 0.5;
/// Deepest level of the tree.
const MAX_DEPTH: u32 = 20;

/// An immutable snapshot of the records of one level, ready for lookups from any thread.
pub struct Index {
    center: Vec3,
    /// Half the size of the box around all areas: a batch of late records is small, and most
    /// questions are not for it.
    extent: Vec3,
    /// Half the width of the root.
    half: f32,
    nodes: Vec<Node>,
    entries: Vec<Entry>,
    extrapolants: Vec<Extrapolant>,
    /// Of every record, for schemes that extrapolate to second order; else empty.
    curves: Vec<Curve>,
    /// Of every record, if any extrapolates along axes; else empty.
    axes: Vec<Option<Arc<Axes>>>,
    fences: Vec<Fences>,
    /// One for each of `fences` where areas are no discs; else empty.
    areas: Vec<Area>,
    rule: RadiusRule,
    normal_scale: f32,
    weight: Weight,
    /// How far a record may lie in front of a point beside it.
    tolerance: f32,
}

/// A record that is valid at a point.
pub(in crate::cache) struct Valid {
    pub id: u32,
    /// From the record to the point.
    pub offset: Vec3,
    pub weight: f32,
    /// Its error as a share of the allowed one.
    pub error: f32,
    /// Its allowed error as a share of the level's.
    pub share: f32,
    /// The factor on its gradients.
    pub slope: f32,
    /// Its irradiance extrapolated to the point.
    pub irradiance: Color,
    /// The same of direct light, if the record holds it.
    pub direct: Option<Color>,
}

/// Interpolated light.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    /// Radiance that leaves by the lobe that the radiance cache was asked for; else zero.
    pub glossy: Color,
    /// Weighted mean of the extrapolated records: irradiance of indirect light.
    pub irradiance: Color,
    /// The same of direct light; `None` unless all records that took part hold it.
    pub direct: Option<Color>,
    /// Weighted mean of their errors as a share of the allowed one, in [0, 1).
    pub error: f32,
    /// Weighted mean of the errors a_i that they are allowed.
    pub allowed: f32,
    /// Number of records that took part.
    pub records: u32,
    /// Sum of their weights, by which answers of several indexes are averaged.
    pub weight: f32,
}

impl Index {
    /// Indexes `records`; a record's number in the slice is its id.
    pub fn build<P: Payload>(
        records: &[Record<P>], rule: RadiusRule, weight: Weight, tolerance: f32,
    ) -> Self {
        let mut extrapolants = Vec::with_capacity(records.len());
        let mut all = Vec::with_capacity(records.len());
        let (mut fences, mut areas) = (Vec::new(), Vec::new());
        let (mut curves, mut axes) = (Vec::new(), Vec::new());
        let mut bounds = Aabb::EMPTY;
        for (id, r) in records.iter().enumerate() {
            let (area, slope) = rule.area(r);
            let held = r.payload.irradiance();
            let share = rule.share(r);
            let area = area.map(|radius| share * radius);
            let radius = area.longest();
            let mut entry = Entry {
                position: r.position,
                inverse_radius: 1.0 / radius,
                normal: r.normal,
                id: id as u32,
                inverse_share: 1.0 / share,
                detail: PLAIN,
            };
            let disc = matches!(area, Area::Disc { .. });
            if !disc || !r.fences.planes().is_empty() {
                entry.detail = fences.len() as u32;
                fences.push(r.fences);
            }
            if !disc {
                // All areas of a scheme are of one kind, so that the tables run in step.
                entry.detail += SHAPED;
                areas.push(area);
            }
            all.push(entry);
            extrapolants.push(Extrapolant {
                irradiance: held.irradiance,
                rotation: held.rotation,
                translation: held.translation * slope,
                slope,
            });
            if let Some(mut curve) = held.curve {
                // Where the radius was raised beyond what the error allows, the term must not grow
                // with it, as the gradient's does not.
                curve.hessian = curve.hessian * slope.powi(2);
                curves.push(curve);
            }
            axes.push(held.axes.clone());
            bounds = bounds.with(r.position - radius).with(r.position + radius);
        }
        if axes.iter().all(Option::is_none) {
            axes = Vec::new();
        }
        let (center, extent) = if bounds.is_empty() {
            (Vec3::ZERO, Vec3::ZERO)
        } else {
            (bounds.center(), 0.5 * (bounds.max - bounds.min) * 1.0001)
        };
        let half = extent.max_element();
        let mut index = Self {
            center,
            extent,
            half,
            nodes: vec![Node::Leaf { first: 0, count: 0 }],
            entries: Vec::new(),
            extrapolants,
            curves,
            axes,
            fences,
            areas,
            rule,
            normal_scale: rule.normal_scale(),
            weight,
            tolerance,
        };
        if !all.is_empty() {
            index.split(0, all, center, half, 0);
        }
        index
    }

    fn split(&mut self, node: usize, list: Vec<Entry>, center: Vec3, half: f32, depth: u32) {
        // A cell much smaller than its records would only repeat its parent's list; the mean of the
        // inverse radii speaks for the small ones among them.
        let mean = list.iter().map(|e| e.inverse_radius).sum::<f32>() / list.len() as f32;
        if list.len() <= LEAF || depth == MAX_DEPTH || half * mean < SMALLEST_CELL {
            self.nodes[node] =
                Node::Leaf { first: self.entries.len() as u32, count: list.len() as u32 };
            self.entries.extend(list);
            return;
        }
        let first = self.nodes.len();
        self.nodes.extend([Node::Leaf { first: 0, count: 0 }; 8]);
        self.nodes[node] = Node::Inner(first as u32);
        for octant in 0..8 {
            let sign = |bit: usize| if octant & bit != 0 { 0.5 } else { -0.5 };
            let c = center + half * Vec3::new(sign(1), sign(2), sign(4));
            let inside = list
                .iter()
                .filter(|e| {
                    ((e.position - c).abs() - 0.5 * half).max(Vec3::ZERO).length()
                        * e.inverse_radius
                        <= 1.0
                })
                .filter(|e| {
                    // The ball around the cell: half its diagonal.
                    e.detail < SHAPED
                        || self.areas[(e.detail - SHAPED) as usize].may_reach(
                            e.normal,
                            c - e.position,
                            0.87 * half,
                        )
                })
                .copied()
                .collect();
            self.split(first + octant, inside, c, 0.5 * half, depth + 1);
        }
    }

    /// The entries of the leaf that contains `p`.
    #[inline]
    fn leaf(&self, p: Vec3) -> &[Entry] {
        let mut offset = p - self.center;
        if offset.abs().cmpgt(self.extent).any() {
            return &[];
        }
        let (mut node, mut half) = (0, self.half);
        loop {
            match self.nodes[node] {
                Node::Leaf { first, count } => {
                    return &self.entries[first as usize..(first + count) as usize];
                }
                Node::Inner(first) => {
                    let up = offset.cmpge(Vec3::ZERO);
                    node = first as usize + up.bitmask() as usize;
                    half *= 0.5;
                    offset -= Vec3::select(up, Vec3::splat(half), Vec3::splat(-half));
                }
            }
        }
    }

    /// Calls `visit(entry, error, n_i × n is left to the caller)` for every record valid at `at`.
    #[inline]
    fn valid(&self, at: &SurfacePoint, limit: u32, mut visit: impl FnMut(&Entry, f32)) {
        let (n, least) = (at.frame.n, self.rule.least_cosine());
        for e in self.leaf(at.position) {
            let offset = at.position - e.position;
            let d2 = offset.length_squared();
            let cosine = n.dot(e.normal);
            if d2 * e.inverse_radius * e.inverse_radius >= 1.0 || cosine <= least || e.id >= limit {
                continue;
            }
            let d = d2.sqrt();
            let mut position = d * e.inverse_radius;
            if e.detail >= SHAPED {
                position = self.areas[(e.detail - SHAPED) as usize].share(e.normal, offset);
                if position >= 1.0 {
                    continue;
                }
            }
            let error =
                self.rule.relative_error(position, cosine, self.normal_scale * e.inverse_share);
            if error >= 1.0 {
                continue;
            }
            // A record in front of the point may see light that its surface keeps from the point.
            if 0.5 * offset.dot(n + e.normal) < -0.05 * d - self.tolerance {
                continue;
            }
            if e.detail != PLAIN && !self.fences[(e.detail & PLAIN) as usize].admit(at.position) {
                continue;
            }
            visit(e, error);
        }
    }

    /// Calls `visit` with the number of every record valid at `at`.
    pub fn near(&self, at: &SurfacePoint, mut visit: impl FnMut(u32)) {
        self.valid(at, u32::MAX, |e, _| visit(e.id));
    }

    /// True if some record is valid at `at`.
    pub fn covers(&self, at: &SurfacePoint) -> bool {
        let mut covered = false;
        self.valid(at, u32::MAX, |_, _| covered = true);
        covered
    }

    /// Calls `visit` for every record with an id below `limit` that is valid at `at`, weighed and
    /// extrapolated.
    #[inline]
    fn visit(&self, at: &SurfacePoint, limit: u32, mut visit: impl FnMut(Valid)) {
        self.valid(at, limit, |e, error| {
            let p = &self.extrapolants[e.id as usize];
            let offset = at.position - e.position;
            let mut direct = None;
            let value = if let Some(Some(axes)) = self.axes.get(e.id as usize) {
                let (change, of_lights) = axes.at(e.normal, offset, at.frame.n);
                direct = of_lights;
                p.irradiance + change
            } else {
                let first = p.translation * offset;
                let bent = self
                    .curves
                    .get(e.id as usize)
                    .map_or(Color::ZERO, |c| c.term(offset, first, p.irradiance));
                p.irradiance + p.rotation * e.normal.cross(at.frame.n) + first + bent
            };
            visit(Valid {
                id: e.id,
                offset,
                weight: self.weight.at(error, e.inverse_share),
                error,
                share: 1.0 / e.inverse_share,
                slope: p.slope,
                irradiance: value.max(Color::ZERO),
                direct,
            });
        });
    }

    /// Interpolates the irradiance at `at` from the records with ids below `limit`:
    /// `E = Σ w_i max(0, E_i + (n_i × n)·∇_r E_i + (x - x_i)·∇_t E_i) / Σ w_i` [WardHeckbert92],
    /// with [`Curve::term`] added to the extrapolation where the scheme wants it, or by
    /// [`Axes::at`] instead. `takes_part` hears of each valid record and may leave it out. `None`
    /// where no record takes part.
    #[inline]
    pub(in crate::cache) fn lookup(
        &self, at: &SurfacePoint, limit: u32, mut takes_part: impl FnMut(&Valid) -> bool,
    ) -> Option<Answer> {
        let (mut sum, mut weights, mut errors, mut shares, mut records) =
            (Color::ZERO, 0.0, 0.0, 0.0, 0);
        let mut direct = Some(Color::ZERO);
        self.visit(at, limit, |v| {
            if !takes_part(&v) {
                return;
            }
            sum += v.weight * v.irradiance;
            direct = direct.zip(v.direct).map(|(sum, one)| sum + v.weight * one);
            weights += v.weight;
            errors += v.weight * v.error;
            shares += v.weight * v.share;
            records += 1;
        });
        let allowed = self.rule.allowed_error() * shares / weights;
        (weights > 0.0).then(|| Answer {
            glossy: Color::ZERO,
            irradiance: sum / weights,
            direct: direct.map(|d| d / weights),
            error: errors / weights,
            allowed,
            records,
            weight: weights,
        })
    }

    /// Bytes that the index occupies.
    pub fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>()
            + self.entries.len() * size_of::<Entry>()
            + self.extrapolants.len() * size_of::<Extrapolant>()
            + self.curves.len() * size_of::<Curve>()
            + self.axes.len() * size_of::<Option<Arc<Axes>>>()
            + self.fences.len() * size_of::<Fences>()
            + self.areas.len() * size_of::<Area>()
    }
}
