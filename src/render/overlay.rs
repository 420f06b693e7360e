//! Records drawn over the image: a dot where each lies, the outline of its area, coloured by level.

use super::settings::Settings;
use crate::cache::{Cache, RadiusRule, Record};
use crate::film::Film;
use crate::math::{Color, Vec2, Vec3};
use glam::Mat4;

/// What [`draw`] makes.
pub struct Drawn {
    /// The beauty with the records over it.
    pub overlay: Vec<Color>,
    /// 0 where nothing is drawn, else the level of the record plus 1.
    pub level: Vec<f32>,
}

/// Colours of the levels: yellow, cyan, magenta, then green for all deeper ones.
const COLORS: [Color; 4] = [
    Color::new(1.0, 0.8, 0.0),
    Color::new(0.0, 0.9, 1.0),
    Color::new(1.0, 0.1, 0.8),
    Color::new(0.2, 1.0, 0.2),
];
/// Areas narrower than this many pixels are not outlined: they would cover the image.
const OUTLINED: f32 = 6.0;
/// Points of an outline.
const OUTLINE: usize = 48;

/// Draws the records of all levels of `cache` that the camera sees. Records that are hidden behind
/// what the camera sees are left out.
pub fn draw(film: &Film, cache: &Cache, settings: &Settings) -> Drawn {
    let mut canvas = Canvas {
        film,
        to_clip: settings.camera.world_to_ndc(settings.size),
        eye: settings.camera.to_world.translation.into(),
        depth: film.depth(),
        drawn: Drawn { overlay: film.radiance(), level: vec![0.0; film.pixels().len()] },
        brightness: 4.0 * film.mean_luminance().max(f32::MIN_POSITIVE),
    };
    for level in (0..cache.level_count()).rev() {
        canvas.records(level, &cache.radius_rule(level), cache.records(level));
    }
    for level in 0..cache.radiance_level_count() {
        if let Some(rule) = cache.radiance_radius_rule(level) {
            canvas.records(level, &rule, cache.radiance_records(level));
        }
    }
    canvas.drawn
}

struct Canvas<'a> {
    film: &'a Film,
    to_clip: Mat4,
    eye: Vec3,
    depth: Vec<f32>,
    drawn: Drawn,
    brightness: f32,
}

impl Canvas<'_> {
    fn records<P>(&mut self, level: u8, rule: &RadiusRule, records: &[Record<P>]) {
        for record in records {
            let (area, _) = rule.area(record);
            let share = rule.share(record);
            let area = area.map(|r| share * r);
            self.dot(record.position, level);
            if area.longest() >= OUTLINED * record.footprint {
                for p in area.outline(record.position, record.normal, OUTLINE) {
                    self.point(p, level, 0.5);
                }
            }
        }
    }

    /// The pixel of the window in which `p` is seen, if it is.
    fn pixel(&self, p: Vec3) -> Option<[i64; 2]> {
        let clip = self.to_clip * p.extend(1.0);
        if clip.w <= 0.0 {
            return None;
        }
        let ndc = Vec2::new(clip.x, clip.y) / clip.w;
        let [w, h] = self.film.size.map(|s| s as f32);
        let raster = Vec2::new(0.5 * (ndc.x + 1.0) * w, 0.5 * (1.0 - ndc.y) * h);
        Some([
            raster.x.floor() as i64 - i64::from(self.film.window[0]),
            raster.y.floor() as i64 - i64::from(self.film.window[1]),
        ])
    }

    fn dot(&mut self, p: Vec3, level: u8) {
        if let Some([x, y]) = self.pixel(p) {
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                self.paint([x + dx, y + dy], p, level, 1.0);
            }
        }
    }

    fn point(&mut self, p: Vec3, level: u8, alpha: f32) {
        if let Some(pixel) = self.pixel(p) {
            self.paint(pixel, p, level, alpha);
        }
    }

    fn paint(&mut self, [x, y]: [i64; 2], p: Vec3, level: u8, alpha: f32) {
        let [width, height] = self.film.window_size().map(i64::from);
        if !(0..width).contains(&x) || !(0..height).contains(&y) {
            return;
        }
        let k = (y * width + x) as usize;
        if (p - self.eye).length() > 1.02 * self.depth[k] {
            return;
        }
        let color = self.brightness * COLORS[usize::from(level).min(COLORS.len() - 1)];
        self.drawn.overlay[k] = self.drawn.overlay[k].lerp(color, alpha);
        self.drawn.level[k] = f32::from(level) + 1.0;
    }
}
