//! By how many stops linear light is brightened for a display.

use crate::math::{Color, luminance};
use std::str::FromStr;

/// The luminance of mid-gray on a display whose white is 1 [Reinhard02, Section 3.1].
pub const MID_GRAY: f32 = 0.18;
/// The share of the pixels that an automatic exposure keeps from white.
const NOT_WHITE: f64 = 0.9;
/// Fractions of a stop: what is printed with two decimals is the exposure itself.
const STEPS: f32 = 100.0;

/// The exposure of a picture: linear light is multiplied by 2 to the power of its stops.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exposure {
    /// What the picture needs: see [`Exposure::decided`].
    #[default]
    Auto,
    /// So many stops.
    Stops(f32),
}

impl Exposure {
    /// The exposure that suits `pixels`, in stops:
    ///
    /// `EV = min(log2(0.18 / L_50), log2(1 / L_90))`,
    ///
    /// where `L_p` is the luminance that p percent of the pixels with any light do not exceed. Of
    /// all factors on the light none changes the exposed picture. It is rounded to 1/100 stop.
    ///
    /// The first term takes the middle of the picture to mid-gray as [Reinhard02, Eqs. 1 and 2] do.
    /// There the middle is the mean of the logarithms. Here it is their median: pixels that are
    /// almost black, as in a dark room beside a lit one, pull the mean down without bound. The
    /// second term, which is not in the paper, leaves nine tenths of the pixels below white.
    ///
    /// A given number of stops stays as it is. So does [`Exposure::Auto`] where `pixels` are black:
    /// they say nothing.
    #[must_use]
    pub fn decided(self, pixels: impl FnOnce() -> Vec<Color>) -> Self {
        if self != Self::Auto {
            return self;
        }
        let Some([middle, bright]) = luminances(&pixels(), [0.5, NOT_WHITE]) else { return self };
        let stops = (MID_GRAY / middle).log2().min(-bright.log2());
        // Not -0: that would be printed.
        Self::Stops((stops * STEPS).round() / STEPS + 0.0)
    }

    /// The stops, 0 for what is not decided.
    pub fn stops(self) -> f32 {
        match self {
            Self::Auto => 0.0,
            Self::Stops(stops) => stops,
        }
    }
}

impl From<f32> for Exposure {
    fn from(stops: f32) -> Self {
        Self::Stops(stops)
    }
}

impl FromStr for Exposure {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let stops = text.parse().ok().filter(|stops: &f32| stops.is_finite());
        stops.map(Self::Stops).ok_or_else(|| "expected auto or a number of stops".into())
    }
}

/// For each of `shares`, from 0 to 1, the luminance below which this share of the pixels lies.
/// Black pixels, and those that are no numbers, do not count; `None` without any other.
pub fn luminances<const N: usize>(pixels: &[Color], shares: [f64; N]) -> Option<[f32; N]> {
    let seen = pixels.iter().map(|c| luminance(*c));
    let mut seen: Vec<f32> = seen.filter(|l| l.is_finite() && *l > 0.0).collect();
    let last = seen.len().checked_sub(1)?;
    Some(shares.map(|share| {
        let place = (share * seen.len() as f64) as usize;
        *seen.select_nth_unstable_by(place.min(last), f32::total_cmp).1
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn auto(pixels: &[Color]) -> f32 {
        let exposure = Exposure::Auto.decided(|| pixels.to_vec());
        assert_eq!(exposure.decided(|| panic!("it is decided")), exposure);
        exposure.stops()
    }

    fn gray(values: &[f32]) -> Vec<Color> {
        values.iter().map(|x| Color::splat(*x)).collect()
    }

    #[test]
    fn the_middle_becomes_mid_gray_in_any_unit_of_light() {
        let ramp: Vec<f32> = (1..=100).map(|i| 0.0018 * i as f32).collect();
        for (factor, stops) in [(2.0, 0.0), (1000.0, -8.97), (2e-12, 39.86), (2e30, -99.66)] {
            let lit: Vec<f32> = ramp.iter().map(|x| factor * x).collect();
            assert!((auto(&gray(&lit)) - stops).abs() < 0.05, "{factor}: {}", auto(&gray(&lit)));
        }
        // What is no light, or no number, does not count, and few bright pixels hardly do.
        let mut pixels = gray(&[0.18; 12]);
        pixels.extend(gray(&[0.0, -1.0, f32::NAN, f32::INFINITY]).repeat(9));
        pixels.extend(gray(&[1e9]));
        assert_eq!(auto(&pixels), 0.0);
    }

    #[test]
    fn a_tenth_of_the_pixels_at_most_is_white() {
        let mut values = vec![1e-9; 80];
        values.extend([4.0; 20]);
        assert_eq!(auto(&gray(&values)), -2.0);
        values.truncate(85);
        assert!(auto(&gray(&values)) > 20.0);
    }

    #[test]
    fn black_decides_nothing() {
        for pixels in [vec![], gray(&[0.0; 9]), gray(&[f32::NAN, f32::INFINITY])] {
            assert_eq!(Exposure::Auto.decided(|| pixels), Exposure::Auto);
        }
        assert_eq!(Exposure::Auto.stops(), 0.0);
        assert_eq!(Exposure::Stops(3.0).decided(|| panic!("it is decided")), 3.0.into());
    }

    #[test]
    fn what_is_printed_is_read_back() {
        for k in -2000..2000 {
            let stops = auto(&gray(&[(k as f32 * 0.0137).exp2()]));
            assert_eq!(format!("{stops:.2}").parse(), Ok(Exposure::Stops(stops)));
        }
        assert_eq!("auto".parse(), Ok(Exposure::Auto));
        assert_eq!("-2.5".parse(), Ok(Exposure::Stops(-2.5)));
        for bad in ["", "inf", "nan", "Auto", "1e99", "bright"] {
            assert!(bad.parse::<Exposure>().is_err(), "{bad}");
        }
    }
}
