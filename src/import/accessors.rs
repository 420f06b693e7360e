//! Accessors: typed arrays in buffer views, sparse or not.

use super::budget::Budget;
use super::buffers::Buffers;
use super::json::{Fault, Json, Parsed};
use super::layout::{Component, Layout, Shape, Strided};

/// Elements that an accessor without a buffer view may have: they are zeros that no file size pays
/// for.
const MOST_ZEROS: u64 = 1 << 24;

/// Part of a sparse accessor: `count` elements from `offset` of a view on.
#[derive(Clone, Debug)]
struct SparsePart {
    path: String,
    view: usize,
    offset: u64,
    layout: Option<Layout>,
}

/// The elements of an accessor that differ from its buffer view.
#[derive(Clone, Debug)]
struct Sparse {
    count: u64,
    indices: SparsePart,
    values: SparsePart,
}

/// An accessor as the document describes it.
#[derive(Clone, Debug)]
pub(super) struct Accessor {
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
    offset: u64,
    sparse: Option<Sparse>,
}

/// All accessors of a document.
pub(super) struct Accessors<'a> {
    /// The accessors.
    pub list: Vec<Accessor>,
    buffers: Buffers<'a>,
}

/// What an attribute may be stored as: shapes, and component types with their need of normalisation
/// (`None`: either).
pub(super) struct Format {
    /// Allowed shapes.
    pub shapes: &'static [Shape],
    /// Allowed component types.
    pub components: &'static [(Component, Option<bool>)],
}

impl<'a> Accessors<'a> {
    /// Reads the descriptions of all accessors and checks their ranges.
    pub fn parse(root: &Json, buffers: Buffers<'a>, warnings: &mut Vec<String>) -> Parsed<Self> {
        let mut list = Vec::new();
        for json in root.entities("accessors")? {
            let accessor = accessor(&json, &buffers)?;
            if accessor.layout.is_none() {
                warnings.push(format!("{} has a type that glTF does not know", accessor.path));
            }
            list.push(accessor);
        }
        Ok(Self { list, buffers })
    }

