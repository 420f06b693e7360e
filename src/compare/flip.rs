//! LDR-FLIP: the difference that a viewer sees when flipping between two pictures [Andersson20,
//! Section 4].
//!
//! Colour: both pictures go to YCxCz, are blurred by the eye's contrast sensitivity, and are
//! compared by the HyAB distance in L*a*b* with Hunt's adjustment. Features: edges and points of
//! the luminance are found at a fixed visual angle. The feature difference then amplifies the
//! colour difference. Pictures are extended by their border pixels.

use crate::math::Color;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Pixels per degree of a 0.7 m wide screen of 3840 columns seen from 0.7 m [Andersson20, Section
/// 4].
pub const PIXELS_PER_DEGREE: f32 = 67.020_64;

/// Rec. 709 to XYZ, from the primaries and white of [BT709, Section 1], row by row.
const RGB_TO_XYZ: [[f32; 3]; 3] = [
    [
        (10_135_552.0 / 24_577_794.0) as f32,
        (8_788_810.0 / 24_577_794.0) as f32,
        (4_435_075.0 / 24_577_794.0) as f32,
    ],
    [
        (2_613_072.0 / 12_288_897.0) as f32,
        (8_788_810.0 / 12_288_897.0) as f32,
        (887_015.0 / 12_288_897.0) as f32,
    ],
    [
        (1_425_312.0 / 73_733_382.0) as f32,
        (8_788_810.0 / 73_733_382.0) as f32,
        (70_074_185.0 / 73_733_382.0) as f32,
    ],
];

/// Exponent of the colour difference [Andersson20, Section 4.1].
const Q_C: f32 = 0.7;
/// Where the compression of large colour differences begins, as a part of the largest [Andersson20,
/// Section 4.1].
const P_C: f32 = 0.4;
/// What that point is mapped to [Andersson20, Section 4.1].
const P_T: f32 = 0.95;
/// Width of the feature detectors in degrees [Andersson20, Section 4.2].
const FEATURE_WIDTH: f64 = 0.082;
/// Exponent of the feature difference [Andersson20, Section 4.2].
const Q_F: f32 = 0.5;

/// The sums of two Gaussians that approximate the contrast sensitivity of the channels Y, Cx, Cz:
/// (a1, b1, a2, b2) [Andersson20, Table 1].
const SENSITIVITY: [[f64; 4]; 3] =
    [[1.0, 0.0047, 0.0, 1e-5], [1.0, 0.0053, 0.0, 1e-5], [34.1, 0.04, 13.5, 0.025]];

/// One plane of values, row by row.
type Plane = Vec<f32>;

/// The difference of each pixel, from 0 to 1, of two pictures of `width` columns in linear Rec.
/// 709; values are clamped to the unit interval first. Symmetric in the pictures.
///
/// # Panics
/// When the pictures differ in length or `width` does not divide it.
pub fn flip(reference: &[Color], test: &[Color], width: usize, pixels_per_degree: f32) -> Vec<f32> {
    assert!(
        reference.len() == test.len() && width > 0 && reference.len().is_multiple_of(width),
        "two pictures of {width} columns"
    );
    let (reference, test) = rayon::join(
        || Seen::new(reference, width, pixels_per_degree),
        || Seen::new(test, width, pixels_per_degree),
    );
    let largest = hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])).powf(Q_C);
    (0..reference.lab.len())
        .into_par_iter()
        .map(|i| {
            let color = compress(hyab(reference.lab[i], test.lab[i]).powf(Q_C), largest);
            let edge = (reference.edges[i] - test.edges[i]).abs();
            let point = (reference.points[i] - test.points[i]).abs();
            let feature = (edge.max(point) / std::f32::consts::SQRT_2).powf(Q_F).min(1.0);
            color.powf(1.0 - feature)
        })
        .collect()
}

/// What is compared of a picture.
struct Seen {
    /// L*a*b* with Hunt's adjustment after the blur.
    lab: Vec<[f32; 3]>,
    /// Length of the luminance's gradient.
    edges: Plane,
    /// Length of the luminance's second differences.
    points: Plane,
}

impl Seen {
    fn new(picture: &[Color], width: usize, pixels_per_degree: f32) -> Self {
        let ycxcz: Vec<[f32; 3]> = picture
            .par_iter()
            .map(|c| ycxcz_of(c.clamp(Color::ZERO, Color::ONE).to_array()))
            .collect();
        let luminance: Plane = ycxcz.iter().map(|c| (c[0] + 16.0) / 116.0).collect();
        let [edges, points] = features(&luminance, width, f64::from(pixels_per_degree));
        let planes: Vec<Plane> = (0..3)
            .map(|c| {
                blur(
                    &ycxcz.iter().map(|v| v[c]).collect::<Plane>(),
                    width,
                    f64::from(pixels_per_degree),
                    SENSITIVITY[c],
                )
            })
            .collect();
        let lab = (0..picture.len())
            .into_par_iter()
            .map(|i| {
                hunt_lab(
                    rgb_of([planes[0][i], planes[1][i], planes[2][i]]).map(|x| x.clamp(0.0, 1.0)),
                )
            })
            .collect();
        Self { lab, edges, points }
    }
}

