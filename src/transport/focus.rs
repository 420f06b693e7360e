//! Where light paths from infinity are wanted.

use super::CameraSample;
use super::path::PathTracer;
use crate::camera::Camera;
use crate::geometry::extent;
use crate::light::Focus;
use crate::math::Vec3;
use crate::sampling::{hash, stream};

/// Radius of the focus as a share of the extent of what is lit, which for a closed room is about
/// its diagonal.
const RADIUS: f32 = 0.6;
/// Columns and rows of the camera rays that find what is lit.
const SIDE: u32 = 24;

/// What points show.
#[derive(Clone, Copy)]
pub(super) struct Seen {
    /// Its [`extent`].
    pub extent: f32,
    /// The ball around it.
    pub focus: Focus,
}

/// What `n` points show, point i being `at(i)`. Few points far away, such as those on the ground to
/// the horizon, do not count. `None` where the points coincide.
pub(super) fn seen(n: usize, at: impl Fn(usize) -> Vec3) -> Option<Seen> {
    let extent = extent(n, &at)?;
    let middle = |axis: usize| {
        let mut places: Vec<f32> = (0..n).map(|i| at(i)[axis]).collect();
        *places.select_nth_unstable_by(n / 2, f32::total_cmp).1
    };
    let center = Vec3::from_array([0, 1, 2].map(middle));
    Some(Seen { extent, focus: Focus { center, radius: RADIUS * extent } })
}

impl PathTracer<'_> {
    /// The focus of what the pixels of `window` (x0, y0, x1, y1, ends excluded) of an image of
    /// `size` pixels show, and of what lights that.
    pub(super) fn focus_of(
        &self, camera: &Camera, size: [u32; 2], [x0, y0, x1, y1]: [u32; 4],
    ) -> Option<Focus> {
        let place = |k: u32, first: u32, end: u32| {
            first + (u64::from(end - first) * u64::from(k) / u64::from(SIDE)) as u32
        };
        let first: Vec<_> = (0..SIDE * SIDE)
            .filter_map(|k| {
                let pixel = [place(k % SIDE, x0, x1), place(k / SIDE, y0, y1)];
                let seed = hash(&[stream::FOCUS, u64::from(k)]);
                let sample = CameraSample::new(camera, pixel, size, seed, 0, u32::MAX);
                Some(self.first_diffuse(&sample.camera, seed)?.0)
            })
            .collect();
        let around = self.next_points(&first, first.len(), stream::FOCUS, None);
        let points = first.iter().chain(around.iter().map(|(point, _)| point));
        let places: Vec<Vec3> = points.map(|point| point.position).collect();
        seen(places.len(), |i| places[i]).map(|seen| seen.focus)
    }
}
