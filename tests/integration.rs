//! All integration tests: one binary, so that there is one link. The folders say what is tested.

/// What the tests share.
mod support {
    pub mod bsdfs; // surfaces and quadrature for chi2 and furnace_bsdf
    pub mod desk; // a folder to run the program in
    pub mod gltf_maker; // small glTF files made on the spot
    pub mod lights; // lights that are sampled
    pub mod meshes; // meshes that rays are traced in
    pub mod pictures; // rendering inside the tests
    pub mod refined; // caches refined to convergence
    pub mod rooms; // closed boxes and planes of known radiance
    pub mod source; // the files of the project as text
    pub mod statistics; // random numbers and what they are held against
    pub mod testdata; // where the optional test data is
}

/// Estimators against closed forms and quadrature.
mod numeric {
    mod accel; // both back ends agree
    mod accel_limits; // near, tiny, degenerate, not a number
    mod basis; // spherical and hemispherical harmonics
    mod camera; // rays, what undoes them, keyframes
    mod chi2; // sample() agrees with pdf()
    mod coefficients; // derivatives of radiance coefficients against exact ones
    mod compare; // image metrics
    mod derivative; // gradients against closed forms
    mod emission; // where light paths begin
    mod furnace_bsdf; // energy, reciprocity and consistency of the BSDFs
    mod hessians; // gradients and Hessians of the triangulated hemisphere against closed forms
    mod light_choice; // which lights are chosen
    mod lights; // light sampling
    mod lobes; // tables of glossy lobes
    mod math; // frames, buffers
    mod polygon; // irradiance in closed form
    mod quadrature; // rules, slopes of harmonics
    pub mod radiance; // radiance coefficients and their gradients
    mod sampling; // random streams, warps
    mod shade; // what material and textures make of a point
    mod sky; // daylight
    mod sky_models; // skies against their standards
    mod strata; // directions of a hemisphere
    mod texture; // texels
}

/// What the schemes promise.
mod schemes {
    mod adaptive; // adaptive caching
    mod axes; // records with eight axes, direct light in records
    mod glossy; // glossy pictures by records and by paths
    mod gradients; // the published gradients compared in the Cornell box
    mod leaks; // thin walls
    mod presets; // every preset
    mod radiosity; // all light behind the visible surfaces
    mod report; // schemes on equal terms
    mod scotty3d; // what a second pass and the rotational gradient are worth
    mod steps_of_light; // small records at steps, few elsewhere
    mod texts; // presets, files of users, settings by name
    mod two_glossy; // light from one glossy surface on another
    mod units; // of length and light do not matter
    mod zhao; // radiance records on all surfaces
}

/// Whole pictures and their files.
mod pictures {
    mod animations; // cameras that move
    mod bdpt; // bidirectional path tracing
    mod denoise; // noise taken out
    mod determinism; // same seed, same bytes
    mod furnace; // closed boxes of known radiance
    mod imagefile; // images in and out
    mod images; // whole pictures against references
    mod layers; // both integrators fill the layers alike
}

/// Files of scenes and luminaires.
mod import {
    mod conformance; // glTF files that must load
    mod ies; // measured luminaires
    pub mod malformed; // files that must fail, cleanly
    mod meaning; // small glTF files made on the spot
    mod rules; // those of the validator, one by one
    mod scenes; // our own scenes
}

/// Situations in which users of other renderers lost light, and their right values.
mod cases {
    mod adaptive_sampling; // pixels whose first samples found nothing
    mod bounces; // small bright spots light a room
    mod emitters; // textured lamps, lamps cut by alpha, narrow spots
    mod environments; // maps as other programs write them
    mod glass; // lights behind panes
    pub mod lenient; // files that other programs read
    mod places; // far from the origin, tiny, huge, in the middle of a desert
    mod view; // flattened objects, clipping planes, bright pixels
}

/// What no input and no weather may break.
mod weather {
    mod extremes; // valid scenes with extreme numbers
    mod inputs; // files that ask for memory, work or other files
    mod outputs; // disks, devices, signals
    mod soak; // a process that does not grow
}

mod capi; // the C library as C calls it, its header, its installation

/// The program and the project.
mod tools {
    mod architecture; // module order, file sizes
    mod cache_files; // caches saved, loaded, joined
    mod exposure; // how bright previews are
    mod documents; // the commands in the documents run
    mod file_order; // no circles between files
    mod prose; // citations, names of files and widths in documents and comments
    mod cli; // the command line as a user runs it
    mod outputs; // what `render` writes
    mod watched; // a viewer, an interrupt
}
