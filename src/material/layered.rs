//! glTF's metallic-roughness model with specular, transmission and clearcoat as a stack of lobes
//! that conserves energy.
//!
//! From the top: a coat, a microfacet reflector (metal and dielectric share it), and below it
//! Lambert reflection and transmission, thin or solid [glTF20, Appendix B]. Where glTF leaves the
//! coupling to the implementation it is done with directional albedos E(wo): what a layer reflects,
//! multiple scattering included, is missing below, so a white stack reflects exactly what it
//! receives.

use super::energy::{glass_albedo, reflection_albedo};
use super::microfacet::{
    DELTA_ALPHA, flip, fresnel_dielectric, g1_over_cos, ggx_d, reflect, refract,
    sample_visible_normal, schlick_weight, visibility, visible_normal_pdf,
};
use super::sample::{BsdfSample, Lobe, Pane, mean};
use crate::math::{Color, INV_PI, Vec2, Vec3};
use crate::sampling::square_to_cosine_hemisphere;

/// Reflectance of the coat at normal incidence, an index of 1.5.
const COAT_F0: f32 = 0.04;

/// The layers at one point, all textures evaluated and all weights multiplied in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Layered {
    /// Albedo of the Lambert lobe before the layers above it take their share.
    pub diffuse: Color,
    /// Reflectance of the opaque reflector at normal incidence: metal and dielectric blended.
    pub f0: Color,
    /// Its reflectance at grazing incidence.
    pub f90: f32,
    /// Factors of the relative loss by which multiple scattering adds to `f0`: the squared
    /// reflectances of metal and dielectric, blended.
    pub again0: Color,
    /// The same for `f90`: their products of F0 and F90.
    pub again90: Color,
    /// GGX roughness of reflector and transmission.
    pub alpha: f32,
    /// Reflectance (F0, F90) of the dielectric that covers the Lambert lobe and thin transmission,
    /// the largest channel.
    pub cover: Vec2,
    /// Weight and tint of transmitted light.
    pub transmit: Color,
    /// Index of refraction of the far side over the near side for a solid, 0 for a thin sheet.
    pub eta: f32,
    /// Share of the surface that is a boundary of a solid: it has its own, exact Fresnel
    /// reflection.
    pub solid: f32,
    /// Strength and tint of that reflection.
    pub solid_specular: Color,
    /// Strength of the coat.
    pub coat: f32,
    /// GGX roughness of the coat.
    pub coat_alpha: f32,
    /// True if light that scatters more than once between microfacets is accounted for.
    pub multiple_scattering: bool,
}

/// The layers as seen from one direction: everything that does not depend on `wi`.
pub(super) struct View<'a> {
    layers: &'a Layered,
    /// Albedo of the Lambert lobe, zero if it was left out.
    diffuse: Color,
    /// Reflectance of the reflector at normal incidence of the microfacet, with multiple
    /// scattering and the coat accounted for.
    reflect0: Color,
    /// The same at grazing incidence.
    reflect90: Color,
    /// Factor on transmission: the light that gets there over the albedo of its single-scattering
    /// lobe.
    transmit: f32,
    /// Probabilities of Lambert, reflector, transmission and coat; all zero if nothing is
    /// reflected.
    pick: [f32; 4],
}

/// A reflecting GGX lobe as seen from one direction: `f = (f0 + (f90 - f0)(1 - cosθ_h)⁵) D V`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GgxLobe {
    /// Roughness.
    pub alpha: f32,
    /// Reflectance at normal incidence.
    pub f0: Color,
    /// Reflectance at grazing incidence.
    pub f90: Color,
}

impl Layered {
    /// The lobes of the reflector and of the coat towards `wo`, black where they are not there;
    /// `None` if there is any other lobe besides Lambert's, or if one of them is a delta lobe.
    pub fn ggx_lobes(&self, wo: Vec3) -> Option<[GgxLobe; 2]> {
        if self.transmits()
            || (self.has_reflector() && self.is_smooth())
            || (self.coat > 0.0 && self.coat_alpha < DELTA_ALPHA)
        {
            return None;
        }
        let view = self.view(wo, false);
        let coat = |f: f32| Color::splat(self.coat * f);
        Some([
            GgxLobe { alpha: self.alpha, f0: view.reflect0, f90: view.reflect90 },
            GgxLobe { alpha: self.coat_alpha, f0: coat(COAT_F0), f90: coat(1.0) },
        ])
    }

