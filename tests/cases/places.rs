//! Scenes far from the origin, tiny, huge, in the middle of a desert.
