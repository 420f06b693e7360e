//! The densities that the walks collect are those of the paths that they make.
