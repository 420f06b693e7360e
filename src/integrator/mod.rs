//! integrator.