    /// True if only the Lambert lobe is there and nothing covers it.
    pub fn is_lambert(&self) -> bool {
        !self.has_specular() && self.cover == Vec2::ZERO
    }

    /// True if any lobe besides Lambert's is there.
    pub fn has_specular(&self) -> bool {
        self.has_reflector() || self.transmits() || self.coat > 0.0
    }

    fn has_reflector(&self) -> bool {
        self.f90 > 0.0 || self.f0 != Color::ZERO
    }

    /// True if light passes to the other side, or might in a solid.
    pub fn transmits(&self) -> bool {
        self.solid > 0.0 || self.transmit != Color::ZERO
    }

    /// True if reflector and transmission are too sharp to evaluate. A solid of the surrounding
    /// index bends nothing, however rough.
    fn is_smooth(&self) -> bool {
        self.alpha < DELTA_ALPHA
    }

    fn transmits_smoothly(&self) -> bool {
        self.is_smooth() || self.eta == 1.0
    }

    /// True if nothing is there but delta lobes.
    pub fn is_delta_only(&self) -> bool {
        self.diffuse == Color::ZERO
            && (!self.has_reflector() || self.is_smooth())
            && (!self.transmits() || self.transmits_smoothly())
            && (self.coat == 0.0 || self.coat_alpha < DELTA_ALPHA)
    }

    /// α of the sharpest lobe besides Lambert's, 0 for delta lobes, 1 if there is none.
    pub fn sharpest(&self) -> f32 {
        let width = |there: bool, alpha: f32| {
            if !there {
                1.0
            } else if alpha < DELTA_ALPHA {
                0.0
            } else {
                alpha
            }
        };
        let transmission = if self.eta == 1.0 { 0.0 } else { self.alpha };
        width(self.has_reflector(), self.alpha)
            .min(width(self.transmits(), transmission))
            .min(width(self.coat > 0.0, self.coat_alpha))
    }

    /// See [`super::Bsdf::pane`]; the shares are those that [`View::sample`] draws from.
    pub fn pane(&self, wo: Vec3) -> Option<Pane> {
        if !self.transmits() || !self.transmits_smoothly() {
            return None;
        }
        let (view, grazing) = (self.view(wo, false), schlick_weight(wo.z));
        let mut reflected = Color::ZERO;
        if self.is_smooth() {
            reflected += view.reflect0.lerp(view.reflect90, grazing);
        }
        if self.coat_alpha < DELTA_ALPHA {
            reflected += self.coat * (COAT_F0 + (1.0 - COAT_F0) * grazing);
        }
        if self.eta == 0.0 {
            return Some(Pane {
                wi: -wo,
                passed: self.transmit * view.transmit,
                reflected,
                eta: 1.0,
            });
        }
        let (r, t, cos_t) = self.boundary(wo.z);
        let wi = refract(wo, Vec3::Z, self.eta, cos_t);
        reflected += r * view.transmit;
        (wi.z < 0.0 && t != Color::ZERO).then_some(Pane {
            wi,
            passed: t * view.transmit,
            reflected,
            eta: self.eta,
        })
    }

    /// The same surface seen from the other side.
    pub fn flipped(&self) -> Self {
        Self { eta: if self.eta > 0.0 { 1.0 / self.eta } else { 0.0 }, ..*self }
    }

    /// `(a, b)` of a reflector: its albedo is `F0 a + F90 b` before multiple scattering.
    #[inline]
    fn split_albedo(cos: f32, alpha: f32) -> (f32, f32) {
        if alpha >= DELTA_ALPHA {
            return reflection_albedo(cos, alpha);
        }
        let grazing = schlick_weight(cos);
        (1.0 - grazing, grazing)
    }

    /// [`Self::split_albedo`] of the reflector; `(1, 0)` if nothing depends on it.
    #[inline]
    fn split(&self, cos: f32) -> (f32, f32) {
        if self.has_reflector() || self.cover != Vec2::ZERO || self.transmits() {
            Self::split_albedo(cos, self.alpha)
        } else {
            (1.0, 0.0)
        }
    }

    /// Relative loss `(1 - E)/E` of single scattering, to be given back.
    #[inline]
    fn loss(&self, (a, b): (f32, f32)) -> f32 {
        if self.multiple_scattering { (1.0 - a - b) / (a + b) } else { 0.0 }
    }

