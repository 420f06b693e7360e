//! One record from one gather, taken again where the gather started in a crack.

use crate::cache::payload::{DirectSamples, Irradiance, Payload};
use crate::cache::record::{Envelope, RadiusRule, Record};
use crate::cache::scheme::Contents;
use crate::cache::store::{Behind, Rules};
use crate::gather::{Density, HemisphereSamples, HitChange, Layout, RadianceProbe, StoredHit};
use crate::geometry::SurfacePoint;
use crate::math::luminance;
use crate::sampling::hash;

/// A record whose R_i exceeds this multiple of what two neighbours allow has missed what they saw.
const LEAK: f32 = 4.0;
/// A gather that starts aside and finds its surroundings nearer than this share of the step may lie
/// behind a surface.
const BEHIND: f32 = 0.25;

/// Makes the records of one level.
pub(super) struct Gatherer<'a, P: Payload> {
    pub rules: Rules<'a>,
    pub probe: &'a dyn RadianceProbe,
    /// Where gathers find indirect light.
    pub deeper: Behind<'a>,
    pub context: P::Context<'a>,
    pub level: u8,
    seed: u64,
    /// How far records are valid until the level is filled.
    pub rule: RadiusRule,
    /// How far records are valid when the level is filled.
    pub final_rule: RadiusRule,
}

impl<P: Payload> Clone for Gatherer<'_, P> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<P: Payload> Copy for Gatherer<'_, P> {}

/// A record with the place of its gather.
pub(super) struct Gathered<P> {
    pub record: Record<P>,
    /// Where the rays started.
    pub origin: SurfacePoint,
    /// The gather was taken again there.
    pub retaken: bool,
}

impl<'a, P: Payload> Gatherer<'a, P> {
    pub fn new(
        rules: Rules<'a>, probe: &'a dyn RadianceProbe, deeper: Behind<'a>,
        context: P::Context<'a>, level: u8, seed: u64,
    ) -> Self {
        let (rule, final_rule) = (rules.while_filling(level), rules.when_filled(level));
        let seed = hash(&[seed, u64::from(level)]);
        Self { rules, probe, deeper, context, level, seed, rule, final_rule }
    }

    /// An empty gather.
    pub fn samples(&self) -> HemisphereSamples {
        self.empty_gather(self.rules.scheme.layout(self.level))
    }

    /// An empty gather of this layout.
    pub fn empty_gather(&self, layout: Layout) -> HemisphereSamples {
        let scheme = self.rules.scheme;
        let paths = if self.level == 0 { scheme.extrapolation.light_paths() } else { 0 };
        let (density, change) = if P::HOLDS_RADIANCE {
            (scheme.glossy().density(), scheme.glossy().hits.change())
        } else {
            (Density::Cosine, HitChange::None)
        };
        let bright = (scheme.gather.bright * layout.rays() as f32).round() as u32;
        HemisphereSamples::new(layout, density)
            .with_light_paths(paths)
            .with_bright(bright)
            .with_change(change)
    }

    /// Bytes of the hits that a record keeps.
    pub fn kept_bytes(&self) -> usize {
        let scheme = self.rules.scheme;
        let kept = P::HOLDS_RADIANCE && scheme.glossy().hits.are_kept();
        if kept { scheme.layout(self.level).rays() * size_of::<StoredHit>() } else { 0 }
    }

    /// The record of a gather at `at`, which asks for `order` bands. `others` are the records so
    /// far and their envelope.
    pub fn record(
        &self, samples: &mut HemisphereSamples, at: &SurfacePoint, order: u8,
        (others, envelope): (&[Record<P>], &Envelope),
    ) -> Gathered<P> {
        let first =
            Gathered { record: self.gather(samples, at, order), origin: *at, retaken: false };
        if !self.rules.scheme.clamping.neighbours() {
            return first;
        }
        // Rays that slip through a crack beside the point see too far. Two neighbours that see much
        // nearer things give it away; the gather is repeated a little towards them, inside the
        // surface that they share [Krivanek06, Sec. 5.2].
        let neighbours = envelope.lowest_two(at.position);
        if first.record.length_unclamped <= LEAK * neighbours[1].value {
            return first;
        }
        let neighbours = neighbours.map(|n| &others[n.id as usize]);
        let [a, b] = neighbours.map(|n| n.position);
        let towards = 0.5 * (a + b) - at.position;
        let tangential = towards - at.ng * at.ng.dot(towards);
        let step =
            (0.5 * at.footprint).min(0.1 * first.record.length_unclamped).min(tangential.length());
        let moved = at.position + tangential.normalize_or_zero() * step;
        let moved = SurfacePoint { position: moved, ..*at };
        let mut record = self.gather(samples, &moved, order);
        // In a hollow of facets the step may lead behind the next one: then all is near, and unlike
        // what the neighbours see. What is near beside a crack is like it.
        let brightness = |r: &Record<P>| {
            luminance(r.payload.irradiance().irradiance).max(f32::MIN_POSITIVE).ln()
        };
        let usual = 0.5 * neighbours.map(brightness).into_iter().sum::<f32>();
        let unlike = |r: &Record<P>| (brightness(r) - usual).abs();
        if record.length_unclamped <= BEHIND * step && unlike(&record) > unlike(&first.record) {
            return first;
        }
        // Its rays start aside [Tabellion04, Sec. 3.1], but the record stays at the point:
        // refinement may leave it an area that is smaller than the step, and the point would have
        // no record.
        record.position = at.position;
        Gathered { record, origin: moved, retaken: true }
    }

    fn gather(&self, samples: &mut HemisphereSamples, at: &SurfacePoint, order: u8) -> Record<P> {
        samples.gather(self.probe, at, self.level, &self.deeper, self.seed_at(at));
        self.estimate(samples, at, order)
    }

    /// A seed that belongs to the place.
    pub fn seed_at(&self, at: &SurfacePoint) -> u64 {
        let p = at.position.to_array().map(|x| u64::from((x + 0.0).to_bits()));
        hash(&[self.seed, p[0], p[1], p[2]])
    }

    /// The record of the finished gather `samples` at `at`.
    pub fn estimate(&self, samples: &HemisphereSamples, at: &SurfacePoint, order: u8) -> Record<P> {
        let scheme = self.rules.scheme;
        let lit = self.level == 0 && scheme.contents == Contents::DirectAndIndirect;
        let direct =
            if lit { DirectSamples::new(self.probe, at, samples, self.seed_at(at)) } else { None };
        let record = Irradiance::gathered(scheme, &self.final_rule, at, samples, direct.as_ref());
        P::estimate(self.context, samples, at, order, record, &self.rule)
    }
}