    /// The buffer views.
    pub fn buffers(&self) -> &Buffers<'a> {
        &self.buffers
    }

    /// The elements in the buffer view of an accessor, `None` where it has no view; an error if the
    /// view's bytes cannot be had.
    pub fn base(&self, accessor: &Accessor) -> Parsed<Option<Strided<'_>>> {
        let Some(view) = accessor.view else { return Ok(None) };
        let layout = self.layout(accessor)?;
        let stride = self.buffers.views[view].stride.unwrap_or(layout.packed_stride());
        let bytes =
            self.buffers.bytes(view).map_err(|why| Fault::new(accessor.path.as_str(), why))?;
        Ok(Some(Strided {
            bytes: &bytes[accessor.offset as usize..],
            stride: stride as usize,
            layout,
        }))
    }

    fn layout(&self, accessor: &Accessor) -> Parsed<Layout> {
        accessor.layout.ok_or_else(|| {
            Fault::new(accessor.path.as_str(), "it has a type that glTF does not know")
        })
    }

    /// The sparse elements of an accessor: their places, strictly increasing and below its count,
    /// and their values.
    pub fn overrides(&self, accessor: &Accessor) -> Parsed<Option<(Vec<u32>, Strided<'_>)>> {
        let Some(sparse) = &accessor.sparse else { return Ok(None) };
        let part = |part: &SparsePart| {
            let layout = part
                .layout
                .ok_or_else(|| Fault::new(part.path.as_str(), "it has an unknown type"))?;
            let bytes =
                self.buffers.bytes(part.view).map_err(|why| Fault::new(part.path.as_str(), why))?;
            Ok(Strided {
                bytes: &bytes[part.offset as usize..],
                stride: layout.packed_stride() as usize,
                layout,
            })
        };
        let (indices, values) = (part(&sparse.indices)?, part(&sparse.values)?);
        let places: Vec<u32> =
            (0..sparse.count as usize).map(|i| indices.get(i, 0) as u32).collect();
        for (i, place) in places.iter().enumerate() {
            if u64::from(*place) >= accessor.count {
                let what = format!(
                    "element {i} is {place}, and the accessor has {} elements",
                    accessor.count
                );
                return Err(Fault::new(sparse.indices.path.as_str(), what));
            }
            if i > 0 && places[i - 1] >= *place {
                return Err(Fault::new(
                    sparse.indices.path.as_str(),
                    format!("element {i} does not exceed the one before"),
                ));
            }
        }
        Ok(Some((places, values)))
    }

    /// Checks that accessor `index`, which the property at the JSON path `at` refers to, is stored
    /// in one of the forms of `format`.
    pub fn expect(&self, index: usize, format: &Format, at: &str) -> Parsed<&Accessor> {
        let accessor = &self.list[index];
        let Layout { component, shape } = self.layout(accessor)?;
        let fits = format.shapes.contains(&shape)
            && format
                .components
                .iter()
                .any(|(c, n)| *c == component && n.is_none_or(|n| n == accessor.normalized));
        if fits {
            return Ok(accessor);
        }
        let normalized = if accessor.normalized { "normalized " } else { "" };
        let form = format!("{normalized}{} of {shape:?}", component.name());
        Err(Fault::new(at, format!("{} cannot serve here as an array of {form}", accessor.path)))
    }

    /// The elements of an accessor, or those at the places `pick`, as `N` single-precision numbers
    /// each; missing components are `fill`. The accessor's form has been checked, and the
    /// places are below its count.
    pub fn read<const N: usize>(
        &self,
        accessor: &Accessor,
        pick: Option<&[u32]>,
        fill: f32,
        budget: &mut Budget,
    ) -> Parsed<Vec<[f32; N]>> {
        let layout = self.layout(accessor)?;
        self.check_zeros(accessor)?;
        let count = pick.map_or(accessor.count, |p| p.len() as u64);
        budget.spend(count, 4 * N as u64, &accessor.path)?;
        let components = layout.shape.components().min(N);
        let scale = layout.component.normalizer().filter(|_| accessor.normalized);
        let element = |source: &Strided, i: usize| {
            let mut out = [fill; N];
            for (k, x) in out[..components].iter_mut().enumerate() {
                let raw = source.get(i, k);
                *x = scale.map_or(raw, |s| (raw / s).max(-1.0)) as f32;
            }
            out
        };
        let place = |i: usize| pick.map_or(i, |p| p[i] as usize);
        let mut out: Vec<[f32; N]> = match self.base(accessor)? {
            Some(base) => (0..count as usize).map(|i| element(&base, place(i))).collect(),
            None => {
                let mut zero = [fill; N];
                zero[..components].fill(0.0);
                vec![zero; count as usize]
            }
        };
        if let Some((places, values)) = self.overrides(accessor)? {
            match pick {
                None => places
                    .iter()
                    .enumerate()
                    .for_each(|(j, p)| out[*p as usize] = element(&values, j)),
                Some(pick) => {
                    for (i, p) in pick.iter().enumerate() {
                        if let Ok(j) = places.binary_search(p) {
                            out[i] = element(&values, j);
                        }
                    }
                }
            }
        }
        Ok(out)
    }

    /// The elements of an accessor of unsigned integers, of which the first component is taken.
    pub fn read_indices(&self, accessor: &Accessor, budget: &mut Budget) -> Parsed<Vec<u32>> {
        self.check_zeros(accessor)?;
        budget.spend(accessor.count, 4, &accessor.path)?;
        let count = accessor.count as usize;
        let mut out = match self.base(accessor)? {
            Some(base) => (0..count).map(|i| base.get(i, 0) as u32).collect(),
            None => vec![0; count],
        };
        if let Some((places, values)) = self.overrides(accessor)? {
            for (j, place) in places.iter().enumerate() {
                out[*place as usize] = values.get(j, 0) as u32;
            }
        }
        Ok(out)
    }

    fn check_zeros(&self, accessor: &Accessor) -> Parsed<()> {
        if accessor.view.is_none() && accessor.count > MOST_ZEROS {
            let what = format!(
                "{} elements without a buffer view, more than any sensible file has",
                accessor.count
            );
            return Err(Fault::new(accessor.path.as_str(), what));
        }
        Ok(())
    }
}

