//! Rays for a host, and its answers.

use crate::error::{Error, Result};
use crate::math::{Color, Vec3};

/// An albedo or a normal's length may be this far outside its range.
const SLACK: f32 = 1e-2;

/// Rays that a host should trace, and its answers, all of the same number.
#[derive(Debug, Default)]
pub struct Batch {
    /// Where the rays start.
    pub origin: Vec<Vec3>,
    /// Unit directions.
    pub dir: Vec<Vec3>,
    /// Surfaces that the path has met before the ray, the camera's counted.
    pub bounce: Vec<u32>,
    /// Seeds of the host's random choices.
    pub seed: Vec<u32>,
    /// Answer: light that the hit reflects against the ray, or that a missing ray brings; zero at
    /// first.
    pub radiance: Vec<Color>,
    /// Answer: distance of the hit; infinite at first, and for rays that miss.
    pub distance: Vec<f32>,
    /// Answer: unit shading normal of the hit, on either side; zero at first.
    pub normal: Vec<Vec3>,
    /// Answer: albedo of the diffuse lobe at the hit; zero at first.
    pub albedo: Vec<Color>,
}

impl Batch {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.origin.len()
    }

    /// True without rays.
    pub fn is_empty(&self) -> bool {
        self.origin.is_empty()
    }

    /// Adds a ray.
    pub fn push(&mut self, origin: Vec3, dir: Vec3, bounce: u32, seed: u64) {
        self.origin.push(origin);
        self.dir.push(dir);
        self.bounce.push(bounce);
        self.seed.push((seed ^ (seed >> 32)) as u32);
        self.radiance.push(Color::ZERO);
        self.distance.push(f32::INFINITY);
        self.normal.push(Vec3::ZERO);
        self.albedo.push(Color::ZERO);
    }

    /// Moves the rays of `other` behind these.
    pub(super) fn append(&mut self, other: &mut Self) {
        self.origin.append(&mut other.origin);
        self.dir.append(&mut other.dir);
        self.bounce.append(&mut other.bounce);
        self.seed.append(&mut other.seed);
        self.radiance.append(&mut other.radiance);
        self.distance.append(&mut other.distance);
        self.normal.append(&mut other.normal);
        self.albedo.append(&mut other.albedo);
    }

    /// Takes the rays from number `first` on out of the batch.
    pub(super) fn split_off(&mut self, first: usize) -> Self {
        Self {
            origin: self.origin.split_off(first),
            dir: self.dir.split_off(first),
            bounce: self.bounce.split_off(first),
            seed: self.seed.split_off(first),
            radiance: self.radiance.split_off(first),
            distance: self.distance.split_off(first),
            normal: self.normal.split_off(first),
            albedo: self.albedo.split_off(first),
        }
    }

    /// Refuses an impossible answer `i`, the `number`-th of its batch, and puts a sound one into
    /// its range: unit normals, albedos up to 1. A host that answers light of `all_bounces` may
    /// leave the normal out, and its albedo counts for nothing then.
    pub(super) fn check(&mut self, i: usize, number: usize, all_bounces: bool) -> Result<()> {
        let lie = |what: String| {
            let text = format!("the host's tracer answered ray {number} of its batch with {what}");
            Err(Error::Host(text))
        };
        let (distance, radiance) = (self.distance[i], self.radiance[i]);
        if distance.is_nan() || distance < 0.0 {
            return lie(format!("the distance {distance}"));
        }
        if !radiance.is_finite() || radiance.min_element() < 0.0 {
            return lie(format!("the radiance {radiance}"));
        }
        let (normal, albedo) = (self.normal[i], self.albedo[i]);
        if distance == f32::INFINITY || (all_bounces && normal == Vec3::ZERO) {
            return Ok(());
        }
        let length = normal.length();
        let is_unit = (length - 1.0).abs() < SLACK;
        if !is_unit {
            return lie(format!("the normal {normal}, which has not unit length"));
        }
        if !(albedo.is_finite()
            && albedo.min_element() >= 0.0
            && albedo.max_element() <= 1.0 + SLACK)
        {
            return lie(format!("the albedo {albedo}"));
        }
        self.normal[i] = normal / length;
        self.albedo[i] = albedo.min(Color::ONE);
        Ok(())
    }
}
