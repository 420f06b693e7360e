//! A picture checked and converted for the file.

use crate::imagefile::picture::{Attribute, Channel, Crop, Picture, SampleKind};
use half::f16;
use rayon::prelude::*;
use std::collections::HashSet;

/// Samples in the precision of the file.
pub(super) enum Packed<'a> {
    Half(Vec<f16>),
    Float(&'a [f32]),
    Uint(Vec<u32>),
}

/// A checked picture with its samples converted and its channels sorted by name, as the file wants
/// them.
pub(super) struct Prepared<'a> {
    pub size: [usize; 2],
    pub crop: Crop,
    pub channels: Vec<(&'a str, Packed<'a>)>,
    pub attributes: &'a [(String, Attribute)],
    pub long_names: bool,
}

/// The longest name that every reader of the format accepts.
const SHORT_NAME: usize = 31;
/// The longest name that the format allows.
const LONG_NAME: usize = 255;
/// Coordinates beyond this are not portable between readers.
const MAX_COORDINATE: i64 = (1 << 30) - 1;

/// Attributes that describe the layout of a file and are the writer's business.
const RESERVED: [&str; 13] = [
    "channels",
    "chunkCount",
    "compression",
    "dataWindow",
    "displayWindow",
    "lineOrder",
    "maxSamplesPerPixel",
    "name",
    "pixelAspectRatio",
    "screenWindowCenter",
    "screenWindowWidth",
    "tiles",
    "type",
];

fn check_names<'a>(what: &str, names: impl Iterator<Item = &'a str>) -> Result<bool, String> {
    let (mut seen, mut long) = (HashSet::new(), false);
    for name in names {
        let shown = name.escape_debug();
        if name.is_empty() || name.len() > LONG_NAME || name.contains('\0') {
            return Err(format!(
                "{what} name '{shown}': must be 1 to {LONG_NAME} bytes without NUL"
            ));
        }
        if !seen.insert(name) {
            return Err(format!("two {what}s are called '{shown}'"));
        }
        long |= name.len() > SHORT_NAME;
    }
    Ok(long)
}

impl<'a> Prepared<'a> {
    /// # Errors
    /// What keeps `picture` from being written.
    pub fn new(picture: &'a Picture) -> Result<Self, String> {
        let Picture { width, height, .. } = *picture;
        let crop = picture.crop.unwrap_or(Crop { origin: [0, 0], whole: [width, height] });
        for (origin, extent, whole) in
            [(crop.origin[0], width, crop.whole[0]), (crop.origin[1], height, crop.whole[1])]
        {
            let end = i64::from(origin) + i64::from(extent);
            if extent == 0
                || whole == 0
                || i64::from(origin) < -MAX_COORDINATE
                || end.max(i64::from(whole)) > MAX_COORDINATE
            {
                return Err(format!(
                    "cannot write {width} x {height} pixels at {:?} of {:?}",
                    crop.origin, crop.whole
                ));
            }
        }
        if picture.channels.is_empty() {
            return Err("a picture without channels cannot be written".to_owned());
        }
        let long_channels =
            check_names("channel", picture.channels.iter().map(|c| c.name.as_str()))?;
        let long_attributes =
            check_names("attribute", picture.attributes.iter().map(|(n, _)| n.as_str()))?;
        for (name, value) in &picture.attributes {
            if RESERVED.contains(&name.as_str()) {
                return Err(format!("the attribute '{name}' is set by the writer"));
            }
            if matches!(value, Attribute::Text(t) if t.contains('\0')) {
                return Err(format!("the attribute '{name}' contains a NUL character"));
            }
        }
        let size = [width as usize, height as usize];
        let clipped = clipped_layers(picture);
        let mut channels = picture
            .channels
            .par_iter()
            .map(|c| Ok((c.name.as_str(), pack(c, size, clipped.contains(layer_of(&c.name)))?)))
            .collect::<Result<Vec<_>, String>>()?;
        channels.sort_by(|a, b| a.0.as_bytes().cmp(b.0.as_bytes()));
        Ok(Self {
            size,
            crop,
            channels,
            attributes: &picture.attributes,
            long_names: long_channels || long_attributes,
        })
    }
}

/// The largest finite half.
const HALF_MAX: f32 = 65504.0;

/// The layer of a channel: its name up to the last dot.
fn layer_of(name: &str) -> &str {
    name.rsplit_once('.').map_or("", |(layer, _)| layer)
}

/// The layers that halves would clip.
fn clipped_layers(picture: &Picture) -> HashSet<&str> {
    let clips = |x: &f32| x.is_finite() && x.abs() > HALF_MAX;
    let halves = picture.channels.par_iter().filter(|c| c.kind == SampleKind::Half);
    halves.filter(|c| c.samples.iter().any(clips)).map(|c| layer_of(&c.name)).collect()
}