fn accessor(json: &Json, buffers: &Buffers) -> Parsed<Accessor> {
    let component = match json.unsigned("componentType")? {
        Some(code) => Component::from_code(code),
        None => return Err(json.missing("componentType")),
    };
    let shape = Shape::from_name(json.need_string("type")?);
    let layout = component.zip(shape).map(|(component, shape)| Layout { component, shape });
    let count = json.need_positive("count")?;
    let normalized = json.boolean("normalized", false)?;
    if normalized && component.is_some_and(|c| c.normalizer().is_none()) {
        return Err(json.fault_at("normalized", "only 8-bit and 16-bit integers can be normalized"));
    }
    let view = json.index("bufferView", "bufferViews", buffers.views.len())?;
    let offset = json.unsigned("byteOffset")?;
    // Exporters write a harmless 0 beside a sparse part.
    if view.is_none() && offset.is_some_and(|offset| offset != 0 || !json.has("sparse")) {
        return Err(json.fault_at("byteOffset", "it means nothing without a bufferView"));
    }
    let offset = offset.unwrap_or(0);
    if let (Some(view), Some(layout)) = (view, layout) {
        fits(json, buffers, view, offset, count, layout, true)?;
    }
    let mut bounds = [None, None];
    for (bound, key) in bounds.iter_mut().zip(["min", "max"]) {
        *bound = self::bounds(json, key, shape)?;
    }
    let sparse = match json.object_at("sparse")? {
        Some(sparse) => Some(self::sparse(&sparse, buffers, count, layout)?),
        None => None,
    };
    Ok(Accessor {
        path: json.path().to_owned(),
        count,
        layout,
        normalized,
        view,
        bounds,
        offset,
        sparse,
    })
}

/// The declared bounds of the components.
fn bounds(json: &Json, key: &str, shape: Option<Shape>) -> Parsed<Option<Vec<f64>>> {
    let Some(array) = json.get(key)? else { return Ok(None) };
    let elements = array.elements()?;
    let wanted = shape.map_or(elements.len(), Shape::components);
    if elements.len() != wanted {
        return Err(array.fault(format!("must have {wanted} elements, and has {}", elements.len())));
    }
    elements.iter().map(Json::as_number).collect::<Parsed<Vec<f64>>>().map(Some)
}

/// Checks that `count` elements from `offset` on lie inside a view and where they may.
fn fits(
    json: &Json,
    buffers: &Buffers,
    view: usize,
    offset: u64,
    count: u64,
    layout: Layout,
    strided: bool,
) -> Parsed<()> {
    let view = &buffers.views[view];
    let (element, size) = (layout.element(), layout.component.size());
    let stride = match view.stride {
        Some(_) if !strided => {
            return Err(json.fault_at(
                "bufferView",
                format!("{} must not have a byteStride for this use", view.path),
            ));
        }
        Some(stride) if stride < element => {
            return Err(json.fault(format!(
                "its elements of {element} bytes exceed the byteStride {stride} of {}",
                view.path
            )));
        }
        stride => stride.unwrap_or(layout.packed_stride()),
    };
    let end = (count - 1)
        .checked_mul(stride)
        .and_then(|n| n.checked_add(element))
        .and_then(|n| n.checked_add(offset));
    if end.is_none_or(|end| end > view.length) {
        let what = format!(
            "{count} elements of {element} bytes from {offset} on do not fit the {} bytes of {}",
            view.length, view.path
        );
        return Err(json.fault(what));
    }
    if !offset.is_multiple_of(size) || !(view.offset + offset).is_multiple_of(size) {
        return Err(json.fault_at(
            "byteOffset",
            format!("the data does not begin at a multiple of the component's {size} bytes"),
        ));
    }
    if layout.shape.is_matrix() && !offset.is_multiple_of(4) {
        return Err(json.fault_at("byteOffset", "matrices must begin at a multiple of 4 bytes"));
    }
    Ok(())
}

fn sparse(json: &Json, buffers: &Buffers, count: u64, layout: Option<Layout>) -> Parsed<Sparse> {
    let changed = json.need_positive("count")?;
    if changed > count {
        return Err(json.fault_at(
            "count",
            format!("{changed} elements are replaced, and the accessor has {count}"),
        ));
    }
    let part = |key: &str, layout: &dyn Fn(&Json) -> Parsed<Option<Layout>>| {
        let part = json.need_object(key)?;
        let layout = layout(&part)?;
        let view = part.need_index("bufferView", "bufferViews", buffers.views.len())?;
        let offset = part.unsigned("byteOffset")?.unwrap_or(0);
        if let Some(layout) = layout {
            fits(&part, buffers, view, offset, changed, layout, false)?;
        }
        Ok(SparsePart { path: part.path().to_owned(), view, offset, layout })
    };
    let index_layout = |part: &Json| {
        let code = part.unsigned("componentType")?.ok_or_else(|| part.missing("componentType"))?;
        match Component::from_code(code) {
            Some(component @ (Component::U8 | Component::U16 | Component::U32)) => {
                Ok(Some(Layout { component, shape: Shape::Scalar }))
            }
            _ => {
                Err(part
                    .fault_at("componentType", format!("{code} is no type of unsigned integer")))
            }
        }
    };
    let indices = part("indices", &index_layout)?;
    let values = part("values", &|_| Ok(layout))?;
    Ok(Sparse { count: changed, indices, values })
}
