//! Daylight: the standard skies of the CIE, and the sun.

use super::source::{EnvironmentMap, PunctualLight};
use crate::error::{Error, Result};
use crate::math::{Affine3A, Color, PI, Vec3, luminance};

/// Rows of a tabulated sky, twice as many columns where it is not the same all round.
const ROWS: u32 = 512;
/// Diameter of the sun's disc in degrees.
const SUN_DIAMETER: f32 = 0.53;
/// Illuminance across the sun's rays outside the atmosphere, in lux [Kittler12, Sec. 3.2].
const SOLAR_CONSTANT: f64 = 133_800.0;

/// Which sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SkyKind {
    /// The traditional overcast sky of Moon and Spencer, three times as bright at the zenith as at
    /// the horizon.
    Overcast,
    /// One of the 15 standard general skies of the CIE by its number from 1 to 15 [CIES011, Table
    /// 1]; 12 is the CIE standard clear sky.
    General(u8),
}

/// What there is of a sun.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SunKind {
    /// None: clouds hide it, or it is left out.
    None,
    /// A disc of 0.53 degrees, seen and reflected, with soft shadows.
    Disc,
    /// A direction only: sharp shadows, not seen.
    Direction,
}

/// A sky with its sun and the ground below it. Illuminances are in lux, luminances in cd/m²;
/// azimuths are in degrees clockwise from north as seen from above, north being -Z and east +X.
#[derive(Clone, Debug, PartialEq)]
pub struct Sky {
    /// The distribution of luminance.
    pub kind: SkyKind,
    /// Azimuth of the sun.
    pub azimuth: f32,
    /// Elevation of the sun in degrees, above 0 and at most 90.
    pub elevation: f32,
    /// Horizontal illuminance from the sky alone; `None` derives it from the elevation.
    pub illuminance: Option<f32>,
    /// What there is of a sun.
    pub sun: SunKind,
    /// Illuminance from the sun across its rays; `None` derives it from elevation and turbidity.
    pub sun_illuminance: Option<f32>,
    /// Luminous turbidity: how many clean atmospheres dim the sun as much, from 1 to 20.
    pub turbidity: f32,
    /// Tint of the sky, of any scale: only its chromaticity counts.
    pub color: Color,
    /// Reflectance of the ground, which is seen below the horizon.
    pub ground: Color,
}

/// The parameters a, b, c, d, e of the general sky [CIES011, Table 1].
const GENERAL: [[f64; 5]; 15] = [
    [4.0, -0.70, 0.0, -1.0, 0.0],
    [4.0, -0.70, 2.0, -1.5, 0.15],
    [1.1, -0.80, 0.0, -1.0, 0.0],
    [1.1, -0.80, 2.0, -1.5, 0.15],
    [0.0, -1.0, 0.0, -1.0, 0.0],
    [0.0, -1.0, 2.0, -1.5, 0.15],
    [0.0, -1.0, 5.0, -2.5, 0.30],
    [0.0, -1.0, 10.0, -3.0, 0.45],
    [-1.0, -0.55, 2.0, -1.5, 0.15],
    [-1.0, -0.55, 5.0, -2.5, 0.30],
    [-1.0, -0.55, 10.0, -3.0, 0.45],
    [-1.0, -0.32, 10.0, -3.0, 0.45],
    [-1.0, -0.32, 16.0, -3.0, 0.30],
    [-1.0, -0.15, 16.0, -3.0, 0.30],
    [-1.0, -0.15, 24.0, -2.8, 0.15],
];

impl Sky {
    /// The sky of that kind with the sun in the south at 45 degrees: a disc where it can be seen,
    /// none behind the clouds of types 1 to 6.
    pub fn new(kind: SkyKind) -> Self {
        let clouded = matches!(kind, SkyKind::Overcast | SkyKind::General(..=6));
        Self {
            kind,
            azimuth: 180.0,
            elevation: 45.0,
            illuminance: None,
            sun: if clouded { SunKind::None } else { SunKind::Disc },
            sun_illuminance: None,
            turbidity: 3.0,
            color: Color::ONE,
            ground: Color::splat(0.2),
        }
    }

    /// Reads `KIND[,KEY=VALUE]...`: KIND is `overcast`, `clear` or `cie1` to `cie15`; the keys are
    /// `azimuth`, `elevation`, `illuminance`, `sun` (disc, direction
    /// or none), `sun-illuminance`, `turbidity`, `color` and `ground`, the last two one number or
    /// three as R/G/B.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] that names the part.
    pub fn parse(text: &str) -> Result<Self> {
        let mut parts = text.split(',').map(str::trim);
        let name = parts.next().unwrap_or("");
        let number = || {
            name.strip_prefix("cie")
                .and_then(|n| n.parse::<u8>().ok())
                .filter(|n| (1..=15).contains(n))
        };
        let kind = match (name, number()) {
            ("overcast", _) => SkyKind::Overcast,
            ("clear", _) => SkyKind::General(12),
            (_, Some(number)) => SkyKind::General(number),
            _ => {
                return Err(bad(format!(
                    "{name:?} is no sky: there are overcast, clear, and cie1 to cie15"
                )));
            }
        };
        let mut sky = Self::new(kind);
        for part in parts {
            let (key, value) =
                part.split_once('=').ok_or_else(|| bad(format!("{part:?}: expected KEY=VALUE")))?;
            sky.set(key.trim(), value.trim())?;
        }
        Ok(sky)
    }