fn xyz_of(rgb: [f32; 3]) -> [f32; 3] {
    RGB_TO_XYZ.map(|row| row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2])
}

/// XYZ relative to that of white.
fn relative_xyz(rgb: [f32; 3]) -> [f32; 3] {
    let (xyz, white) = (xyz_of(rgb), xyz_of([1.0; 3]));
    [xyz[0] / white[0], xyz[1] / white[1], xyz[2] / white[2]]
}

/// The opponent space in which the blur happens: linear, unlike L*a*b* [Andersson20, Section 4.1].
fn ycxcz_of(rgb: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = relative_xyz(rgb);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// The inverse of [`ycxcz_of`].
fn rgb_of([y, cx, cz]: [f32; 3]) -> [f32; 3] {
    let white = xyz_of([1.0; 3]);
    let y = (y + 16.0) / 116.0;
    let xyz =
        glam::Vec3::new((y + cx / 500.0) * white[0], y * white[1], (y - cz / 200.0) * white[2]);
    let matrix = glam::Mat3::from_cols_array_2d(&RGB_TO_XYZ).transpose();
    (matrix.inverse() * xyz).to_array()
}

/// CIE L*a*b* with a* and b* scaled by 0.01 L*: colours are less vivid in the dark [Andersson20,
/// Section 4.1].
fn hunt_lab(rgb: [f32; 3]) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let f = |t: f32| {
        if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    };
    let [x, y, z] = relative_xyz(rgb).map(f);
    let lightness = 116.0 * y - 16.0;
    let hunt = 0.01 * lightness;
    [lightness, 500.0 * (x - y) * hunt, 200.0 * (y - z) * hunt]
}

/// The distance for large differences: city block between lightness and the Euclidean distance of
/// the rest [Andersson20, Section 4.1].
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// Maps [0, P_C largest] to [0, P_T] and the rest to [P_T, 1] [Andersson20, Section 4.1].
fn compress(difference: f32, largest: f32) -> f32 {
    let knee = P_C * largest;
    if difference < knee {
        difference * P_T / knee
    } else {
        P_T + (difference - knee) / (largest - knee) * (1.0 - P_T)
    }
}

/// `plane` filtered by the sum of two Gaussians, whose two-dimensional weights sum to 1.
fn blur(plane: &[f32], width: usize, pixels_per_degree: f64, [a1, b1, a2, b2]: [f64; 4]) -> Plane {
    let widest = SENSITIVITY.iter().flat_map(|s| [s[1], s[3]]).fold(0.0, f64::max);
    let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i32;
    let part = |a: f64, b: f64| {
        let kernel: Vec<f64> = (-radius..=radius)
            .map(|i| (-(PI * f64::from(i) / pixels_per_degree).powi(2) / b).exp())
            .collect();
        let sum: f64 = kernel.iter().sum();
        (a * (PI / b).sqrt() * sum * sum, kernel.iter().map(|k| k / sum).collect::<Vec<_>>())
    };
    let ((weight1, kernel1), (weight2, kernel2)) = (part(a1, b1), part(a2, b2));
    let mut result = separable(plane, width, &kernel1, &kernel1);
    if weight2 > 0.0 {
        let share = (weight1 / (weight1 + weight2)) as f32;
        for (a, b) in result.iter_mut().zip(separable(plane, width, &kernel2, &kernel2)) {
            *a = share * *a + (1.0 - share) * b;
        }
    }
    result
}

/// Lengths of the first and second differences of `luminance` at the feature detectors' scale
/// [Andersson20, Section 4.2].
fn features(luminance: &[f32], width: usize, pixels_per_degree: f64) -> [Plane; 2] {
    let deviation = 0.5 * FEATURE_WIDTH * pixels_per_degree;
    let radius = (3.0 * deviation).ceil() as i32;
    let sampled = |f: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
        (-radius..=radius)
            .map(|i| f(f64::from(i), (-f64::from(i * i) / (2.0 * deviation * deviation)).exp()))
            .collect()
    };
    // Positive weights sum to 1, negative ones to -1.
    let balanced = |kernel: Vec<f64>| -> Vec<f64> {
        let positive: f64 = kernel.iter().filter(|k| **k > 0.0).sum();
        let negative: f64 = -kernel.iter().filter(|k| **k < 0.0).sum::<f64>();
        kernel.into_iter().map(|k| if k > 0.0 { k / positive } else { k / negative }).collect()
    };
    let smooth = sampled(&|_, g| g);
    let total: f64 = smooth.iter().sum();
    let smooth: Vec<f64> = smooth.iter().map(|g| g / total).collect();
    let first = balanced(sampled(&|x, g| -x * g));
    let second = balanced(sampled(&|x, g| (x * x / (deviation * deviation) - 1.0) * g));
    [first, second].map(|kernel| {
        let (along, across) = (
            separable(luminance, width, &kernel, &smooth),
            separable(luminance, width, &smooth, &kernel),
        );
        along.iter().zip(across).map(|(x, y)| x.hypot(y)).collect()
    })
}

