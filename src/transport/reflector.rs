//! How the surfaces of our own scene reflect, for records that are placed by what leaves them.

use super::path::PathTracer;
use crate::cache::Reflector;
use crate::gather::Coefficients;
use crate::geometry::SurfacePoint;
use crate::material::tables::{BrdfMatrix, GlossyTables};

/// Looks surfaces up in a scene and their lobes up in its tables.
pub struct SceneReflector<'a> {
    /// The scene.
    pub tracer: PathTracer<'a>,
    /// The lobes of its materials.
    pub tables: &'a GlossyTables,
}

impl Reflector for SceneReflector<'_> {
    fn lobe(&self, at: &SurfacePoint) -> Option<Coefficients> {
        let v = self.tracer.surface_at(at, 0)?;
        let mut out = vec![0.0; 3 * self.tables.coefficient_count()];
        self.tables.add_lobes(v.point.material, &v.bsdf, at.frame.to_local(at.wo), &mut out);
        Some(out)
    }

    fn matrix(&self, at: &SurfacePoint) -> Option<BrdfMatrix> {
        let v = self.tracer.surface_at(at, 0)?;
        Some(self.tables.matrix(v.point.material, &v.bsdf))
    }
}