    /// Reflectances (F0, F90) of the reflector with what multiple scattering gives back. A lobe of
    /// single-scattering albedo E and reflectance F = F0 + (F90 - F0)(1 - cosθ_h)⁵ becomes `F
    /// (1 + F0 (1 - E)/E)` [Turquin19], summed over metal and dielectric.
    #[inline]
    fn reflectances(&self, split: (f32, f32)) -> (Color, Color) {
        let loss = self.loss(split);
        (self.f0 + self.again0 * loss, Color::splat(self.f90) + self.again90 * loss)
    }

    /// Albedo of the coat.
    #[inline]
    fn coat_albedo(&self, cos: f32) -> f32 {
        if self.coat == 0.0 {
            return 0.0;
        }
        let (a, b) = Self::split_albedo(cos, self.coat_alpha);
        self.coat * (COAT_F0 * a + b)
    }

    /// Albedo of the dielectric above the Lambert lobe, given its split.
    #[inline]
    fn cover_albedo(&self, split: (f32, f32)) -> f32 {
        ((self.cover.x * split.0 + self.cover.y * split.1)
            * (1.0 + self.cover.x * self.loss(split)))
        .min(1.0)
    }

    /// Albedo of the Lambert lobe seen at `cos`.
    #[inline]
    pub fn diffuse_albedo(&self, cos: f32) -> Color {
        if self.diffuse == Color::ZERO {
            return Color::ZERO;
        }
        let split = self.split(cos);
        self.diffuse * ((1.0 - self.coat_albedo(cos)) * (1.0 - self.cover_albedo(split)))
    }

    /// What depends on `wo` (`wo_z > 0`) alone.
    #[inline]
    pub fn view(&self, wo: Vec3, with_diffuse: bool) -> View<'_> {
        let cos = wo.z;
        let coat = self.coat_albedo(cos);
        let below_coat = 1.0 - coat;
        let split = self.split(cos);
        let uncovered = below_coat * (1.0 - self.cover_albedo(split));
        let diffuse = if with_diffuse { self.diffuse * uncovered } else { Color::ZERO };
        let (f0, f90) = self.reflectances(split);
        let (reflect0, reflect90) = (f0 * below_coat, f90 * below_coat);
        let (transmit, transmitted) = if !self.transmits() {
            (0.0, 0.0)
        } else if self.eta == 0.0 {
            (uncovered / (split.0 + split.1), mean(self.transmit) * uncovered)
        } else {
            let exact = self.transmits_smoothly() || !self.multiple_scattering;
            let single = if exact { 1.0 } else { glass_albedo(cos, self.alpha, self.eta) };
            let (r, t, _) = self.boundary(cos);
            (below_coat / single, mean(r + t) * below_coat)
        };
        let mut pick =
            [mean(diffuse), mean(reflect0 * split.0 + reflect90 * split.1), transmitted, coat];
        let total: f32 = pick.iter().sum();
        if total > 0.0 {
            pick = pick.map(|p| p / total);
        }
        View { layers: self, diffuse, reflect0, reflect90, transmit, pick }
    }

    /// Reflectance and transmittance (without `1/η²`) of the solid's boundary at one microfacet,
    /// and the refracted cosine.
    ///
    /// The exact dielectric reflectance, scaled by `solid_specular` towards normal incidence and by
    /// nothing at grazing incidence and on total reflection, as glTF's F0 and F90 behave; what
    /// is not reflected by the strongest channel is transmitted.
    #[inline]
    fn boundary(&self, cos: f32) -> (Color, Color, f32) {
        let (fresnel, cos_t) = fresnel_dielectric(cos.clamp(0.0, 1.0), self.eta);
        let r = self.solid_specular.lerp(Color::ONE, fresnel) * fresnel;
        (self.solid * r, self.transmit * (1.0 - r.max_element()), cos_t)
    }

    /// Albedo of all lobes, transmission included.
    pub fn albedo(&self, wo: Vec3) -> Color {
        let cos = wo.z;
        let split = self.split(cos);
        let coat = self.coat_albedo(cos);
        let covered = if self.eta == 0.0 { self.diffuse + self.transmit } else { self.diffuse };
        let mut below = covered * (1.0 - self.cover_albedo(split));
        let (f0, f90) = self.reflectances(split);
        below += f0 * split.0 + f90 * split.1;
        if self.eta > 0.0 && self.transmits() {
            let (r, t, _) = self.boundary(cos);
            below += r + t;
        }
        below * (1.0 - coat) + Color::splat(coat)
    }
}

