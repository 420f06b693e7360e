//! The fields of a record as columns of bytes: the one place where records become bytes and come
//! back.

use crate::cache::payload::{Axes, Change, Curve, Direct, Irradiance, Lit, Quadratic};
use crate::cache::record::{Area, Fences, Record, SECTORS};
use crate::gather::Hessian;
use crate::math::{Color, Mat3, Vec3, Vec4};
use std::ops::RangeInclusive;
use std::sync::Arc;

/// A value of fixed size in a file, little-endian.
trait Column: Sized {
    /// Bytes of one value.
    const BYTES: usize;
    /// Zeros stand for nothing: a file whose records all have nothing leaves the column out.
    const OPTIONAL: bool = false;
    fn put(&self, out: &mut Vec<u8>);
    /// `None` for what no sound record holds.
    fn get(bytes: &[u8]) -> Option<Self>;
}

/// Lengths and errors: not negative, may be infinite.
impl Column for f32 {
    const BYTES: usize = 4;

    fn put(&self, out: &mut Vec<u8>) {
        out.extend(self.to_le_bytes());
    }

    fn get(bytes: &[u8]) -> Option<Self> {
        number(bytes).filter(|x| *x >= 0.0)
    }
}

fn number(bytes: &[u8]) -> Option<f32> {
    Some(f32::from_le_bytes(bytes.try_into().ok()?))
}

/// `N` finite numbers.
fn finite<const N: usize>(bytes: &[u8]) -> Option<[f32; N]> {
    let mut out = [0.0; N];
    for (x, bytes) in out.iter_mut().zip(bytes.chunks_exact(4)) {
        *x = number(bytes).filter(|x| x.is_finite())?;
    }
    Some(out)
}

impl Column for Vec3 {
    const BYTES: usize = 12;

    fn put(&self, out: &mut Vec<u8>) {
        self.to_array().iter().for_each(|x| out.extend(x.to_le_bytes()));
    }

    fn get(bytes: &[u8]) -> Option<Self> {
        finite(bytes).map(Self::from_array)
    }
}

impl Column for Mat3 {
    const BYTES: usize = 36;

    fn put(&self, out: &mut Vec<u8>) {
        self.to_cols_array().iter().for_each(|x| out.extend(x.to_le_bytes()));
    }

    fn get(bytes: &[u8]) -> Option<Self> {
        finite(bytes).map(|a| Self::from_cols_array(&a))
    }
}

/// The number of planes, then room for the most there can be.
impl Column for Fences {
    const BYTES: usize = 4 + 16 * Self::MOST;

    fn put(&self, out: &mut Vec<u8>) {
        let end = out.len() + Self::BYTES;
        out.extend((self.planes().len() as u32).to_le_bytes());
        self.planes().iter().flat_map(Vec4::to_array).for_each(|x| out.extend(x.to_le_bytes()));
        out.resize(end, 0);
    }

    fn get(bytes: &[u8]) -> Option<Self> {
        let (count, planes) = bytes.split_at_checked(4)?;
        let count = u32::from_le_bytes(count.try_into().ok()?) as usize;
        let planes: Option<Vec<Vec4>> =
            planes.chunks_exact(16).take(count).map(|p| finite(p).map(Vec4::from_array)).collect();
        planes.filter(|p| p.len() == count).and_then(|p| Self::from_planes(&p))
    }
}

/// The number of radii, the axis, then room for the most radii there can be.
impl Column for Area {
    const BYTES: usize = 4 + 12 + 4 * SECTORS;

    fn put(&self, out: &mut Vec<u8>) {
        let end = out.len() + Self::BYTES;
        out.extend((self.radii().len() as u32).to_le_bytes());
        match self {
            Self::Disc { .. } => Vec3::ZERO,
            Self::Ellipse { axis, .. } | Self::Sectors { axis, .. } => *axis,
        }
        .put(out);
        self.radii().iter().for_each(|r| r.put(out));
        out.resize(end, 0);
    }

    fn get(bytes: &[u8]) -> Option<Self> {
        let (count, bytes) = bytes.split_at_checked(4)?;
        let (axis, radii) = bytes.split_at_checked(12)?;
        let axis = Vec3::get(axis)?;
        let radii: Option<Vec<f32>> = radii.chunks_exact(4).map(f32::get).collect();
        let unit = (axis.length() - 1.0).abs() < 1e-3;
        match (u32::from_le_bytes(count.try_into().ok()?), radii?.as_slice(), unit) {
            (1, &[r, ..], _) => Some(Self::Disc { r }),
            (2, &[a, b, ..], true) => Some(Self::Ellipse { axis, r: [a, b] }),
            (8, radii, true) => Some(Self::Sectors { axis, r: radii.try_into().ok()? }),
            _ => None,
        }
    }
}

