//! The arguments.

use clap::{Args, Parser, Subcommand, ValueEnum};
use lumicache::accel::Backend;
use lumicache::imagefile::Exposure;
use lumicache::import::ImportOptions;
use lumicache::render::Frames;
use std::path::PathBuf;

/// Global illumination by irradiance caching: glTF in, multi-layer OpenEXR out.
#[derive(Parser)]
#[command(name = "lumicache", version, max_term_width = 110)]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Subcommand)]
pub enum Command {
    /// Render a scene.
    Render(Box<Render>),
    /// List the caching schemes, or show one of them as TOML.
    Presets {
        /// The scheme to show: what differs from its base.
        #[arg(value_name = "NAME|FILE.toml")]
        name: Option<String>,
        /// Show all its settings.
        #[arg(long, requires = "name")]
        all: bool,
        /// As JSON.
        #[arg(long, conflicts_with = "name")]
        json: bool,
        /// Describe all settings (Markdown).
        #[arg(long, hide = true, conflicts_with_all = ["name", "json"])]
        settings: bool,
    },
    /// Measure how far an image is from a reference.
    Compare(Compare),
    /// Describe a scene file, or the denoiser.
    Info {
        /// The scene, .gltf or .glb.
        #[arg(required_unless_present = "denoiser")]
        scene: Option<PathBuf>,
        #[command(flatten)]
        input: Input,
        /// Say which Open Image Denoise is found, and where.
        #[arg(long, conflicts_with = "scene")]
        denoiser: bool,
    },
    /// Look into cache files, and join them.
    Cache {
        #[command(subcommand)]
        what: CacheCommand,
    },
    /// Measure speed.
    Bench {
        #[command(subcommand)]
        what: Bench,
    },
    /// Compare caching schemes: as many records, as many rays for each, the error of the
    /// irradiance.
    Report(Report),
    /// Print a script that completes these commands in a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
    /// Print the manual page (roff).
    Man,
}

#[derive(Subcommand)]
pub enum CacheCommand {
    /// Say what a cache file was made for and what it holds.
    Info {
        /// The file.
        file: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Join cache files of one scene and one scheme.
    Merge(CacheMerge),
    /// Print the records of a cache file.
    Dump {
        /// The file.
        file: PathBuf,
        /// How to print them.
        #[arg(long, value_enum, default_value = "csv")]
        format: DumpFormat,
    },
}

#[derive(Args)]
pub struct CacheMerge {
    /// The files, one or more; of records at the same place the first is kept.
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// The file to write; may be one of those that are joined.
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Join records of different scenes and settings too; those of the first file are written
    /// down.
    #[arg(long)]
    pub reuse: bool,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum DumpFormat {
    /// A line of comma-separated values for each record.
    Csv,
    /// A JSON array of records.
    Json,
    /// Points with normals and colours, for a viewer of point clouds (ASCII PLY).
    Ply,
}

#[derive(Subcommand)]
pub enum Bench {
    /// Both ray tracing back ends on one scene: build time, memory, and rays per second of each
    /// kind.
    Accel(BenchAccel),
}

/// How files are read.
#[derive(Args)]
pub struct Input {
    /// Refuse what breaks the glTF specification, also where it could be mended.
    #[arg(long)]
    pub strict: bool,
    /// Read files outside the scene's folder too, where the scene names them.
    #[arg(long)]
    pub allow_outside: bool,
    /// Memory that reading a scene or an environment may take, in bytes or with K, M, G or T; by
    /// default 1G and 64 times the size of its files.
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory_limit: Option<u64>,
    /// Show what is nearer than the camera's near plane and farther than its far plane too.
    #[arg(long)]
    pub no_clip: bool,
}

impl Input {
    pub fn options(&self) -> ImportOptions {
        ImportOptions {
            strict: self.strict,
            allow_outside: self.allow_outside,
            memory_limit: self.memory_limit,
            no_clip: self.no_clip,
            ..ImportOptions::default()
        }
    }
}

fn bytes(text: &str) -> Result<u64, String> {
    let digits = text.trim_end_matches(|c: char| !c.is_ascii_digit());
    let unit = match &text[digits.len()..] {
        "" => 0,
        "K" | "k" => 10,
        "M" => 20,
        "G" => 30,
        "T" => 40,
        _ => return Err("expected bytes, or a number with K, M, G or T".into()),
    };
    let number: Result<u64, _> = digits.parse();
    let bytes = number.ok().and_then(|n| n.checked_mul(1 << unit)).filter(|n| *n > 0);
    bytes.ok_or_else(|| "expected a number of bytes above 0, such as 8G".into())
}

#[derive(Args)]
pub struct BenchAccel {
    /// The scene, .gltf or .glb.
    pub scene: PathBuf,
    #[command(flatten)]
    pub input: Input,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// The camera, by name or number.
    #[arg(long, value_name = "NAME|INDEX")]
    pub camera: Option<String>,
}

#[derive(Args)]
pub struct Report {
    /// The scene, .gltf or .glb.
    pub scene: PathBuf,
    #[command(flatten)]
    pub input: Input,
    /// Folder for report.json, report.csv, index.html and the pictures; it is made if it is
    /// missing.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Names of presets, separated by commas; settings of one preset follow it behind colons, as
    /// in `ward-heckbert92:clamping=none:radius.min_pixels=0`.
    #[arg(long, value_name = "LIST", default_value = "ward-heckbert92,krivanek06,auto")]
    pub presets: String,
    /// A setting of all of them; may be given several times.
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Numbers of records: for each the allowed error is sought that gives it within 5 %.
    #[arg(long, value_name = "LIST", default_value = "500,1000,2000")]
    pub records: String,
    /// Rays per record.
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(16..=1_000_000))]
    pub rays: u32,
    /// The reference.exr of an earlier report with the same picture, or auto to make one.
    #[arg(long, value_name = "auto|REF.exr", default_value = "auto")]
    pub reference: String,
    /// Path-traced rays per pixel of the reference.
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(32..=1_000_000))]
    pub reference_rays: u32,
    /// Size of the picture; by default 180 rows of the camera's aspect.
    #[arg(long, value_name = "WxH")]
    pub size: Option<String>,
    /// The camera, by name or number.
    #[arg(long, value_name = "NAME|INDEX")]
    pub camera: Option<String>,
    /// Light from infinity: an equirectangular .hdr or .exr.
    #[arg(long, value_name = "MAP")]
    pub env: Option<PathBuf>,
    /// Most surface interactions after the camera hit; without it paths end by Russian roulette
    /// alone.
    #[arg(long, value_name = "N")]
    pub max_bounces: Option<u32>,
    /// Number of threads; all processors by default.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Seed of everything random.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// No progress.
    #[arg(long)]
    pub quiet: bool,
}