/// The share of a boundary's light that its sampler reflects.
#[inline]
fn reflect_share(r: Color, t: Color) -> f32 {
    let (r, t) = (mean(r), mean(t));
    if r + t > 0.0 { r / (r + t) } else { 1.0 }
}

impl View<'_> {
    /// All lobes of finite width, and the density of [`View::sample`] per steradian.
    #[inline]
    pub fn f_pdf(&self, wo: Vec3, wi: Vec3) -> (Color, f32) {
        if wi.z > 0.0 {
            self.f_pdf_reflected(wo, wi)
        } else if wi.z < 0.0 && self.pick[2] > 0.0 && !self.layers.transmits_smoothly() {
            if self.layers.eta == 0.0 {
                self.f_pdf_thin(wo, wi)
            } else {
                self.f_pdf_refracted(wo, wi)
            }
        } else {
            (Color::ZERO, 0.0)
        }
    }

    fn f_pdf_reflected(&self, wo: Vec3, wi: Vec3) -> (Color, f32) {
        let l = self.layers;
        let mut f = self.diffuse * INV_PI;
        let mut pdf = self.pick[0] * wi.z * INV_PI;
        let rough_base = !l.is_smooth() && (l.has_reflector() || l.solid > 0.0);
        let rough_coat = l.coat > 0.0 && l.coat_alpha >= DELTA_ALPHA;
        if !(rough_base || rough_coat) {
            return (f, pdf);
        }
        let h = (wo + wi).normalize_or(Vec3::Z);
        let cos_h = wo.dot(h);
        let grazing = schlick_weight(cos_h);
        if rough_base {
            let d = ggx_d(h, l.alpha);
            let lobe = d * visibility(wo.z, wi.z, l.alpha);
            let lobe_pdf = 0.25 * d * g1_over_cos(wo.z, l.alpha);
            f += self.reflect0.lerp(self.reflect90, grazing) * lobe;
            pdf += self.pick[1] * lobe_pdf;
            if l.solid > 0.0 && !l.transmits_smoothly() {
                let (r, t, _) = l.boundary(cos_h);
                f += self.transmit * r * lobe;
                pdf += self.pick[2] * reflect_share(r, t) * lobe_pdf;
            }
        }
        if rough_coat {
            let d = ggx_d(h, l.coat_alpha);
            f += l.coat
                * (COAT_F0 + (1.0 - COAT_F0) * grazing)
                * d
                * visibility(wo.z, wi.z, l.coat_alpha);
            pdf += self.pick[3] * 0.25 * d * g1_over_cos(wo.z, l.coat_alpha);
        }
        (f, pdf)
    }

    /// A thin sheet passes the mirror image of what it would reflect: no bending, but the blur of
    /// its roughness.
    fn f_pdf_thin(&self, wo: Vec3, wi: Vec3) -> (Color, f32) {
        let l = self.layers;
        let d = ggx_d((wo + flip(wi)).normalize_or(Vec3::Z), l.alpha);
        let f = l.transmit * (self.transmit * d * visibility(wo.z, -wi.z, l.alpha));
        (f, self.pick[2] * 0.25 * d * g1_over_cos(wo.z, l.alpha))
    }

    /// Refraction by microfacets [Walter07, Eq. 21], the radiance scaled by `1/η²`.
    fn f_pdf_refracted(&self, wo: Vec3, wi: Vec3) -> (Color, f32) {
        let l = self.layers;
        let h = (wo + l.eta * wi).normalize_or(Vec3::Z);
        let h = if h.z < 0.0 { -h } else { h };
        let (cos_h, cos_t) = (wo.dot(h), -wi.dot(h));
        if cos_h <= 0.0 || cos_t <= 0.0 {
            return (Color::ZERO, 0.0);
        }
        let (r, t, _) = l.boundary(cos_h);
        let root = cos_h / l.eta - cos_t;
        let jacobian = cos_t / (root * root).max(1e-12);
        let d = ggx_d(h, l.alpha);
        let f = t
            * (self.transmit * 4.0 * d * visibility(wo.z, -wi.z, l.alpha) * cos_h * jacobian
                / (l.eta * l.eta));
        (
            f,
            self.pick[2]
                * (1.0 - reflect_share(r, t))
                * visible_normal_pdf(wo, h, l.alpha)
                * jacobian,
        )
    }

    /// Draws a lobe and from it a direction; arguments as in [`super::Bsdf::sample`].
    pub fn sample(&self, wo: Vec3, lobe_u: f32, u: Vec2) -> Option<BsdfSample> {
        let l = self.layers;
        let mut x = lobe_u;
        let last = self.pick.iter().rposition(|&p| p > 0.0)?;
        let mut lobe = 0;
        while lobe < last && x >= self.pick[lobe] {
            x -= self.pick[lobe];
            lobe += 1;
        }
        let p = self.pick[lobe];
        match lobe {
            0 => self.finish(wo, square_to_cosine_hemisphere(u), Lobe::Diffuse, 1.0),
            1 if l.is_smooth() => {
                let fresnel = self.reflect0.lerp(self.reflect90, schlick_weight(wo.z));
                delta(Vec3::new(-wo.x, -wo.y, wo.z), fresnel / p, 1.0)
            }
            1 => self.finish_reflected(wo, l.alpha, u),
            2 if l.eta == 0.0 && l.is_smooth() => delta(-wo, l.transmit * (self.transmit / p), 1.0),
            2 if l.eta == 0.0 => {
                let wi = flip(reflect(wo, sample_visible_normal(wo, l.alpha, u)));
                if wi.z < 0.0 { self.finish(wo, wi, Lobe::Glossy, 1.0) } else { None }
            }
            2 => self.sample_solid(wo, (x / p).min(1.0 - f32::EPSILON), p, u),
            _ if l.coat_alpha < DELTA_ALPHA => {
                let fresnel = COAT_F0 + (1.0 - COAT_F0) * schlick_weight(wo.z);
                delta(Vec3::new(-wo.x, -wo.y, wo.z), Color::splat(l.coat * fresnel / p), 1.0)
            }
            _ => self.finish_reflected(wo, l.coat_alpha, u),
        }
    }

    /// Reflects or refracts at the boundary of a solid; `p` is the probability of having come here,
    /// `x` chooses.
    fn sample_solid(&self, wo: Vec3, x: f32, p: f32, u: Vec2) -> Option<BsdfSample> {
        let l = self.layers;
        let smooth = l.transmits_smoothly();
        let h = if smooth { Vec3::Z } else { sample_visible_normal(wo, l.alpha, u) };
        let (r, t, cos_t) = l.boundary(wo.dot(h));
        let share = reflect_share(r, t);
        let reflected = x < share;
        let wi = if reflected { reflect(wo, h) } else { refract(wo, h, l.eta, cos_t) };
        let eta = if reflected { 1.0 } else { l.eta };
        if (wi.z > 0.0) != reflected || wi.z == 0.0 {
            return None;
        }
        if !smooth {
            return self.finish(wo, wi, Lobe::Glossy, eta);
        }
        let weight = if reflected { r / share } else { t / ((1.0 - share) * eta * eta) };
        delta(wi, weight * (self.transmit / p), eta)
    }

    fn finish_reflected(&self, wo: Vec3, alpha: f32, u: Vec2) -> Option<BsdfSample> {
        let wi = reflect(wo, sample_visible_normal(wo, alpha, u));
        if wi.z > 0.0 { self.finish(wo, wi, Lobe::Glossy, 1.0) } else { None }
    }

    /// Weighs a direction with all lobes.
    fn finish(&self, wo: Vec3, wi: Vec3, lobe: Lobe, eta: f32) -> Option<BsdfSample> {
        let (f, pdf) = self.f_pdf(wo, wi);
        let weight = f * (wi.z.abs() / pdf);
        (pdf > 0.0 && pdf.is_finite() && weight.is_finite()).then_some(BsdfSample {
            wi,
            weight,
            pdf,
            lobe,
            transmitted: wi.z < 0.0,
            eta,
        })
    }
}

/// A sample of a delta lobe.
fn delta(wi: Vec3, weight: Color, eta: f32) -> Option<BsdfSample> {
    Some(BsdfSample {
        wi,
        weight,
        pdf: f32::INFINITY,
        lobe: Lobe::Delta,
        transmitted: wi.z < 0.0,
        eta,
    })
}
