//! The vertices of a path.

use crate::geometry::SurfacePoint;
use crate::material::Bsdf;
use crate::math::Vec3;

/// A surface point as light sampling sees it.
#[derive(Clone, Copy)]
pub struct Origin {
    /// The point.
    pub position: Vec3,
    /// The normal whose horizon hides lights; none where light from behind counts too.
    pub facing: Option<Vec3>,
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
