//! Accessors: typed arrays in buffer views, sparse or not [glTF20, 3.6.2].

use super::budget::Budget;
use super::buffers::Buffers;
use super::document::Document;
use super::fault::{Fault, Parsed};
use gltf::accessor::{DataType, Dimensions};
use gltf::json::accessor as json;
use gltf::json::validation::Checked;
use serde_json::Value;

use DataType::{F32, I8, I16, U8, U16, U32};
use Dimensions::{Mat2, Mat3, Mat4, Scalar, Vec2, Vec3, Vec4};

/// Elements that an accessor without a buffer view may have: they are zeros that no file size pays
/// for.
const MOST_ZEROS: u64 = 1 << 24;

/// Component type and shape of elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub component: DataType,
    pub shape: Dimensions,
}

impl Layout {
    /// Columns and rows.
    fn size(self) -> (usize, usize) {
        match self.shape {
            Mat2 => (2, 2),
            Mat3 => (3, 3),
            Mat4 => (4, 4),
            vector => (1, vector.multiplicity()),
        }
    }

    fn is_matrix(self) -> bool {
        self.size().0 > 1
    }

    /// Bytes from the start of one matrix column to the next: columns begin at multiples of 4,
    /// which the crate does not know.
    fn column(self) -> usize {
        let bytes = self.size().1 * self.component.size();
        if self.is_matrix() { bytes.next_multiple_of(4) } else { bytes }
    }

    /// Bytes from the start of an element to the end of its last component.
    pub fn element(self) -> u64 {
        let (columns, rows) = self.size();
        ((columns - 1) * self.column() + rows * self.component.size()) as u64
    }

    /// Distance of elements that follow each other closely.
    fn packed_stride(self) -> u64 {
        (self.size().0 * self.column()) as u64
    }

    /// Start of component `k` (columns first) in an element.
    fn component_offset(self, k: usize) -> usize {
        let (_, rows) = self.size();
        k / rows * self.column() + k % rows * self.component.size()
    }

    /// What an integer is divided by when it is normalised; `None` where that is not allowed.
    fn normalizer(self) -> Option<f64> {
        match self.component {
            I8 => Some(127.0),
            U8 => Some(255.0),
            I16 => Some(32767.0),
            U16 => Some(65535.0),
            U32 | F32 => None,
        }
    }
}

/// Elements in memory, whose range has been checked.
#[derive(Clone, Copy)]
pub(super) struct Strided<'a> {
    /// The bytes from the first element on.
    bytes: &'a [u8],
    /// Distance of elements.
    stride: usize,
    /// What they are.
    layout: Layout,
}

impl Strided<'_> {
    /// Component `k` of element `i`, exactly as stored.
    #[inline]
    pub fn get(&self, i: usize, k: usize) -> f64 {
        let bytes = &self.bytes[i * self.stride + self.layout.component_offset(k)..];
        match self.layout.component {
            I8 => f64::from(bytes[0] as i8),
            U8 => f64::from(bytes[0]),
            I16 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
            U16 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            U32 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
            F32 => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        }
    }
}

/// The elements of an accessor.
pub(super) struct Elements<'a> {
    /// Those of the buffer view; zero without one.
    pub base: Option<Strided<'a>>,
    /// The places of those that differ, strictly increasing and below the accessor's count.
    pub places: Vec<usize>,
    /// Those that differ.
    values: Option<Strided<'a>>,
}

/// Where elements stand in a buffer view.
#[derive(Clone, Copy)]
struct Place {
    view: usize,
    offset: u64,
    count: u64,
    layout: Layout,
}

/// An accessor as the document describes it.
pub(super) struct Accessor<'a> {
    /// JSON path.
    pub path: String,
    /// Number of elements, at least 1.
    pub count: u64,
    /// What the elements are; `None` for a type that the specification does not know.
    pub layout: Option<Layout>,
    /// Integers stand for fractions.
    pub normalized: bool,
    /// The buffer view; elements are zero without one.
    pub view: Option<usize>,
    /// Declared bounds of each component.
    pub bounds: [Option<Vec<f64>>; 2],
    json: &'a json::Accessor,
}

