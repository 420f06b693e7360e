//! Rays against triangles: closest hit and occlusion, for single rays and for bundles, by Embree or by a BVH in Rust.
