//! Disks, devices and signals.