/// All accessors of a document.
pub(super) struct Accessors<'a> {
    /// The accessors.
    pub list: Vec<Accessor<'a>>,
    buffers: Buffers<'a>,
}

/// What an array may be stored as: shapes, and component types with their need of normalisation
/// (`None`: either).
pub(super) struct Format(&'static [Dimensions], &'static [(DataType, Option<bool>)]);

impl Format {
    const PLAIN: [(DataType, Option<bool>); 1] = [(F32, None)];
    const ANY: [(DataType, Option<bool>); 5] =
        [(F32, None), (I8, None), (U8, None), (I16, None), (U16, None)];
    const SIGNED: [(DataType, Option<bool>); 3] =
        [(F32, None), (I8, Some(true)), (I16, Some(true))];
    const UNSIGNED: [(DataType, Option<bool>); 3] =
        [(F32, None), (U8, Some(true)), (U16, Some(true))];
    const FRACTIONS: [(DataType, Option<bool>); 5] =
        [(F32, None), (I8, Some(true)), (U8, Some(true)), (I16, Some(true)), (U16, Some(true))];
    const INTEGERS: [(DataType, Option<bool>); 3] =
        [(U8, Some(false)), (U16, Some(false)), (U32, Some(false))];

    pub const SCALARS: Self = Self(&[Scalar], &Self::PLAIN);
    pub const VECTORS: Self = Self(&[Vec3], &Self::PLAIN);
    pub const MATRICES: Self = Self(&[Mat4], &Self::PLAIN);
    /// Of instances.
    pub const ROTATIONS: Self = Self(&[Vec4], &Self::SIGNED);
    pub const ANIMATED_ROTATIONS: Self = Self(&[Vec4], &Self::FRACTIONS);
    pub const ANIMATED_WEIGHTS: Self = Self(&[Scalar], &Self::FRACTIONS);
    /// What morph targets add to normals and tangents is stored like positions.
    pub const POSITION: Self = Self(&[Vec3], &Self::ANY);
    pub const NORMAL: Self = Self(&[Vec3], &Self::SIGNED);
    pub const TANGENT: Self = Self(&[Vec4], &Self::SIGNED);
    pub const TEXCOORD: Self = Self(&[Vec2], &Self::ANY);
    pub const COLOR: Self = Self(&[Vec3, Vec4], &Self::UNSIGNED);
    pub const TARGET_COLOR: Self = Self(&[Vec3, Vec4], &Self::FRACTIONS);
    pub const JOINTS: Self = Self(&[Vec4], Self::INTEGERS.split_at(2).0);
    pub const WEIGHTS: Self = Self(&[Vec4], &Self::UNSIGNED);
    pub const INDICES: Self = Self(&[Scalar], &Self::INTEGERS);
}

impl<'a> Accessors<'a> {
    /// Reads the descriptions of all accessors and checks their ranges.
    pub fn parse(document: &'a Document, buffers: Buffers<'a>) -> Parsed<Self> {
        let mut this = Self { list: Vec::new(), buffers };
        for (i, json) in document.root().accessors.iter().enumerate() {
            this.list.push(this.accessor(format!("/accessors/{i}"), json)?);
        }
        Ok(this)
    }

