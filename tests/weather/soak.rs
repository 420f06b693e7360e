//! A process that does not grow.
