//! What tables are made for.

use crate::basis::BasisKind;

/// What tables are made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableSettings {
    /// The basis.
    pub basis: BasisKind,
    /// Its highest order.
    pub order: usize,
    /// Share of a lobe's energy that may be lost: see [`super::LobeTable`].
    pub loss: f32,
    /// Records may have too low an order for some directions: see
    /// [`super::GlossyTables::record_order`].
    pub padding: bool,
    /// Lobes have all bands, and not only those that `loss` asks for.
    pub whole: bool,
    /// Lobes need all bands, and no lobe is of high frequency, whatever it loses.
    pub forced: bool,
}

impl TableSettings {
    /// What a table depends on, as text.
    pub(super) fn key(&self) -> String {
        format!("{:?} {}", self.basis, self.order)
    }
}