    /// The buffer views.
    pub fn buffers(&self) -> &Buffers<'a> {
        &self.buffers
    }

    fn accessor(&self, path: String, json: &'a json::Accessor) -> Parsed<Accessor<'a>> {
        let fault = |key: &str, what: String| Fault::new(format!("{path}/{key}"), what);
        let layout = match (json.component_type, json.type_) {
            (Checked::Valid(component), Checked::Valid(shape)) => {
                Some(Layout { component: component.0, shape })
            }
            _ => None,
        };
        if json.normalized && layout.is_some_and(|layout| layout.normalizer().is_none()) {
            let what = "only 8-bit and 16-bit integers can be normalized";
            return Err(fault("normalized", what.into()));
        }
        let (view, count) = (json.buffer_view.map(|view| view.value()), json.count.0);
        // Exporters write a harmless 0 beside a sparse part.
        let harmless = |offset: u64| offset == 0 && json.sparse.is_some();
        if view.is_none() && json.byte_offset.is_some_and(|offset| !harmless(offset.0)) {
            return Err(fault("byteOffset", "it means nothing without a bufferView".into()));
        }
        if let (Some(view), Some(layout)) = (view, layout) {
            let offset = json.byte_offset.unwrap_or_default().0;
            self.fits(&path, Place { view, offset, count, layout }, true)?;
        }
        let bounds = |bound: &Option<Value>, key: &str| {
            let Some(bound) = bound.as_ref().and_then(Value::as_array) else { return Ok(None) };
            match layout.map(|layout| layout.shape.multiplicity()) {
                Some(wanted) if wanted != bound.len() => {
                    let what = format!("must have {wanted} elements, and has {}", bound.len());
                    Err(fault(key, what))
                }
                _ => Ok(Some(bound.iter().filter_map(Value::as_f64).collect())),
            }
        };
        let bounds = [bounds(&json.min, "min")?, bounds(&json.max, "max")?];
        if let Some(sparse) = &json.sparse {
            let changed = sparse.count.0;
            if changed > count {
                let what = format!("{changed} elements are replaced, and the accessor has {count}");
                return Err(fault("sparse/count", what));
            }
            for (place, key) in sparse_places(sparse, layout).into_iter().zip(["indices", "values"])
            {
                let Some(place) = place else { continue };
                self.fits(&format!("{path}/sparse/{key}"), place, false)?;
            }
        }
        let normalized = json.normalized;
        Ok(Accessor { path, count, layout, normalized, view, bounds, json })
    }

    /// Checks that the elements lie inside their view and where they may; the JSON path `at` is to
    /// blame.
    fn fits(&self, at: &str, place: Place, strided: bool) -> Parsed<()> {
        let Place { view, offset, count, layout } = place;
        let view = &self.buffers.views[view];
        let length = view.json.byte_length.0;
        let (element, size) = (layout.element(), layout.component.size() as u64);
        let stride = match view.stride() {
            Some(_) if !strided => {
                let what = format!("{} must not have a byteStride for this use", view.path);
                return Err(Fault::new(format!("{at}/bufferView"), what));
            }
            Some(stride) if stride < element => {
                let what = format!(
                    "its elements of {element} bytes exceed the byteStride {stride} of {}",
                    view.path
                );
                return Err(Fault::new(at, what));
            }
            stride => stride.unwrap_or(layout.packed_stride()),
        };
        let end = (count - 1)
            .checked_mul(stride)
            .and_then(|n| n.checked_add(element))
            .and_then(|n| n.checked_add(offset));
        if end.is_none_or(|end| end > length) {
            let what = format!(
                "{count} elements of {element} bytes from {offset} on do not fit the {length} bytes of {}",
                view.path
            );
            return Err(Fault::new(at, what));
        }
        let start = view.json.byte_offset.unwrap_or_default().0 + offset;
        if !offset.is_multiple_of(size) || !start.is_multiple_of(size) {
            let what =
                format!("the data does not begin at a multiple of the component's {size} bytes");
            return Err(Fault::new(format!("{at}/byteOffset"), what));
        }
        if layout.is_matrix() && !offset.is_multiple_of(4) {
            let what = "matrices must begin at a multiple of 4 bytes";
            return Err(Fault::new(format!("{at}/byteOffset"), what));
        }
        Ok(())
    }

    /// The elements of an accessor; an error if their bytes cannot be had.
    pub fn elements(&self, accessor: &Accessor) -> Parsed<Elements<'_>> {
        let layout = accessor.layout()?;
        let base = accessor.view.map(|view| {
            let stride = self.buffers.views[view].stride().unwrap_or(layout.packed_stride());
            let offset = accessor.json.byte_offset.unwrap_or_default().0;
            self.strided(view, offset, stride, layout, &accessor.path)
        });
        let (places, values) = self.overrides(accessor)?.unzip();
        Ok(Elements { base: base.transpose()?, places: places.unwrap_or_default(), values })
    }

    fn strided(
        &self, view: usize, offset: u64, stride: u64, layout: Layout, at: &str,
    ) -> Parsed<Strided<'_>> {
        let bytes = self.buffers.bytes(view).map_err(|why| Fault::new(at, why))?;
        Ok(Strided { bytes: &bytes[offset as usize..], stride: stride as usize, layout })
    }

    /// The sparse elements of an accessor: their places, strictly increasing and below its count,
    /// and their values.
    fn overrides(&self, accessor: &Accessor) -> Parsed<Option<(Vec<usize>, Strided<'_>)>> {
        let Some(sparse) = &accessor.json.sparse else { return Ok(None) };
        let at = ["indices", "values"].map(|key| format!("{}/sparse/{key}", accessor.path));
        let part = |place: Option<Place>, at: &str| {
            let place = place.ok_or_else(|| Fault::new(at, "it has an unknown type"))?;
            let Place { view, offset, layout, .. } = place;
            self.strided(view, offset, layout.packed_stride(), layout, at)
        };
        let [indices, values] = sparse_places(sparse, accessor.layout);
        let (indices, values) = (part(indices, &at[0])?, part(values, &at[1])?);
        let places: Vec<usize> =
            (0..sparse.count.0 as usize).map(|i| indices.get(i, 0) as usize).collect();
        for (i, place) in places.iter().enumerate() {
            if *place as u64 >= accessor.count {
                let what = format!(
                    "element {i} is {place}, and the accessor has {} elements",
                    accessor.count
                );
                return Err(Fault::new(at[0].as_str(), what));
            }
            if i > 0 && places[i - 1] >= *place {
                let what = format!("element {i} does not exceed the one before");
                return Err(Fault::new(at[0].as_str(), what));
            }
        }
        Ok(Some((places, values)))
    }

    /// Checks that accessor `index`, which the property at the JSON path `at` refers to, is stored
    /// in one of the forms of `format`.
    pub fn expect(&self, index: usize, format: &Format, at: &str) -> Parsed<&Accessor<'a>> {
        let accessor = &self.list[index];
        let Layout { component, shape } = accessor.layout()?;
        let suits = |(c, n): &(DataType, Option<bool>)| {
            *c == component && n.is_none_or(|n| n == accessor.normalized)
        };
        if format.0.contains(&shape) && format.1.iter().any(suits) {
            return Ok(accessor);
        }
        let normalized = if accessor.normalized { "normalized " } else { "" };
        let form = format!("{normalized}{component:?} of {shape:?}");
        Err(Fault::new(at, format!("{} cannot serve here as an array of {form}", accessor.path)))
    }

    /// The elements of an accessor, or those at the places `pick`, as `N` single-precision numbers
    /// each; missing components are `fill`. The accessor's form has been checked, and the
    /// places are below its count.
    pub fn read<const N: usize, T: From<[f32; N]> + Clone>(
        &self, accessor: &Accessor, pick: Option<&[u32]>, fill: f32, budget: &mut Budget,
    ) -> Parsed<Vec<T>> {
        let layout = accessor.layout()?;
        let components = layout.shape.multiplicity().min(N);
        let scale = layout.normalizer().filter(|_| accessor.normalized);
        let mut zero = [fill; N];
        zero[..components].fill(0.0);
        self.values(accessor, pick, budget, zero.into(), |source, i| {
            let mut out = [fill; N];
            for (k, x) in out[..components].iter_mut().enumerate() {
                let raw = source.get(i, k);
                *x = scale.map_or(raw, |s| (raw / s).max(-1.0)) as f32;
            }
            out.into()
        })
    }

    /// The elements of an accessor of unsigned integers, of which the first component is taken.
    pub fn read_indices(&self, accessor: &Accessor, budget: &mut Budget) -> Parsed<Vec<u32>> {
        self.values(accessor, None, budget, 0, |source, i| source.get(i, 0) as u32)
    }

    /// The elements of an accessor, or those at the places `pick`, as `element` reads them.
    fn values<T: Clone>(
        &self, accessor: &Accessor, pick: Option<&[u32]>, budget: &mut Budget, zero: T,
        element: impl Fn(&Strided, usize) -> T,
    ) -> Parsed<Vec<T>> {
        let count = pick.map_or(accessor.count, |p| p.len() as u64);
        budget.spend(count, size_of::<T>() as u64, &accessor.path)?;
        budget.spend(accessor.replaced(), size_of::<usize>() as u64, &accessor.path)?;
        if accessor.view.is_none() && accessor.count > MOST_ZEROS {
            let what = format!(
                "{} elements without a buffer view, more than any sensible file has",
                accessor.count
            );
            return Err(Fault::new(accessor.path.as_str(), what));
        }
        let elements = self.elements(accessor)?;
        let value = |place: usize| {
            elements.get(place).map_or_else(|| zero.clone(), |(source, i)| element(source, i))
        };
        Ok(match pick {
            Some(pick) => pick.iter().map(|place| value(*place as usize)).collect(),
            None => (0..count as usize).map(value).collect(),
        })
    }
}