/// Two tangents and the Hessian; all zero for none.
impl Column for Option<Curve> {
    const BYTES: usize = 24 + 36;
    const OPTIONAL: bool = true;

    fn put(&self, out: &mut Vec<u8>) {
        let (tangents, hessian) =
            self.map_or(([Vec3::ZERO; 2], Hessian::default()), |c| (c.tangents, c.hessian));
        tangents.iter().chain(&[hessian.ss, hessian.st, hessian.tt]).for_each(|v| v.put(out));
    }

    fn get(bytes: &[u8]) -> Option<Self> {
        let parts: Option<Vec<Vec3>> = bytes.chunks_exact(12).map(Vec3::get).collect();
        let &[s, t, ss, st, tt] = parts?.as_slice() else { return None };
        Some(
            (s != Vec3::ZERO)
                .then_some(Curve { tangents: [s, t], hessian: Hessian { ss, st, tt } }),
        )
    }
}

/// First and second order along each axis, for places, then for normals.
impl Column for Change {
    const BYTES: usize = 2 * SECTORS * 24;

    fn put(&self, out: &mut Vec<u8>) {
        self.travel
            .iter()
            .chain(&self.turn)
            .flat_map(|q| [q.linear, q.square])
            .for_each(|v| v.put(out));
    }

    fn get(bytes: &[u8]) -> Option<Self> {
        let mut change = Self::default();
        for (q, bytes) in
            change.travel.iter_mut().chain(&mut change.turn).zip(bytes.chunks_exact(24))
        {
            *q = Quadratic { linear: Vec3::get(&bytes[..12])?, square: Vec3::get(&bytes[12..])? };
        }
        Some(change)
    }
}

/// The axis, the lengths, indirect light, whether there is direct light, its irradiance and its
/// change; all zero for none.
impl Column for Option<Arc<Axes>> {
    const BYTES: usize = 12 + 4 * SECTORS + Change::BYTES + 4 + 12 + Change::BYTES;
    const OPTIONAL: bool = true;

    fn put(&self, out: &mut Vec<u8>) {
        let end = out.len() + Self::BYTES;
        if let Some(axes) = self {
            axes.axis.put(out);
            axes.lengths.iter().for_each(|r| r.put(out));
            axes.indirect.put(out);
            if let Some(direct) = &axes.direct {
                1.0_f32.put(out);
                direct.irradiance.put(out);
                direct.change.put(out);
            }
        }
        out.resize(end, 0);
    }

    fn get(bytes: &[u8]) -> Option<Self> {
        let (axis, bytes) = bytes.split_at_checked(12)?;
        let (lengths, bytes) = bytes.split_at_checked(4 * SECTORS)?;
        let (indirect, bytes) = bytes.split_at_checked(Change::BYTES)?;
        let (lit, bytes) = bytes.split_at_checked(4)?;
        let (irradiance, change) = bytes.split_at_checked(12)?;
        let axis = Vec3::get(axis)?;
        if axis == Vec3::ZERO {
            return Some(None);
        }
        let mut of = [0.0; SECTORS];
        for (length, bytes) in of.iter_mut().zip(lengths.chunks_exact(4)) {
            *length = f32::get(bytes).filter(|x| *x > 0.0 && x.is_finite())?;
        }
        let direct = match f32::get(lit)? > 0.0 {
            true => {
                Some(Direct { irradiance: Color::get(irradiance)?, change: Change::get(change)? })
            }
            false => None,
        };
        let unit = (axis.length() - 1.0).abs() < 1e-3;
        unit.then_some(Some(Arc::new(Axes {
            axis,
            lengths: of,
            indirect: Change::get(indirect)?,
            direct,
        })))
    }
}

/// 0 for none, 1, or 2 where it is sharp; then the irradiance.
impl Column for Option<Lit> {
    const BYTES: usize = 16;
    const OPTIONAL: bool = true;

    fn put(&self, out: &mut Vec<u8>) {
        let Lit { irradiance, sharp } = self.unwrap_or_default();
        (if sharp { 2.0_f32 } else { f32::from(u8::from(self.is_some())) }).put(out);
        irradiance.put(out);
    }

    fn get(bytes: &[u8]) -> Option<Self> {
        let (mark, irradiance) = bytes.split_at_checked(4)?;
        let (mark, irradiance) = (f32::get(mark)?, Color::get(irradiance)?);
        Some((mark > 0.0).then_some(Lit { irradiance, sharp: mark > 1.0 }))
    }
}

