//! The BSDF of one surface point: evaluation, sampling and densities of everything but emission and
//! alpha.

use super::layered::{GgxLobe, Layered};
use super::microfacet::flip;
use super::native::NativeBrdf;
use super::sample::{BsdfSample, Lobe, Pane};
use crate::math::{Color, INV_PI, Vec2, Vec3};
use crate::sampling::square_to_cosine_hemisphere;

/// The BSDF of one surface point in its local frame: z is the shading normal on the side of `wo`.
///
/// `f` excludes the cosine; all directions are unit vectors that point away from the surface. The
/// diffuse lobe is Lambertian in `wi`:
///
/// ```text
/// f(wo, wi) = diffuse_albedo(wo)/π + f_glossy(wo, wi)   for wi above the surface
/// ```
///
/// The outgoing radiance of the diffuse lobe is `diffuse_albedo(wo)/π · E` for any incident light,
/// so irradiance is all that a cache has to interpolate. The price: light enters the diffuse layer
/// through the layers above without loss, and only its way to `wo` attenuates it. Energy is
/// conserved, but `f(wo, wi) = f(wi, wo)` does not hold for the diffuse lobe under a specular layer
/// or a coat, nor for anything below a coat, nor for the compensation of multiple scattering, which
/// depends on `wo` alone [Turquin19]. Algorithms that carry importance must evaluate `f` with its
/// arguments in the order of the light.
///
/// Surfaces that transmit may also be evaluated and sampled with `wo` below the surface. Other
/// surfaces are black from below.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bsdf(Model);

/// The closed set of models.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Model {
    /// Reflects nothing.
    Black,
    /// A diffuse albedo and nothing above it.
    Lambert(Color),
    /// glTF's layers.
    Layered(Layered),
    /// A BRDF of the papers.
    Native(NativeBrdf),
}

impl Bsdf {
    /// A surface that reflects nothing.
    pub const BLACK: Self = Self(Model::Black);

    /// A purely diffuse surface with the albedo `albedo`, each channel in [0, 1].
    pub fn lambert(albedo: Color) -> Self {
        Self(if albedo == Color::ZERO { Model::Black } else { Model::Lambert(albedo) })
    }

    /// One of the papers' BRDFs.
    pub fn native(brdf: NativeBrdf) -> Self {
        Self(Model::Native(brdf.sanitized()))
    }

    /// glTF's layers; the plain models where they suffice.
    pub(super) fn layered(layers: Layered) -> Self {
        if layers.is_lambert() {
            Self::lambert(layers.diffuse)
        } else {
            Self(Model::Layered(layers))
        }
    }

    /// Albedo of the diffuse lobe as seen from `wo`: its radiance towards `wo` is
    /// `diffuse_albedo(wo)/π · E`, E the irradiance.
    ///
    /// The base albedo times the light that the layers above let through, `(1 - E_coat(wo)) (1 -
    /// E_specular(wo))`, with E the directional albedos of those layers, multiple scattering
    /// included.
    #[inline]
    pub fn diffuse_albedo(&self, wo: Vec3) -> Color {
        match &self.0 {
            Model::Black => Color::ZERO,
            Model::Lambert(albedo) => *albedo,
            Model::Layered(l) => l.diffuse_albedo(wo.z.abs()),
            Model::Native(b) => b.kd(),
        }
    }

    /// All lobes of finite width, per steradian, without the cosine.
    #[inline]
    pub fn f(&self, wo: Vec3, wi: Vec3) -> Color {
        self.f_pdf(wo, wi).0
    }

    /// [`Bsdf::f`] without the diffuse lobe.
    #[inline]
    pub fn f_glossy(&self, wo: Vec3, wi: Vec3) -> Color {
        self.f_pdf_glossy(wo, wi).0
    }

