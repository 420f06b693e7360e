//! Textured lamps, lamps cut by alpha, narrow spots.
