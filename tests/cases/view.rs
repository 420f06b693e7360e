//! Flattened objects, clipping planes, bright pixels.