    /// Density per steradian with which [`Bsdf::sample`] draws `wi`, delta directions left out.
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.f_pdf(wo, wi).1
    }

    /// Density per steradian with which [`Bsdf::sample_glossy`] draws `wi`, delta directions left
    /// out.
    #[inline]
    pub fn pdf_glossy(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.f_pdf_glossy(wo, wi).1
    }

    /// [`Bsdf::f`] and [`Bsdf::pdf`] for the price of one.
    #[inline]
    pub fn f_pdf(&self, wo: Vec3, wi: Vec3) -> (Color, f32) {
        match &self.0 {
            Model::Lambert(albedo) if wo.z > 0.0 && wi.z > 0.0 => (*albedo * INV_PI, wi.z * INV_PI),
            Model::Black | Model::Lambert(_) => (Color::ZERO, 0.0),
            _ => self.evaluate(wo, wi, true),
        }
    }

    /// [`Bsdf::f_glossy`] and [`Bsdf::pdf_glossy`] for the price of one.
    #[inline]
    pub fn f_pdf_glossy(&self, wo: Vec3, wi: Vec3) -> (Color, f32) {
        match &self.0 {
            Model::Black | Model::Lambert(_) => (Color::ZERO, 0.0),
            _ => self.evaluate(wo, wi, false),
        }
    }

    /// The general case of the two functions above.
    fn evaluate(&self, wo: Vec3, wi: Vec3, diffuse: bool) -> (Color, f32) {
        match &self.0 {
            Model::Layered(l) if wo.z > 0.0 => l.view(wo, diffuse).f_pdf(wo, wi),
            Model::Layered(l) if wo.z < 0.0 && l.transmits() => {
                l.flipped().view(flip(wo), diffuse).f_pdf(flip(wo), flip(wi))
            }
            Model::Native(b) if wo.z > 0.0 && wi.z > 0.0 => b.f_pdf(wo, wi, diffuse),
            _ => (Color::ZERO, 0.0),
        }
    }

    /// Draws a direction in proportion to all lobes, or `None` where the model reflects nothing or
    /// the draw fell out of its domain.
    ///
    /// * `lobe_u`: chooses the lobe, uniform in [0, 1).
    /// * `u`: chooses the direction, uniform in [0, 1)².
    #[inline]
    pub fn sample(&self, wo: Vec3, lobe_u: f32, u: Vec2) -> Option<BsdfSample> {
        match &self.0 {
            Model::Black => None,
            Model::Lambert(albedo) => {
                let wi = square_to_cosine_hemisphere(u);
                (wo.z > 0.0 && wi.z > 0.0).then_some(BsdfSample {
                    wi,
                    weight: *albedo,
                    pdf: wi.z * INV_PI,
                    lobe: Lobe::Diffuse,
                    transmitted: false,
                    eta: 1.0,
                })
            }
            _ => self.draw(wo, lobe_u, u, true),
        }
    }

    /// [`Bsdf::sample`] without the diffuse lobe: estimates the integral of `f_glossy`.
    #[inline]
    pub fn sample_glossy(&self, wo: Vec3, lobe_u: f32, u: Vec2) -> Option<BsdfSample> {
        match &self.0 {
            Model::Black | Model::Lambert(_) => None,
            _ => self.draw(wo, lobe_u, u, false),
        }
    }

    /// The general case of the two functions above.
    fn draw(&self, wo: Vec3, lobe_u: f32, u: Vec2, diffuse: bool) -> Option<BsdfSample> {
        match &self.0 {
            Model::Layered(l) if wo.z > 0.0 => l.view(wo, diffuse).sample(wo, lobe_u, u),
            Model::Layered(l) if wo.z < 0.0 && l.transmits() => {
                let s = l.flipped().view(flip(wo), diffuse).sample(flip(wo), lobe_u, u)?;
                Some(BsdfSample { wi: flip(s.wi), ..s })
            }
            Model::Native(b) if wo.z > 0.0 => b.sample(wo, lobe_u, u, diffuse),
            _ => None,
        }
    }

    /// Share of the light from a uniform surrounding that goes towards `wo`, by all lobes;
    /// refraction counts without its factor `1/η²`.
    ///
    /// For the albedo channel. Exact up to the tables for the layered model (rough glass: with the
    /// reflectance of the mean normal); a 16-point quadrature for the papers' lobes.
    pub fn albedo(&self, wo: Vec3) -> Color {
        match &self.0 {
            Model::Black => Color::ZERO,
            Model::Lambert(albedo) => *albedo,
            Model::Layered(l) => l.albedo(Vec3::new(wo.x, wo.y, wo.z.abs())),
            Model::Native(b) => b.albedo(wo),
        }
    }

    /// True if there is a diffuse lobe.
    pub fn has_diffuse(&self) -> bool {
        match &self.0 {
            Model::Black => false,
            Model::Lambert(_) => true,
            Model::Layered(l) => l.diffuse != Color::ZERO,
            Model::Native(b) => b.kd() != Color::ZERO,
        }
    }

    /// True if there is any lobe besides the diffuse one, delta lobes included:
    /// [`Bsdf::sample_glossy`] can return a direction.
    pub fn has_glossy(&self) -> bool {
        match &self.0 {
            Model::Black | Model::Lambert(_) => false,
            Model::Layered(l) => l.has_specular(),
            Model::Native(b) => b.has_glossy(),
        }
    }

    /// True if all lobes are delta lobes: `f` and `pdf` are zero everywhere and light sampling is
    /// in vain.
    pub fn is_delta_only(&self) -> bool {
        match &self.0 {
            Model::Layered(l) => l.is_delta_only(),
            _ => false,
        }
    }

    /// True if light can pass to the other side.
    pub fn transmits(&self) -> bool {
        matches!(&self.0, Model::Layered(l) if l.transmits())
    }

    /// The surface as an ideal pane seen from `wo`, above it; `None` where it passes no light in a
    /// single direction.
    pub fn pane(&self, wo: Vec3) -> Option<Pane> {
        match &self.0 {
            Model::Layered(l) if wo.z > 0.0 => l.pane(wo),
            _ => None,
        }
    }

    /// The derivative of `ln f_glossy(wo, wi)` by wo where that is a Phong lobe, `s r/(r·wo)` with
    /// r the mirror image of `wi` [Zhao, Eq. 3.45, divided by f and with the exponent s - 1 that is
    /// missing there]; the part along wo is to be left out.
    pub(crate) fn logarithmic_slope(&self, wo: Vec3, wi: Vec3) -> Option<Vec3> {
        let NativeBrdf::Phong { exponent, .. } = self.native_brdf()? else { return None };
        let mirrored = Vec3::new(-wi.x, -wi.y, wi.z);
        let cos = mirrored.dot(wo);
        Some(if cos > 0.0 && wi.z > 0.0 { *exponent / cos * mirrored } else { Vec3::ZERO })
    }

    /// The model, if it is one of the papers' BRDFs.
    pub(super) fn native_brdf(&self) -> Option<&NativeBrdf> {
        match &self.0 {
            Model::Native(b) => Some(b),
            _ => None,
        }
    }

    /// The reflecting lobes of the layered model towards `wo`; `None` where it has delta lobes or
    /// transmits, or is not that model.
    pub(super) fn ggx_lobes(&self, wo: Vec3) -> Option<[GgxLobe; 2]> {
        match &self.0 {
            Model::Layered(l) => l.ggx_lobes(wo),
            _ => None,
        }
    }

    /// Width of the sharpest lobe besides the diffuse one as a GGX α: 0 for a delta lobe, 1 if
    /// there is none.
    pub fn roughness(&self) -> f32 {
        match &self.0 {
            Model::Black | Model::Lambert(_) => 1.0,
            Model::Layered(l) => l.sharpest(),
            Model::Native(b) => b.sharpest(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_enough_to_copy() {
        assert!(size_of::<Bsdf>() <= 160, "{}", size_of::<Bsdf>());
    }
}
