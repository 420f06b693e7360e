//! Where an image needs more samples than others.

use crate::film::Film;
use crate::math::luminance;

/// Most samples that a pixel may get, as a multiple of what every pixel gets.
const MOST: u32 = 4;
/// Pixels darker than this share of the mean are judged as if they were that bright.
const DARK: f32 = 0.1;

/// How many samples each pixel of `film`, all of which have had `spp`, needs in all for a relative
/// standard error of `target`: a multiple of `spp`.
///
/// A pixel is judged by its neighbours, never by itself: a pixel that has a say would be kept where
/// its samples happened to miss the light and refined where they happened to find it, which darkens
/// the picture. Pixels are sampled independently, so the number of samples is independent of their
/// values and the mean over them is unbiased. A pixel without neighbours keeps what it has.
pub fn samples_wanted(film: &Film, spp: u32, target: f32) -> Vec<u32> {
    let [width, height] = film.window_size().map(|n| n as usize);
    let noise: Vec<[f32; 2]> =
        film.pixels().iter().map(|p| [p.luminance_variance(), luminance(p.radiance())]).collect();
    let light: f64 = noise.iter().map(|[_, mean]| f64::from(*mean)).sum();
    let others = noise.len().saturating_sub(1).max(1) as f64;
    let mut wanted = Vec::with_capacity(noise.len());
    for y in 0..height {
        for x in 0..width {
            let (columns, rows) =
                (x.saturating_sub(1)..width.min(x + 2), y.saturating_sub(1)..height.min(y + 2));
            let count = (columns.len() * rows.len() - 1).max(1) as f32;
            let own = noise[y * width + x][1];
            let [mut variance, mut mean] = [0.0; 2];
            for row in rows {
                for column in columns.clone().filter(|column| (*column, row) != (x, y)) {
                    let [v, m] = noise[row * width + column];
                    variance += v;
                    mean += m;
                }
            }
            let floor = DARK * ((light - f64::from(own)) / others) as f32;
            let allowed = target * (mean / count).max(floor);
            let factor = if variance > 0.0 { variance / count / (allowed * allowed) } else { 0.0 };
            // The maximum also takes the place of what is not a number.
            wanted.push(if factor <= 1.0 {
                spp
            } else {
                spp * (factor.min(MOST as f32).ceil() as u32).clamp(1, MOST)
            });
        }
    }
    wanted
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Color;
    use crate::sampling::hash;
    use crate::transport::Shaded;

    /// A film whose left half is steady and whose right half flickers.
    fn film(low: f32, high: f32) -> Film {
        let mut film = Film::new([8, 4], [0, 0, 8, 4]).unwrap();
        for (i, pixel) in film.pixels_mut().iter_mut().enumerate() {
            for s in 0..16 {
                let mut shaded = Shaded::default();
                let flicker = if i % 8 < 4 { 0.5 } else { [low, high][s % 2] };
                shaded.radiance.diffuse_direct = Color::splat(flicker);
                pixel.add(&shaded);
            }
        }
        film
    }

    #[test]
    fn samples_go_where_the_noise_is() {
        // Standard deviation 0.5, mean 0.5: a relative error of 26 % after 16 samples.
        let wanted = samples_wanted(&film(0.0, 1.0), 16, 0.04);
        for row in wanted.chunks(8) {
            assert_eq!(row[..3], [16; 3]);
            assert_eq!(row[5..], [64; 3]);
        }
        assert!(samples_wanted(&film(0.0, 1.0), 16, 0.3).iter().all(|&n| n == 16));
        // In between, as many as it takes: (0.0645 / 0.05)² = 1.7 times.
        assert_eq!(samples_wanted(&film(0.375, 0.625), 16, 0.05)[6], 32);
    }

    /// Light that one sample in a hundred finds. A pixel that has a
    /// ninth of the say in its own number of samples loses several percent of it.
    #[test]
    fn pixels_that_found_nothing_and_pixels_that_found_much_are_not_biased() {
        let (films, spp) = (4000, 16);
        let mut numbers = 0_u64;
        let mut sample = || {
            numbers += 1;
            let mut shaded = Shaded::default();
            let found = hash(&[numbers]).is_multiple_of(100);
            shaded.radiance.diffuse_direct = Color::splat(if found { 100.0 } else { 0.0 });
            shaded
        };
        let mut sum = 0.0;
        for _ in 0..films {
            let mut film = Film::new([32, 8], [0, 0, 32, 8]).unwrap();
            for pixel in film.pixels_mut() {
                (0..spp).for_each(|_| pixel.add(&sample()));
            }
            let wanted = samples_wanted(&film, spp, 0.05);
            for (pixel, &wanted) in film.pixels_mut().iter_mut().zip(&wanted) {
                (spp..wanted).for_each(|_| pixel.add(&sample()));
            }
            sum += f64::from(film.mean_luminance());
        }
        let mean = sum / f64::from(films);
        // The deviation is at most 100 √(0.01 / (16 · 256 · 4000)), 0.25 %: a false alarm in 15
        // 000.
        assert!((mean - 1.0).abs() < 0.01, "{mean}");
    }

    #[test]
    fn black_and_broken_pixels_want_nothing() {
        let mut film = Film::new([4, 4], [0, 0, 4, 4]).unwrap();
        assert!(samples_wanted(&film, 4, 0.01).iter().all(|&n| n == 4));
        let mut shaded = Shaded::default();
        shaded.radiance.emission = Color::splat(f32::MAX);
        film.pixels_mut().iter_mut().for_each(|p| p.add(&shaded));
        assert!(samples_wanted(&film, 4, 0.01).iter().all(|&n| (4..=16).contains(&n)));
    }
}
