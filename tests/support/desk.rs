//! A folder to run the built program in, as a user would.

use lumicache::imagefile::{Picture, exr};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Options with which a render takes a blink.
pub const QUICK: &[&str] =
    &["--size", "32x24", "--rays", "16", "--error", "1", "--set", "levels=1"];
/// How long a busy machine may take to start the program, and it to find what is wrong.
const PATIENCE: Duration = Duration::from_secs(60);

/// The path of one of our scenes.
pub fn scene(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join(format!("scenes/{name}.gltf"))
        .to_str()
        .unwrap()
        .to_owned()
}

/// A folder to run the program in, empty at first.
pub struct Desk(TempDir);

impl Desk {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lumicache"));
        command.args(arguments).current_dir(self.0.path()).stdin(Stdio::null());
        command
    }

    pub fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs what must succeed, and returns what it prints.
    pub fn print(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
        assert_eq!(text(&output.stderr), "", "{arguments:?}");
        text(&output.stdout)
    }

    /// Renders one of our scenes, quickly, to `out.exr`, and reads that.
    pub fn render(&self, name: &str, more: &[&str]) -> Picture {
        let samples: &[&str] = if more.contains(&"--spp") { &[] } else { &["--spp", "2"] };
        let stdout = self
            .print(&[&["render", &scene(name), "-o", "out.exr"], QUICK, samples, more].concat());
        let preview = more.contains(&"--preview");
        assert!(stdout.is_empty() || preview, "a render that is piped says nothing: {stdout}");
        exr::read(&self.path("out.exr")).unwrap()
    }

    /// Runs what must fail with one line that contains `words` and leave no file behind.
    pub fn fail(&self, arguments: &[&str], words: &[&str]) {
        let before = self.files();
        let mut child =
            self.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let started = Instant::now();
        while child.try_wait().unwrap().is_none() {
            if started.elapsed() > PATIENCE {
                child.kill().unwrap();
                panic!("{arguments:?} was accepted, or takes long to refuse");
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let output = child.wait_with_output().unwrap();
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {error}");
        assert!(
            error.starts_with("lumicache: ") && error.ends_with('\n') && error.lines().count() == 1,
            "{arguments:?}: {error:?}"
        );
        assert!(
            words.iter().all(|w| error.contains(w)),
            "{arguments:?}: {error} does not say {words:?}"
        );
        assert!(output.stdout.is_empty(), "{arguments:?}");
        assert_eq!(self.files(), before, "{arguments:?} left something behind");
    }

    /// The names of all files, hidden ones too.
    pub fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap().map(|e| e.unwrap());
        let mut names: Vec<_> =
            entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    pub fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&std::fs::read(self.path(name)).unwrap()).unwrap()
    }
}

/// Output as text.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// A render that nobody waits for.
pub const ENDLESS: &[&str] = &["--size", "640x480", "--spp", "1000000"];

pub fn mean(layers: &Picture, channel: &str) -> f32 {
    let samples =
        &layers.channel(channel).unwrap_or_else(|| panic!("there is no channel {channel}")).samples;
    samples.iter().sum::<f32>() / samples.len() as f32
}

pub fn names(layers: &Picture) -> Vec<&str> {
    layers.channels.iter().map(|c| c.name.as_str()).collect()
}