impl Elements<'_> {
    /// Where the element at a place below the accessor's count is; `None` if it is zero.
    pub fn get(&self, place: usize) -> Option<(&Strided<'_>, usize)> {
        match self.places.binary_search(&place) {
            Ok(i) => Some((self.values.as_ref()?, i)),
            Err(_) => Some((self.base.as_ref()?, place)),
        }
    }
}

impl Accessor<'_> {
    /// Number of sparse elements.
    pub fn replaced(&self) -> u64 {
        self.json.sparse.as_ref().map_or(0, |sparse| sparse.count.0)
    }

    fn layout(&self) -> Parsed<Layout> {
        let what = "it has a type that glTF does not know";
        self.layout.ok_or_else(|| Fault::new(self.path.as_str(), what))
    }
}

/// The indices and the values of a sparse accessor; `None` for values of unknown type.
fn sparse_places(sparse: &json::sparse::Sparse, layout: Option<Layout>) -> [Option<Place>; 2] {
    let json::sparse::Sparse { count, indices, values, .. } = sparse;
    let place = |view: usize, offset: u64, layout: Option<Layout>| {
        layout.map(|layout| Place { view, offset, count: count.0, layout })
    };
    let integer = match indices.component_type {
        Checked::Valid(component) => Some(Layout { component: component.0, shape: Scalar }),
        Checked::Invalid => None,
    };
    [
        place(indices.buffer_view.value(), indices.byte_offset.0, integer),
        place(values.buffer_view.value(), values.byte_offset.0, layout),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrix_columns_are_padded() {
        for (component, shape, stride, element) in [
            (I8, Mat2, 8, 6),
            (U8, Mat3, 12, 11),
            (I16, Mat3, 24, 22),
            (U16, Mat4, 32, 32),
            (F32, Mat4, 64, 64),
            (U8, Vec3, 3, 3),
        ] {
            let layout = Layout { component, shape };
            assert_eq!((layout.packed_stride(), layout.element()), (stride, element), "{layout:?}");
        }
        let bytes: Vec<u8> = (0..12).collect();
        let layout = Layout { component: U8, shape: Mat3 };
        let matrix = Strided { bytes: &bytes, stride: 12, layout };
        let values: Vec<f64> = (0..9).map(|k| matrix.get(0, k)).collect();
        assert_eq!(values, [0.0, 1.0, 2.0, 4.0, 5.0, 6.0, 8.0, 9.0, 10.0]);
    }

    #[test]
    fn components_are_read_exactly() {
        let read = |component, bytes: &[u8]| {
            let layout = Layout { component, shape: Scalar };
            Strided { bytes, stride: bytes.len(), layout }.get(0, 0)
        };
        assert_eq!(read(I8, &[0x80]), -128.0);
        assert_eq!(read(I16, &[0, 0x80]), -32768.0);
        assert_eq!(read(U32, &[0xFF; 4]), 4_294_967_295.0);
        assert_eq!(read(F32, &1.1f32.to_le_bytes()), f64::from(1.1f32));
    }
}