/// Every whole number up to this one is a `f32`.
const EXACT_UINT: f32 = (1 << 24) as f32;

/// The samples for the file; `wide` makes halves 32-bit floats.
fn pack(channel: &Channel, [width, height]: [usize; 2], wide: bool) -> Result<Packed<'_>, String> {
    let Channel { name, kind, samples } = channel;
    if samples.len() != width * height {
        return Err(format!(
            "channel '{name}': {} samples for {width} x {height} pixels",
            samples.len()
        ));
    }
    Ok(match kind {
        SampleKind::Half if !wide => {
            Packed::Half(samples.iter().map(|&x| f16::from_f32(x)).collect())
        }
        SampleKind::Half => Packed::Float(samples),
        SampleKind::Float => Packed::Float(samples),
        SampleKind::Uint => {
            if let Some(bad) =
                samples.iter().find(|x| !(0.0..=EXACT_UINT).contains(*x) || x.fract() != 0.0)
            {
                return Err(format!(
                    "channel '{name}': {bad} is not a whole number from 0 to 2^24"
                ));
            }
            Packed::Uint(samples.iter().map(|&x| x as u32).collect())
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_rounded_to_nearest_even_and_layers_that_they_would_clip_are_floats() {
        // 2049 lies between the halves 2048 and 2050, 2051 between 2050 and 2052: both ties go to
        // the even mantissa. What is not finite clips nothing.
        let mut picture = Picture::new([4, 1]);
        let exact = [2049.0, 2051.0, 65504.0, -0.0];
        picture.add("R", SampleKind::Half, exact.to_vec());
        picture.add("G", SampleKind::Half, vec![f32::INFINITY, f32::NAN, 5.96e-8, 1.4e-8]);
        picture.add("emission.R", SampleKind::Half, exact.to_vec());
        picture.add("emission.G", SampleKind::Half, vec![-65504.1, 1e30, 0.0, 0.0]);
        let prepared = Prepared::new(&picture).unwrap();
        let of = |name: &str| &prepared.channels.iter().find(|(n, _)| *n == name).unwrap().1;
        let Packed::Half(r) = of("R") else { panic!("R is not half") };
        assert_eq!(
            r.iter().map(|x| x.to_f32()).collect::<Vec<_>>(),
            [2048.0, 2052.0, 65504.0, 0.0]
        );
        assert!(r[3].is_sign_negative());
        let Packed::Half(g) = of("G") else { panic!("G is not half") };
        assert!(g[0] == f16::INFINITY && g[1].is_nan());
        assert_eq!([g[2], g[3]].map(f16::to_f32), [2.0_f32.powi(-24), 0.0]);
        for (name, samples) in [("emission.R", exact), ("emission.G", [-65504.1, 1e30, 0.0, 0.0])] {
            let Packed::Float(packed) = of(name) else { panic!("{name} is not float") };
            assert_eq!(*packed, samples);
        }
    }

    #[test]
    fn what_cannot_be_written_is_refused_by_name() {
        let channel = |name: &str, kind, samples: &[f32]| Channel {
            name: name.to_owned(),
            kind,
            samples: samples.to_vec(),
        };
        let good = Picture {
            width: 2,
            height: 1,
            channels: vec![channel("R", SampleKind::Half, &[0.0, 1.0])],
            ..Picture::default()
        };
        assert!(Prepared::new(&good).is_ok());
        let refused = |change: &dyn Fn(&mut Picture)| {
            let mut bad = good.clone();
            change(&mut bad);
            Prepared::new(&bad).err().expect("refused")
        };
        assert!(refused(&|p| p.channels.clear()).contains("without channels"));
        assert!(refused(&|p| p.width = 0).contains("0 x 1"));
        assert!(refused(&|p| p.width = 3).contains("'R': 2 samples for 3 x 1"));
        assert!(refused(&|p| p.channels.push(p.channels[0].clone())).contains("called 'R'"));
        assert!(refused(&|p| p.channels[0].name = "a\0".to_owned()).contains("NUL"));
        assert!(
            refused(&|p| p.channels[0] = channel("id", SampleKind::Uint, &[0.5, 1.0]))
                .contains("0.5 is not a whole number")
        );
        assert!(
            refused(&|p| p.channels[0] = channel("id", SampleKind::Uint, &[f32::NAN, 1.0]))
                .contains("NaN")
        );
        assert!(
            refused(&|p| p.attributes.push(("dataWindow".to_owned(), Attribute::Int(1))))
                .contains("dataWindow")
        );
        assert!(
            refused(&|p| p.attributes.push(("a".to_owned(), Attribute::Text("\0".to_owned()))))
                .contains("NUL")
        );
        assert!(
            refused(&|p| p.crop = Some(Crop { origin: [i32::MAX, 0], whole: [4, 4] }))
                .contains("2147483647")
        );
    }
}