#[derive(Args)]
pub struct Compare {
    /// The image, .exr.
    pub image: PathBuf,
    /// The reference, .exr; pixels whose alpha is 0 in it are left out.
    pub reference: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
    /// Write a picture of the FLIP error.
    #[arg(long, value_name = "OUT.png|.jpg")]
    pub flip: Option<PathBuf>,
    /// Compare the layer NAME.R, NAME.G, NAME.B of both files instead of R, G, B.
    #[arg(long, value_name = "NAME")]
    pub channel_prefix: Option<String>,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum IntegratorName {
    /// Irradiance caching.
    Cache,
    /// Path tracing, the reference.
    Path,
    /// Bidirectional path tracing, for caustics and hidden lamps.
    Bdpt,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum DenoiseName {
    /// Where Open Image Denoise is installed.
    Auto,
    /// Always: without Open Image Denoise nothing is rendered.
    On,
    /// Never.
    Off,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum LightUnitsName {
    /// Numbers as the file has them.
    Photometric,
    /// Punctual intensities, luminaires and skies divided by 683 lm/W, for files that Blender
    /// exported.
    Radiometric,
}

#[derive(Args)]
pub struct Render {
    /// The scene, .gltf or .glb.
    pub scene: PathBuf,
    #[command(flatten)]
    pub input: Input,
    /// Output file; by default the scene's name with .exr in the current folder.
    #[arg(short, long, value_name = "OUT.exr")]
    pub output: Option<PathBuf>,
    /// Light transport.
    #[arg(long, value_enum, default_value = "cache")]
    pub integrator: IntegratorName,
    /// Caching scheme: see `lumicache presets`.
    #[arg(long, value_name = "NAME|FILE.toml", default_value = "auto")]
    pub preset: String,
    /// One number for everything: 1 is the default, 2 costs about twice as much, 0.5 half as much.
    #[arg(long, value_name = "Q", default_value_t = 1.0)]
    pub quality: f32,
    /// Set one setting of the scheme, such as gather.rays=512; may be repeated, all are checked
    /// together.
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Image size; by default 720 rows of the camera's aspect, 1280x720 where it has none.
    #[arg(long, value_name = "WxH")]
    pub size: Option<String>,
    /// Samples per pixel, the same for all; by default 16, and with the cache up to 64 where a
    /// pixel is still noisy.
    #[arg(long, value_name = "N")]
    pub spp: Option<u32>,
    /// Take the noise out of what was traced by Open Image Denoise; light from records stays as it
    /// is.
    #[arg(long, value_enum, default_value = "off")]
    pub denoise: DenoiseName,
    /// Most surface interactions after the camera hit; without it paths end by Russian roulette
    /// alone.
    #[arg(long, value_name = "N")]
    pub max_bounces: Option<u32>,
    /// Rays per record.
    #[arg(long, value_name = "N")]
    pub rays: Option<u32>,
    /// Allowed error of the scheme.
    #[arg(long, value_name = "E")]
    pub error: Option<f32>,
    /// Ray tracer: embree or bvh.
    #[arg(long, value_name = "NAME", default_value_t = Backend::default().name().to_owned())]
    pub backend: String,
    /// Number of threads; all processors by default.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Seed of everything random.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// The camera, by name or number.
    #[arg(long, value_name = "NAME|INDEX")]
    pub camera: Option<String>,
    /// Render these frames of the camera's animation, both ends included; all read the same
    /// records. Files are numbered: NAME.0001.exr, or where %04d stands.
    #[arg(long, value_name = "A..B")]
    pub frames: Option<Frames>,
    /// Frames per second: frame K shows second K/FPS of the animation.
    #[arg(long, value_name = "FPS", default_value_t = 24.0, value_parser = positive)]
    pub fps: f64,
    /// Render only this window, in pixels; ends are excluded.
    #[arg(long, value_name = "x0,y0,x1,y1")]
    pub crop: Option<String>,
    /// Light from infinity: an equirectangular image.
    #[arg(long, value_name = "MAP.hdr|.exr")]
    pub env: Option<PathBuf>,
    /// A CIE standard sky with a sun: overcast, clear, or cie1 to cie15, then azimuth (of the sun,
    /// clockwise from north, -Z), elevation, turbidity, illuminance, sun=disc|direction|none,
    /// sun-illuminance, color, ground.
    #[arg(long, value_name = "KIND[,KEY=VALUE]...", conflicts_with = "env")]
    pub sky: Option<String>,
    /// Turn the environment about the vertical axis.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    pub env_rotate: f32,
    /// Multiply the environment's radiance.
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    pub env_scale: f32,
    /// Units of point, spot and directional lights, IES files and skies.
    #[arg(long, value_enum, default_value = "photometric")]
    pub light_units: LightUnitsName,
    /// Give rough surfaces back the light that scatters between their microfacets, which glTF's
    /// model loses.
    #[arg(long)]
    pub multiple_scattering: bool,
    /// Begin with the records of a cache file; may be repeated.
    #[arg(long, value_name = "F")]
    pub cache_load: Vec<PathBuf>,
    /// Take cache files that were made for another scene or under other settings.
    #[arg(long, requires = "cache_load")]
    pub cache_reuse: bool,
    /// Write all records to a cache file when the picture is done.
    #[arg(long, value_name = "F")]
    pub cache_save: Option<PathBuf>,
    /// Fill the cache and stop.
    #[arg(long)]
    pub prepass_only: bool,
    /// Layers beside the beauty: none, basic, all, or names.
    #[arg(long, value_name = "LIST", default_value = "basic")]
    pub aov: String,
    /// Write 32-bit floats in all layers; by default colours are 16-bit floats, but for layers
    /// that are brighter than 65504 somewhere.
    #[arg(long)]
    pub float: bool,
    /// Write an 8-bit sRGB picture too.
    #[arg(long, value_name = "OUT.png|.jpg")]
    pub preview: Option<PathBuf>,
    /// Exposure of the preview in stops; auto takes the middle of the picture to mid-gray, and of a
    /// sequence that of the first frame.
    #[arg(long, value_name = "EV|auto", default_value = "auto", allow_negative_numbers = true)]
    pub exposure: Exposure,
    /// Write statistics as JSON.
    #[arg(long, value_name = "OUT.json")]
    pub stats: Option<PathBuf>,
    /// Draw the records over the preview and into the layers gi.overlay and gi.level.
    #[arg(long)]
    pub show_records: bool,
    /// Show the image under way in a tev viewer.
    #[arg(long, value_name = "HOST:PORT")]
    pub display_server: Option<String>,
    /// No progress and no warnings.
    #[arg(long)]
    pub quiet: bool,
}

fn positive(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|x: &f64| x.is_finite() && *x > 0.0)
        .ok_or_else(|| "expected a number above 0".into())
}
