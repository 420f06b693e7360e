//! furnace.
