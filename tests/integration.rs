//! All integration tests: one binary, so that there is one link.

mod accel; // both back ends agree
mod adaptive; // adaptive caching
mod animations; // cameras that move
mod architecture; // module order, citations, file sizes
mod axes; // records with eight axes, direct light in records
mod basis; // spherical and hemispherical harmonics
mod bdpt; // bidirectional path tracing
mod bsdfs; // surfaces and quadrature for chi2 and furnace_bsdf
mod cache_files; // caches saved, loaded, joined
mod capi; // the C library as C calls it
mod chi2; // sample() agrees with pdf()
mod cli; // the command line as a user runs it
mod coefficients; // derivatives of radiance coefficients against exact ones
mod compare; // image metrics
mod conformance; // glTF files that must load
mod derivative; // gradients against closed forms
mod desk; // a folder to run the program in
mod determinism; // same seed, same bytes
mod furnace; // closed boxes of known radiance
mod furnace_bsdf; // energy, reciprocity and consistency of the BSDFs
mod gltf_maker; // small glTF files made on the spot
mod gradients; // the published gradients compared in the Cornell box
mod header; // the C header and the guard
mod hessians; // gradients and Hessians of the triangulated hemisphere against closed forms
mod ies; // measured luminaires
mod imagefile; // images in and out
mod images; // whole pictures against references
mod installed; // the installed C library and its examples
mod layers; // both integrators fill the layers alike
mod leaks; // thin walls
mod lights; // light sampling
mod malformed; // files that must fail, cleanly
mod pictures; // rendering inside the tests
mod radiance; // radiance coefficients, their gradients, tables of lobes
mod report; // schemes on equal terms
mod scenes; // our own scenes
mod scheme_texts; // presets, files of users, settings by name
mod schemes; // every preset
mod scotty3d; // what a second pass and the rotational gradient are worth
mod sky; // daylight
mod testdata; // where the optional test data is
mod two_glossy; // light from one glossy surface on another
mod zhao; // radiance records on all surfaces