    fn set(&mut self, key: &str, value: &str) -> Result<()> {
        let number = |low: f32, high: f32| match value.parse::<f32>() {
            Ok(x) if x >= low && x <= high => Ok(x),
            _ => Err(bad(format!("{key}={value}: expected a number from {low} to {high}"))),
        };
        let color = |high: f32| {
            let parts: Option<Vec<f32>> = value.split('/').map(|x| x.parse().ok()).collect();
            match parts.as_deref() {
                Some(&[x]) => Some(Color::splat(x)),
                Some(&[r, g, b]) => Some(Color::new(r, g, b)),
                _ => None,
            }
            .filter(|c| c.min_element() >= 0.0 && c.max_element() <= high)
            .ok_or_else(|| {
                bad(format!("{key}={value}: expected one number or R/G/B, each from 0 to {high}"))
            })
        };
        match key {
            "azimuth" => self.azimuth = number(-360.0, 360.0)?,
            "elevation" => self.elevation = number(0.1, 90.0)?,
            "illuminance" => self.illuminance = Some(number(0.0, 1e6)?),
            "sun-illuminance" => self.sun_illuminance = Some(number(0.0, 1e6)?),
            "turbidity" => self.turbidity = number(1.0, 20.0)?,
            "color" => {
                self.color = color(1e6)?;
                if luminance(self.color) <= 0.0 {
                    return Err(bad(format!("{key}={value}: a colour without light")));
                }
            }
            "ground" => self.ground = color(1.0)?,
            "sun" => {
                self.sun = match value {
                    "none" => SunKind::None,
                    "disc" => SunKind::Disc,
                    "direction" => SunKind::Direction,
                    _ => return Err(bad(format!("sun={value}: expected disc, direction or none"))),
                }
            }
            _ => {
                let known = "azimuth, elevation, illuminance, sun, sun-illuminance, turbidity, color, ground";
                return Err(bad(format!("{key:?} is unknown; known are {known}")));
            }
        }
        Ok(())
    }

    /// Unit direction towards the sun.
    pub fn sun_direction(&self) -> Vec3 {
        let (sin_a, cos_a) = self.azimuth.to_radians().sin_cos();
        let (sin_e, cos_e) = self.elevation.to_radians().sin_cos();
        Vec3::new(sin_a * cos_e, sin_e, -cos_a * cos_e)
    }

    /// Horizontal illuminance from the sky without the sun, in lux. Where none is given,
    ///
    /// ```text
    /// E = 300 + 21000 sin γ        overcast, types 1 to 5
    /// E = 300 + 45000 sin γ        partly cloudy, types 6 to 10
    /// E = 800 + 15500 √(sin γ)     clear, types 11 to 15      [Gillette84; IESNA00, Ch. 8]
    /// ```
    ///
    /// with the sun's elevation γ.
    pub fn sky_illuminance(&self) -> f64 {
        let sine = f64::from(self.elevation).to_radians().sin();
        self.illuminance.map_or_else(
            || match self.kind {
                SkyKind::Overcast | SkyKind::General(..=5) => 300.0 + 21_000.0 * sine,
                SkyKind::General(6..=10) => 300.0 + 45_000.0 * sine,
                SkyKind::General(_) => 800.0 + 15_500.0 * sine.sqrt(),
            },
            f64::from,
        )
    }

    /// Illuminance from the sun across its rays, in lux, 0 without a sun. Where none is given,
    ///
    /// ```text
    /// E = 133800 exp(-T m 0.1 / (1 + 0.0045 m))                          [Kittler12, Sec. 3.3]
    /// m = 1 / (sin γ + 0.50572 (γ + 6.07995)^-1.6364), γ in degrees      [Kasten89, Eq. 3]
    /// ```
    ///
    /// with the turbidity T and the air mass m.
    pub fn sun_illuminance(&self) -> f64 {
        if self.sun == SunKind::None {
            return 0.0;
        }
        let elevation = f64::from(self.elevation);
        self.sun_illuminance.map_or_else(
            || {
                let mass = 1.0
                    / (elevation.to_radians().sin()
                        + 0.505_72 * (elevation + 6.079_95).powf(-1.6364));
                SOLAR_CONSTANT
                    * (-f64::from(self.turbidity) * mass * 0.1 / (1.0 + 0.0045 * mass)).exp()
            },
            f64::from,
        )
    }