/// `plane` filtered along its rows by one kernel and along its columns by another, border values
/// repeated outside.
fn separable(plane: &[f32], width: usize, along: &[f64], across: &[f64]) -> Plane {
    let height = plane.len() / width;
    let tap =
        |i: usize, k: usize, radius: usize, end: usize| (i + k).saturating_sub(radius).min(end - 1);
    let mut rows = vec![0f32; plane.len()];
    rows.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(to, from)| {
        for (x, value) in to.iter_mut().enumerate() {
            let sum: f64 = along
                .iter()
                .enumerate()
                .map(|(k, w)| w * f64::from(from[tap(x, k, along.len() / 2, width)]))
                .sum();
            *value = sum as f32;
        }
    });
    let mut result = vec![0f32; plane.len()];
    result.par_chunks_mut(width).enumerate().for_each(|(y, to)| {
        let mut sums = vec![0f64; width];
        for (k, w) in across.iter().enumerate() {
            let row = tap(y, k, across.len() / 2, height) * width;
            for (sum, value) in sums.iter_mut().zip(&rows[row..row + width]) {
                *sum += w * f64::from(*value);
            }
        }
        for (value, sum) in to.iter_mut().zip(sums) {
            *value = sum as f32;
        }
    });
    result
}

/// Colours of the map from black through purple and orange to pale yellow, at equal distances;
/// close to matplotlib's magma.
const MAP: [[f32; 3]; 9] = [
    [0.0, 0.0, 4.0],
    [28.0, 16.0, 68.0],
    [79.0, 18.0, 123.0],
    [129.0, 37.0, 129.0],
    [181.0, 54.0, 122.0],
    [229.0, 80.0, 100.0],
    [251.0, 135.0, 97.0],
    [254.0, 194.0, 135.0],
    [252.0, 253.0, 191.0],
];

/// Differences from 0 (black) to 1 (pale yellow) as sRGB bytes, three per pixel.
pub fn color_map(differences: &[f32]) -> Vec<u8> {
    let color = |d: f32| {
        let t = d.clamp(0.0, 1.0) * (MAP.len() - 1) as f32;
        let i = (t as usize).min(MAP.len() - 2);
        let (a, b, s) = (MAP[i], MAP[i + 1], t - i as f32);
        [0, 1, 2].map(|c| (a[c] + s * (b[c] - a[c]) + 0.5) as u8)
    };
    differences.iter().flat_map(|&d| color(d)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ycxcz_is_invertible_and_white_is_neutral() {
        for rgb in [[0.2, 0.5, 0.9], [1.0, 0.0, 0.0], [0.0; 3]] {
            let back = rgb_of(ycxcz_of(rgb));
            assert!(rgb.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-5), "{rgb:?} {back:?}");
        }
        let [l, a, b] = hunt_lab([1.0; 3]);
        assert!((l - 100.0).abs() < 1e-3 && a.abs() < 1e-3 && b.abs() < 1e-3);
    }

    #[test]
    fn equal_pictures_do_not_differ_and_opposite_ones_differ_fully() {
        let (black, white) = (vec![Color::ZERO; 64], vec![Color::ONE; 64]);
        assert!(flip(&black, &black, 8, PIXELS_PER_DEGREE).iter().all(|&d| d == 0.0));
        let (green, blue) = (vec![Color::Y; 64], vec![Color::Z; 64]);
        assert!(flip(&green, &blue, 8, PIXELS_PER_DEGREE).iter().all(|&d| (d - 1.0).abs() < 1e-3));
        let there = flip(&black, &white, 8, PIXELS_PER_DEGREE);
        assert_eq!(there, flip(&white, &black, 8, PIXELS_PER_DEGREE));
    }

    #[test]
    fn the_map_starts_black_and_gets_brighter() {
        let bytes = color_map(&(0..=64).map(|i| i as f32 / 64.0).collect::<Vec<_>>());
        assert_eq!(bytes[..3], [0, 0, 4]);
        assert_eq!(bytes[64 * 3..], [252, 253, 191]);
        let brightness: Vec<u32> =
            bytes.chunks(3).map(|c| c.iter().map(|&b| u32::from(b)).sum()).collect();
        assert!(brightness.windows(2).all(|w| w[0] <= w[1]));
        assert_eq!(color_map(&[f32::NAN]), [0; 3]);
    }
}
