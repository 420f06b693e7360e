//! Rays for a host, and its answers.

use crate::error::{Error, Result};
use crate::math::{Color, Vec3};
use std::ops::Range;

/// An albedo or a normal's length may be this far outside its range.
const SLACK: f32 = 1e-2;

/// Rays that a host should trace.
#[derive(Default)]
pub struct Rays {
    /// Where the rays start.
    pub origin: Vec<Vec3>,
    /// Unit directions.
    pub dir: Vec<Vec3>,
    /// Surfaces that the path has met before the ray, the camera's counted.
    pub bounce: Vec<u32>,
    /// Seeds of the host's random choices.
    pub seed: Vec<u32>,
}

/// What a host answered, ray by ray.
pub struct Answers {
    /// Light that the hit reflects against the ray; zero at first.
    pub radiance: Vec<Color>,
    /// Distance of the hit; infinite at first, and for rays that miss.
    pub distance: Vec<f32>,
    /// Unit shading normal of the hit, on either side; zero at first.
    pub normal: Vec<Vec3>,
    /// Albedo of the diffuse lobe at the hit; zero at first.
    pub albedo: Vec<Color>,
}

/// Rays of one call of the host, and the room for its answers; all slices have the same length.
pub struct Batch<'a> {
    /// See [`Rays::origin`].
    pub origin: &'a [Vec3],
    /// See [`Rays::dir`].
    pub dir: &'a [Vec3],
    /// See [`Rays::bounce`].
    pub bounce: &'a [u32],
    /// See [`Rays::seed`].
    pub seed: &'a [u32],
    /// See [`Answers::radiance`].
    pub radiance: &'a mut [Color],
    /// See [`Answers::distance`].
    pub distance: &'a mut [f32],
    /// See [`Answers::normal`].
    pub normal: &'a mut [Vec3],
    /// See [`Answers::albedo`].
    pub albedo: &'a mut [Color],
}

impl Rays {
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
    }

    pub(super) fn append(&mut self, other: &Self) {
        self.origin.extend(&other.origin);
        self.dir.extend(&other.dir);
        self.bounce.extend(&other.bounce);
        self.seed.extend(&other.seed);
    }
}

impl Answers {
    /// Room for the answers to `n` rays: all of them miss.
    pub fn new(n: usize) -> Self {
        Self {
            radiance: vec![Color::ZERO; n],
            distance: vec![f32::INFINITY; n],
            normal: vec![Vec3::ZERO; n],
            albedo: vec![Color::ZERO; n],
        }
    }

    pub(super) fn part(&self, range: Range<usize>) -> Self {
        Self {
            radiance: self.radiance[range.clone()].to_vec(),
            distance: self.distance[range.clone()].to_vec(),
            normal: self.normal[range.clone()].to_vec(),
            albedo: self.albedo[range].to_vec(),
        }
    }

    /// The rays of `range` with the room for their answers.
    pub(super) fn batch<'a>(&'a mut self, rays: &'a Rays, range: Range<usize>) -> Batch<'a> {
        Batch {
            origin: &rays.origin[range.clone()],
            dir: &rays.dir[range.clone()],
            bounce: &rays.bounce[range.clone()],
            seed: &rays.seed[range.clone()],
            radiance: &mut self.radiance[range.clone()],
            distance: &mut self.distance[range.clone()],
            normal: &mut self.normal[range.clone()],
            albedo: &mut self.albedo[range],
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
