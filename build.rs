//! Makes the raw bindings to the foreign libraries that the enabled features name.
//!
//! Embree: the headers of `EMBREE_DIR` if set, else the system's `embree4/rtcore.h`, else
//! `embree3/rtcore.h`; emits `cfg(embree4)` for the former. With the feature `private-embree`
//! nothing is linked: the library is loaded at run time, from `LUMICACHE_EMBREE_FOUND` first.
//! OpenEXR: the system's C core (`openexr.h`).

fn main() {
    println!("cargo:rustc-check-cfg=cfg(embree4)");
    println!("cargo:rerun-if-changed=build.rs");
    #[cfg(feature = "embree")]
    foreign::embree();
    #[cfg(feature = "openexr")]
    foreign::openexr();
}

#[cfg(any(feature = "embree", feature = "openexr"))]
mod foreign {
    use std::env;
    use std::path::{Path, PathBuf};

    fn out(name: &str) -> PathBuf {
        Path::new(&env::var_os("OUT_DIR").expect("cargo sets OUT_DIR")).join(name)
    }

    fn first_existing(candidates: &[PathBuf]) -> Option<PathBuf> {
        candidates.iter().find(|p| p.exists()).cloned()
    }

    fn fail(what: &str) -> ! {
        eprintln!("lumicache: {what}");
        std::process::exit(1)
    }

    /// The functions that `ffi::embree` calls.
    #[cfg(feature = "embree")]
    const FUNCTIONS: &str = "rtc(New|Release)(Device|Scene|Geometry)|rtc(GetDevice|SetDevice|SetScene|SetGeometry|SetNewGeometry).*\
        |rtcCommit(Scene|Geometry)|rtcAttachGeometryByID|rtc(Intersect|Occluded)(1|8|16)";

    /// The library that belongs to the headers: in `EMBREE_DIR`, else where systems keep libraries.
    #[cfg(feature = "embree")]
    fn installed(dir: Option<&Path>, is_4: bool) -> PathBuf {
        let name = if is_4 { "libembree4.so.4" } else { "libembree3.so.3" };
        let machine = env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default();
        let system = [
            format!("/usr/lib/{machine}-linux-gnu"),
            "/usr/lib64".into(),
            "/usr/lib".into(),
            "/usr/local/lib".into(),
        ];
        let folders = dir.map_or_else(
            || system.map(PathBuf::from).to_vec(),
            |d| vec![d.join("lib"), d.join("lib64")],
        );
        let found = folders.into_iter().map(|f| f.join(name)).find(|p| p.exists());
        found.unwrap_or_else(|| {
            fail(&format!("{name}, which belongs to Embree's headers, was not found"))
        })
    }

    #[cfg(feature = "embree")]
    pub fn embree() {
        println!("cargo:rerun-if-env-changed=EMBREE_DIR");
        let dir = env::var_os("EMBREE_DIR").map(PathBuf::from);
        let include =
            dir.as_ref().map_or_else(|| PathBuf::from("/usr/include"), |d| d.join("include"));
        let header = first_existing(&[include.join("embree4/rtcore.h"), include.join("embree3/rtcore.h")]).unwrap_or_else(|| {
            fail(
                "Embree's headers were not found. Install Debian's libembree-dev, or set EMBREE_DIR to an Embree 3 or 4 \
                 installation, or build with --no-default-features to trace with the pure-Rust BVH.",
            )
        });
        let is_4 = header.to_string_lossy().contains("embree4");
        if is_4 {
            println!("cargo:rustc-cfg=embree4");
        }
        let private = env::var_os("CARGO_FEATURE_PRIVATE_EMBREE").is_some();
        if private {
            println!(
                "cargo:rustc-env=LUMICACHE_EMBREE_FOUND={}",
                installed(dir.as_deref(), is_4).display()
            );
        } else {
            if let Some(dir) = &dir {
                println!("cargo:rustc-link-search=native={}", dir.join("lib").display());
            }
            println!("cargo:rustc-link-lib=dylib={}", if is_4 { "embree4" } else { "embree3" });
        }
        println!("cargo:rerun-if-changed=ffi/embree/wrapper.h");
        let mut builder = bindgen::Builder::default();
        if private {
            builder = builder.dynamic_library_name("Embree").dynamic_link_require_all(true);
        }
        builder
            .header("ffi/embree/wrapper.h")
            .clang_arg(format!("-I{}", include.display()))
            .clang_arg(format!("-DLUMI_EMBREE4={}", i32::from(is_4)))
            .allowlist_function(FUNCTIONS)
            .allowlist_type("RTC.*")
            .allowlist_var("RTC.*")
            .prepend_enum_name(false)
            .derive_default(true)
            .layout_tests(true)
            .generate()
            .unwrap_or_else(|e| fail(&format!("bindgen could not read {}: {e}", header.display())))
            .write_to_file(out("embree.rs"))
            .expect("OUT_DIR is writable");
    }

    #[cfg(feature = "openexr")]
    pub fn openexr() {
        let include = first_existing(&[
            PathBuf::from("/usr/include/OpenEXR"),
            PathBuf::from("/usr/local/include/OpenEXR"),
        ]);
        let Some(include) = include.filter(|d| d.join("openexr.h").exists()) else {
            fail(
                "OpenEXR's C core header openexr.h was not found. Install Debian's libopenexr-dev, or build with \
                 --no-default-features to write EXR files in pure Rust.",
            )
        };
        let imath = first_existing(&[
            PathBuf::from("/usr/include/Imath"),
            PathBuf::from("/usr/local/include/Imath"),
        ]);
        println!("cargo:rustc-link-lib=dylib=OpenEXRCore");
        println!("cargo:rerun-if-changed=ffi/openexr/wrapper.h");
        let mut builder = bindgen::Builder::default()
            .header("ffi/openexr/wrapper.h")
            .clang_arg(format!("-I{}", include.display()))
            .allowlist_function("exr_.*")
            .allowlist_type("exr_.*")
            .allowlist_var("EXR_.*")
            .prepend_enum_name(false);
        if let Some(imath) = imath {
            builder = builder.clang_arg(format!("-I{}", imath.display()));
        }
        builder
            .generate()
            .unwrap_or_else(|e| fail(&format!("bindgen could not read openexr.h: {e}")))
            .write_to_file(out("openexr.rs"))
            .expect("OUT_DIR is writable");
    }
}
