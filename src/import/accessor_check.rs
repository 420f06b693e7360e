//! What the specification demands of the numbers in accessors, whether or not something shows them.

use super::accessor::{Accessor, Accessors};
use super::budget::Budget;
use super::fault::{Fault, Parsed};
use super::warnings::Warnings;
use gltf::accessor::DataType;

/// Checks the data of every accessor whose bytes are at hand: floats are finite, and no element
/// lies outside the declared bounds.
///
/// Returns the highest value of each one's first component; -∞ where the bytes are not at hand.
///
/// `work` bounds the bytes that are looked at: thousands of accessors may share the same ones.
pub(super) fn check(
    accessors: &Accessors, work: &mut Budget, warnings: &mut Warnings,
) -> Parsed<Vec<f64>> {
    let (mut loose, mut highest) = (0, Vec::new());
    for accessor in &accessors.list {
        if let Some(layout) = accessor.layout {
            let count = if accessor.view.is_some() { accessor.count } else { 0 };
            work.spend(count + accessor.replaced(), layout.element() + 8, &accessor.path)?;
        }
        let (wide, high) = check_one(accessors, accessor)?;
        loose += usize::from(wide);
        highest.push(high);
    }
    if loose > 0 {
        let what = format!(
            "{loose} accessors declare bounds wider than their data, which changes nothing here"
        );
        warnings.mend("/accessors", what)?;
    }
    Ok(highest)
}

/// Lowest and highest value of one component.
#[derive(Clone, Copy)]
struct Extent {
    low: f64,
    high: f64,
}

/// True if the declared bounds are wider than the data; and the highest first component.
fn check_one(accessors: &Accessors, accessor: &Accessor) -> Parsed<(bool, f64)> {
    let nothing = (false, f64::NEG_INFINITY);
    let Some(layout) = accessor.layout else { return Ok(nothing) };
    let has_bytes = accessor.view.is_none_or(|view| accessors.buffers().bytes(view).is_ok());
    if !has_bytes {
        return Ok(nothing);
    }
    let components = layout.shape.multiplicity();
    let mut extents = vec![Extent { low: f64::INFINITY, high: f64::NEG_INFINITY }; components];
    let mut visit = |i: usize, k: usize, x: f64| {
        if !x.is_finite() {
            return Err(Fault::new(
                accessor.path.as_str(),
                format!("component {k} of element {i} is {x}, which is no finite number"),
            ));
        }
        let extent = &mut extents[k];
        *extent = Extent { low: extent.low.min(x), high: extent.high.max(x) };
        Ok(())
    };
    let elements = accessors.elements(accessor)?;
    let mut visit_all = |places: &mut dyn Iterator<Item = usize>| {
        for (place, k) in places.flat_map(|place| (0..components).map(move |k| (place, k))) {
            visit(place, k, elements.get(place).map_or(0.0, |(source, i)| source.get(i, k)))?;
        }
        Ok(())
    };
    match &elements.base {
        Some(_) => visit_all(&mut (0..accessor.count as usize))?,
        None => {
            visit_all(&mut elements.places.iter().copied())?;
            // All others are zero.
            let other = (0..).zip(&elements.places).find(|(i, place)| i != *place);
            let other = other.map_or(elements.places.len(), |(i, _)| i);
            if (other as u64) < accessor.count {
                visit_all(&mut std::iter::once(other))?;
            }
        }
    }
    Ok((compare(accessor, layout.component == DataType::F32, &extents)?, extents[0].high))
}

/// Compares the declared bounds with the data's; true where they are wider.
fn compare(accessor: &Accessor, float: bool, extents: &[Extent]) -> Parsed<bool> {
    let mut loose = false;
    for (side, key) in ["min", "max"].into_iter().enumerate() {
        let Some(bounds) = &accessor.bounds[side] else { continue };
        for (k, (declared, extent)) in bounds.iter().zip(extents).enumerate() {
            // A declared bound was rounded to some decimals on its way through the text.
            let slack = if float {
                1e-4 * declared.abs().max(extent.low.abs()).max(extent.high.abs())
            } else {
                0.0
            };
            let (actual, beyond) = match side {
                0 => (extent.low, declared - extent.low),
                _ => (extent.high, extent.high - declared),
            };
            // Some exporters write the bounds of normalized integers as fractions.
            if beyond > slack && !accessor.normalized {
                let what = format!("{declared} is declared, and the data has {actual}");
                return Err(Fault::new(format!("{}/{key}/{k}", accessor.path), what));
            }
            loose |= beyond < -slack;
        }
    }
    Ok(loose)
}
