//! derivative.
