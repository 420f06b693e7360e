//! Lights behind panes.