    /// The shape of the distribution, of no particular scale, at a zenith angle with cosine `cos` ≥
    /// 0 and the angle `chi` from the sun:
    ///
    /// ```text
    /// overcast  L = (1 + 2 cos Z) / 3    [MoonSpencer42]
    /// general   L = (1 + a exp(b / cos Z)) (1 + c (exp(d χ) - exp(d π/2)) + e cos² χ)
    /// ```
    ///
    /// The general sky is that of [CIES011, Eq. 1-5].
    pub fn relative_luminance(&self, cos: f64, chi: f64) -> f64 {
        match self.kind {
            SkyKind::Overcast => (1.0 + 2.0 * cos) / 3.0,
            SkyKind::General(number) => {
                let [a, b, c, d, e] = GENERAL[usize::from(number) - 1];
                let gradation = 1.0 + a * (b / cos.max(1e-6)).exp();
                let indicatrix = 1.0
                    + c * ((d * chi).exp() - (d * std::f64::consts::FRAC_PI_2).exp())
                    + e * chi.cos().powi(2);
                gradation * indicatrix
            }
        }
    }

    /// The relative luminance in a direction above the horizon.
    fn towards(&self, direction: Vec3) -> f64 {
        let to_sun = self.sun_direction();
        let chi =
            f64::from(direction.cross(to_sun).length()).atan2(f64::from(direction.dot(to_sun)));
        self.relative_luminance(f64::from(direction.y), chi)
    }

    /// Luminance at the zenith in cd/m².
    pub fn zenith_luminance(&self) -> f64 {
        self.scale() * self.towards(Vec3::Y)
    }

    /// The factor from relative luminance to cd/m²: illuminance over ∫ L cos Z dω. That integral is
    /// 7π/9 for the overcast sky.
    fn scale(&self) -> f64 {
        let integral = match self.kind {
            SkyKind::Overcast => 7.0 / 9.0 * std::f64::consts::PI,
            SkyKind::General(_) => {
                // The midpoint rule over the squared sine of the zenith angle, in which the cosine
                // is uniform.
                let (rows, columns) = (256, 512);
                let sum: f64 = (0..rows * columns)
                    .map(|i| {
                        let squared = (f64::from(i / columns) + 0.5) / f64::from(rows);
                        let azimuth = 2.0 * std::f64::consts::PI * (f64::from(i % columns) + 0.5)
                            / f64::from(columns);
                        let (sin, cos) = (squared.sqrt(), (1.0 - squared).sqrt());
                        self.towards(Vec3::new(
                            (sin * azimuth.cos()) as f32,
                            cos as f32,
                            (sin * azimuth.sin()) as f32,
                        ))
                    })
                    .sum();
                sum * std::f64::consts::PI / f64::from(rows * columns)
            }
        };
        self.sky_illuminance() / integral
    }

    /// Sky and ground as an environment whose radiance is the luminance in cd/m² divided by
    /// `efficacy`, in lm/W, without the sun. The ground reflects what falls on it from sky and
    /// sun, as a Lambertian surface does.
    pub fn environment(&self, efficacy: f32) -> EnvironmentMap {
        let scale = self.scale() / f64::from(efficacy);
        let tint = self.color / luminance(self.color);
        let uniform = matches!(self.kind, SkyKind::Overcast | SkyKind::General(1 | 3 | 5));
        let (width, height) = (if uniform { 1 } else { 2 * ROWS }, ROWS);
        let sine = f64::from(self.elevation).to_radians().sin();
        let from_sky = tint * (self.sky_illuminance() / f64::from(efficacy)) as f32;
        let from_sun = Color::splat((self.sun_illuminance() * sine / f64::from(efficacy)) as f32);
        let ground = self.ground * (from_sky + from_sun) / PI;
        let pixels = (0..width * height)
            .map(|i| {
                let (theta, phi) = (
                    PI * ((i / width) as f32 + 0.5) / height as f32,
                    2.0 * PI * (((i % width) as f32 + 0.5) / width as f32 - 0.5),
                );
                let direction =
                    Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
                if direction.y > 0.0 {
                    tint * (scale * self.towards(direction)) as f32
                } else {
                    ground
                }
            })
            .collect();
        EnvironmentMap { width, height, pixels, scale: 1.0, from_world: Affine3A::IDENTITY }
    }

    /// The sun, in irradiance across its rays: illuminance in lux divided by `efficacy`.
    pub fn sun(&self, efficacy: f32) -> Option<PunctualLight> {
        let irradiance = Color::splat((self.sun_illuminance() / f64::from(efficacy)) as f32);
        let direction = -self.sun_direction();
        match self.sun {
            SunKind::None => None,
            SunKind::Direction => Some(PunctualLight::Directional { direction, irradiance }),
            SunKind::Disc => Some(PunctualLight::Disc {
                direction,
                irradiance,
                radius: 0.5 * SUN_DIAMETER.to_radians(),
            }),
        }
    }
}

fn bad(what: String) -> Error {
    Error::InvalidArgument(format!("--sky: {what}"))
}
