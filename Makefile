# What users and CI both run. `make demo` and `make test` need nothing but git, make and a Rust
# toolchain: see .ci/setup.

SHELL := /bin/bash
CARGO ?= cargo
OUT ?= out
SCENE ?= indirect-room
PREFIX ?= /usr/local
DESTDIR ?=

# A toolchain that rustup has just installed is not yet on the PATH of the shell that runs make.
export PATH := $(PATH):$(HOME)/.cargo/bin

# The modules that reach the foreign libraries, or stand in for them in a build without system
# libraries.
FFI_TESTS := accel:: imagefile::
IMAGE_TESTS := $(FFI_TESTS) furnace:: images::

# Quick enough for an interpreter: what is pure, and what the C library does with pointers. Rayon's
# queues are sound under tree borrows, not under the stricter stacked ones. Its threads live as long
# as the process, which Miri calls a leak.
MIRI_TESTS := basis::turns basis::rotation basis::single basis::the_cosine gather::strata edges::tests::an_infinitely \
	late::tests::threads late::tests::what_is_made locate::tests::coincident hosted::answers \
	handles:: capi::describe capi::pool capi::status references_are_counted
MIRIFLAGS := -Zmiri-disable-isolation -Zmiri-ignore-leaks -Zmiri-deterministic-floats -Zmiri-tree-borrows \
	-Zmiri-permissive-provenance
TSAN_TESTS := handles:: late::tests capi::pool capi::hosted:: a_fill_from_many_threads references_are_counted

.DEFAULT_GOAL := help
.PHONY: help setup build demo denoiser install header test test-quick test-ffi test-capi test-loom test-hosts test-embree4 lint scenes bench bench-hot fuzz miri tsan soak clean

help: ## Lists the targets.
	@sed -n 's/^\([a-z0-9-]*\):.*## \(.*\)/  make \1|\2/p' $(MAKEFILE_LIST) | column -t -s '|' 2>/dev/null || grep '##' $(MAKEFILE_LIST)

setup: ## Installs the Debian packages and the Rust toolchain that are missing.
	@.ci/setup

build: setup ## Builds in release mode.
	$(CARGO) build --release --locked

demo: build ## Renders a scene to out/demo.exr and out/demo.png (SCENE=NAME picks another one of scenes/).
	@mkdir -p $(OUT)
	$(CARGO) run --release --locked --quiet -- render scenes/$(SCENE).gltf -o $(OUT)/demo.exr --preview $(OUT)/demo.png
	@echo "The picture: $(abspath $(OUT))/demo.png"
	@echo "All its layers: $(abspath $(OUT))/demo.exr"

denoiser: build ## Installs Open Image Denoise into ~/.local/share/lumicache/oidn, for --denoise (needs python3; 88 MB).
	@.ci/denoiser
	env -u LUMICACHE_OIDN $(CARGO) run --release --locked --quiet -- info --denoiser

install: setup ## Installs the C library: header, shared and static library, pkg-config file, CMake package (PREFIX=/usr/local DESTDIR=).
	ffi/install "$(PREFIX)" "$(DESTDIR)"

header: setup ## Writes ffi/include/lumicache.h anew from the source.
	LUMICACHE_WRITE_HEADER=1 .ci/cargo-test --test integration -- header::

test: setup lint test-loom test-capi ## Runs every check and test, with and without the system libraries.
	$(CARGO) test --release --locked
	$(CARGO) build --release --locked --no-default-features
	.ci/cargo-test --no-default-features --lib -- $(FFI_TESTS)
	.ci/cargo-test --no-default-features --test integration -- $(IMAGE_TESTS)

lint: setup ## Checks format, lints and documentation.
	@.ci/setup --components rustfmt clippy
	$(CARGO) fmt --check
	$(CARGO) clippy --release --locked --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --release --locked --no-deps --document-private-items

test-quick: setup ## Runs the tests without the extra test data.
	env -u LUMICACHE_TEST_DATA $(CARGO) test --release --locked

test-ffi: setup ## Runs the tests of what touches Embree and OpenEXR.
	.ci/cargo-test --lib -- $(FFI_TESTS)
	.ci/cargo-test --test integration -- $(IMAGE_TESTS)
ifdef LINKS
	@# LINKS=libembree4: the tests above were linked with that library.
	@ldd "$$(ls -t "$${CARGO_TARGET_DIR:-target}"/release/deps/integration-* | grep -v '\.d$$' | head -n 1)" | grep -F "$(LINKS)"
endif

test-capi: setup ## Installs the C library under target/ and runs its examples: sanitizers, valgrind, pkg-config, CMake.
	@.ci/setup --packages cmake valgrind g++ binutils python3
	ffi/install "$${CARGO_TARGET_DIR:-target}/capi"
	LUMICACHE_PREFIX="$(abspath $(or $(CARGO_TARGET_DIR),target))/capi" .ci/cargo-test --test integration -- installed::

test-loom: setup ## Tries all interleavings of the concurrent parts of the C library.
	$(CARGO) test --release --locked --manifest-path tests/loom/Cargo.toml

test-hosts: ## Runs the C library inside Mitsuba and Blender, which are downloaded into ~/.cache/lumicache-hosts (1.2 GB).
	@.ci/hosts

test-embree4: ## Runs test-ffi in a fresh Debian 13, against Embree 4 (needs root).
	@.ci/embree4

scenes: ## Writes scenes/ anew.
	python3 scenes/make_scenes.py

bench: build ## Compares the ray tracing back ends (SCENE=NAME picks another one of scenes/).
	$(CARGO) run --release --locked --quiet -- bench accel scenes/$(SCENE).gltf

bench-hot: setup ## Measures lookups, gathers, bundles and shading.
	$(CARGO) bench --locked --bench hot

miri: setup ## Runs small tests of what is pure and of what the C library does with pointers in Miri (needs nightly Rust with miri and rust-src).
	MIRIFLAGS="$(MIRIFLAGS)" $(CARGO) +nightly miri test --locked --no-default-features --target-dir target/miri --lib --test integration -- $(MIRI_TESTS)

tsan: setup ## Runs tests of threads under ThreadSanitizer (needs nightly Rust with rust-src).
	CARGO_PROFILE_DEV_OPT_LEVEL=1 CARGO_PROFILE_DEV_DEBUG=line-tables-only RUSTFLAGS=-Zsanitizer=thread $(CARGO) +nightly test --locked --no-default-features --target-dir target/tsan -Zbuild-std --target x86_64-unknown-linux-gnu --lib --test integration -- $(TSAN_TESTS)

soak: setup ## Queries from 8 threads while builds go on for TIME=1800 seconds; LIVES=1000 loads and releases; KILLS=200 kills.
	SOAK=$(or $(TIME),1800) LIVES=$(or $(LIVES),1000) KILLS=$(or $(KILLS),200) .ci/cargo-test --test integration -- --nocapture soak:: a_kill_leaves

fuzz: setup ## Feeds damaged files to all readers, TIME=60 seconds each (needs nightly Rust, cargo-fuzz).
	fuzz/run $(or $(TIME),60)

clean: ## Removes what was built and rendered.
	$(CARGO) clean
	rm -rf $(OUT)