/// What a column is called and holds.
pub struct Heading {
    /// The field of the record.
    pub name: &'static str,
    /// Bytes of one value.
    pub bytes: usize,
    /// A column of zeros may be left out.
    pub optional: bool,
    /// What its values can be, in words.
    pub range: &'static str,
}

/// The largest coordinate, irradiance and size: the square is still a number.
const LARGEST: f32 = 1e18;
fn bright(e: Color) -> bool {
    e.min_element() >= 0.0 && e.max_element() <= LARGEST
}

/// What radii can be relative to.
pub const EXTENTS: RangeInclusive<f32> = f32::MIN_POSITIVE..=LARGEST;

/// Makes the table from the lists of fields with their ranges, in words and as a test: those of the
/// record, those of its payload. A new field of [`Record`] or [`Irradiance`] does not compile until
/// it is in a list, or is named as one that others determine.
macro_rules! columns {
    (
        record { $($field:ident: $range:literal, $sound:expr;)* }
        payload { $($held:ident: $held_range:literal, $held_sound:expr;)* }
    ) => {
        /// The columns.
        pub fn table() -> Vec<Heading> {
            fn heading<T: Column>(
                name: &'static str, range: &'static str, _: impl Fn(&Record<Irradiance>) -> &T,
            ) -> Heading {
                Heading { name, bytes: T::BYTES, optional: T::OPTIONAL, range }
            }
            vec![
                $(heading(stringify!($field), $range, |r| &r.$field),)*
                $(heading(stringify!($held), $held_range, |r| &r.payload.$held),)*
            ]
        }

        /// Appends the values of `record` to `columns`, which are in the order of [`table`].
        pub fn put(record: &Record<Irradiance>, columns: &mut [Vec<u8>]) {
            // `limit` and `length` follow from the unclamped lengths of all records.
            let Record { $($field,)* payload, limit: _, length: _ } = record;
            let Irradiance { $($held),* } = payload;
            let mut columns = columns.iter_mut();
            $(if let Some(column) = columns.next() {
                $field.put(column);
            })*
            $(if let Some(column) = columns.next() {
                $held.put(column);
            })*
        }

        /// The record whose value in column `k` of [`table`] is `value(k)`.
        ///
        /// # Errors
        /// The number of the first column whose value is none that a record can have.
        pub fn get<'a>(
            value: impl Fn(usize) -> &'a [u8],
        ) -> std::result::Result<Record<Irradiance>, usize> {
            fn one<'a, T: Column>(
                column: &mut usize, value: &impl Fn(usize) -> &'a [u8], sound: impl Fn(&T) -> bool,
            ) -> std::result::Result<T, usize> {
                let found = T::get(value(*column)).filter(sound).ok_or(*column);
                *column += 1;
                found
            }
            let mut k = 0;
            $(let $field = one(&mut k, &value, $sound)?;)*
            $(let $held = one(&mut k, &value, $held_sound)?;)*
            let payload = Irradiance { $($held),* };
            let record = Record { $($field,)* payload, limit: f32::INFINITY, length: 0.0 };
            Ok(Record { length: record.length_unclamped, ..record })
        }
    };
}

columns!(
    record {
        position: "coordinates from -1e18 to 1e18", |p: &Vec3| p.abs().max_element() <= LARGEST;
        normal: "of length 1", |n: &Vec3| (n.length() - 1.0).abs() < 1e-3;
        shape: "1, 2 or 8 lengths, 0 to infinity, and an axis of length 1", |_: &Area| true;
        length_unclamped: "0 to infinity", |_: &f32| true;
        error: "above 0, finite, up to the error of the scheme", |e: &f32| e.is_normal();
        footprint: "above 0, up to 1e18", |f: &f32| f.is_normal() && *f <= LARGEST;
        sigma: "0 to infinity", |_: &f32| true;
        fences: "up to 4 planes of finite numbers", |_: &Fences| true;
    }
    payload {
        irradiance: "0 to 1e18", |e: &Color| bright(*e);
        rotation: "finite numbers", |_: &Mat3| true;
        translation: "finite numbers", |_: &Mat3| true;
        curve: "finite numbers", |_: &Option<Curve>| true;
        axes: "finite numbers, lengths above 0", |_: &Option<Arc<Axes>>| true;
        lit: "0, or 1 or 2 and 0 to 1e18", |l: &Option<Lit>| l.is_none_or(|l| bright(l.irradiance));
    }
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_guide_has_every_column_with_its_range() {
        let guide = include_str!("../../../docs/guide/cache-files.md");
        for Heading { name, bytes, range, .. } in table() {
            let row = format!("| `{name}` | {bytes} | {range} |");
            assert!(guide.contains(&row), "docs/guide/cache-files.md lacks: {row}");
        }
    }
}
