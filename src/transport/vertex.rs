//! The vertices of a path.

use crate::accel::Ray;
use crate::geometry::SurfacePoint;
use crate::material::{Bsdf, BsdfSample, Lobe};
use crate::math::Vec3;
use crate::scene::{Scene, are_parallel, same_direction};

/// A surface point as light sampling sees it.
#[derive(Clone, Copy)]
pub struct Origin {
    /// The point.
    pub position: Vec3,
    /// The normal whose horizon hides lights; none where light from behind counts too.
    pub facing: Option<Vec3>,
}

/// How the direction of a ray was chosen at the last surface that did more than pass it on as an
/// ideal pane: light that the ray finds is weighed against light samples there.
#[derive(Clone, Copy)]
pub struct Aim {
    /// Density per steradian with which the direction was sampled; infinite if no light sample
    /// could have chosen it, 0 if light samples alone account for what it finds.
    pdf: f32,
    origin: Origin,
    dir: Vec3,
    panes: Panes,
}

/// What a path met since it was aimed, where that was surfaces of ideal panes alone.
#[derive(Clone, Copy)]
pub(super) struct Panes {
    /// Number of surfaces.
    pub count: usize,
    /// Of the first.
    normal: Vec3,
    /// All normals are the same.
    parallel: bool,
    /// The first and the last surface passed the light.
    enters: bool,
    leaves: bool,
    reflects: bool,
    /// Between the two faces of a solid.
    inside: bool,
    /// A face did not give the light the direction back that the one before took.
    broken: bool,
}

impl Panes {
    pub const NONE: Self = Self {
        count: 0,
        normal: Vec3::ZERO,
        parallel: true,
        enters: true,
        leaves: true,
        reflects: false,
        inside: false,
        broken: false,
    };

    /// The path met one more, with this unit normal, and goes on as it came to the first, or not.
    pub fn add(&mut self, normal: Vec3, transmitted: bool, straight: bool) {
        if self.count == 0 {
            (self.normal, self.enters) = (normal, transmitted);
        }
        self.parallel &= are_parallel(self.normal, normal);
        self.reflects |= !transmitted;
        self.broken |= self.inside && !straight;
        self.inside = !straight;
        (self.count, self.leaves) = (self.count + 1, transmitted);
    }

    /// True if a light sample finds the same light: the path goes on as it came, face by face, or
    /// went to and fro between parallel faces.
    pub fn are_passed(&self, before: Vec3, behind: Vec3) -> bool {
        same_direction(before, behind)
            && if self.reflects {
                self.parallel && self.enters && self.leaves
            } else {
                !self.broken
            }
    }
}

impl Aim {
    /// The unit direction `dir`, sampled with density `pdf` at `origin`.
    pub fn new(pdf: f32, origin: Origin, dir: Vec3) -> Self {
        Self { pdf, origin, dir, panes: Panes::NONE }
    }

    /// The aim of the ray `next` that `sample` makes at `v`, which was met with this aim.
    pub(super) fn onward(
        &self, scene: &Scene, v: &Vertex, sample: &BsdfSample, next: &Ray,
    ) -> Self {
        if sample.lobe == Lobe::Delta && scene.is_pane(v.point.material) {
            let mut panes = self.panes;
            let straight = same_direction(self.dir, next.dir);
            panes.add(v.point.frame.n, sample.transmitted, straight);
            Self { panes, ..*self }
        } else {
            Self::new(sample.pdf, v.origin(), next.dir)
        }
    }

    /// True if light samples at the origin may find the light of a ray along `dir`, too, and count
    /// it as seen straight.
    pub(super) fn is_straight(&self, dir: Vec3) -> bool {
        self.panes.count == 0 || (self.sees_through() && self.panes.are_passed(self.dir, dir))
    }

    /// The number of surfaces of panes since the origin.
    pub(super) fn panes(&self) -> usize {
        self.panes.count
    }

    /// True if light samples at the origin see through panes in this direction.
    pub(super) fn sees_through(&self) -> bool {
        self.pdf.is_finite()
    }

    /// The density to weigh light along `dir` by.
    pub(super) fn pdf(&self, dir: Vec3) -> f32 {
        if self.is_straight(dir) { self.pdf } else { f32::INFINITY }
    }

    /// Where the direction was sampled.
    pub(super) fn origin(&self) -> &Origin {
        &self.origin
    }

    /// Unit direction and distance from the origin to a point that a ray met at `distance`.
    pub(super) fn towards(&self, point: Vec3, ray: &Ray, distance: f32) -> (Vec3, f32) {
        if self.panes.count == 0 {
            return (ray.dir, distance);
        }
        let offset = point - self.origin.position;
        let length = offset.length();
        (offset / length.max(f32::MIN_POSITIVE), length)
    }
}

/// A vertex from which the next ray leaves.
pub(super) struct Vertex {
    pub point: SurfacePoint,
    pub bsdf: Bsdf,
}

impl Vertex {
    /// The vertex as light sampling sees it.
    pub fn origin(&self) -> Origin {
        Origin {
            position: self.point.position,
            facing: (!self.bsdf.transmits()).then_some(self.point.ng),
        }
    }
}
