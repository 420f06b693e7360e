//! imagefile.
