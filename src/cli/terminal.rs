//! What the commands share: printing, threads behind a progress bar, Ctrl-C, and some arguments.

use indicatif::{ProgressBar, ProgressStyle};
use lumicache::error::{Error, Result, one_line};
use lumicache::progress::{Phase, Progress};
use lumicache::render::workers;
use nix::sys::signal::{SigSet, Signal};
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Prints `text`; a reader that stops listening early is no failure.
pub fn print(text: &[u8]) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::io(Path::new("standard output"))(e))
        }
        _ => Ok(()),
    }
}

/// Lets a write beyond the limit of file sizes fail like one to a full disk; by default the system
/// kills the process. For the calling thread and those that it starts.
pub fn survive_size_limits() {
    let mut signals = SigSet::empty();
    signals.add(Signal::SIGXFSZ);
    // Without it the system does what it does.
    let _ = signals.thread_block();
}

/// Says `what` on standard error, in one line whatever it contains. Nobody may be listening there:
/// then there is nobody to tell.
pub fn tell(what: &str) {
    let _ = writeln!(std::io::stderr().lock(), "lumicache: {}", one_line(what));
}

pub fn print_line(text: &str) -> Result<()> {
    print(format!("{text}\n").as_bytes())
}

/// Tells the user, on one line.
pub fn warn(text: &str) {
    tell(&format!("warning: {text}"));
}

/// Names `file` in a fault that does not know whose fault it is.
pub fn in_file(file: &Path) -> impl Fn(Error) -> Error {
    move |error| match error {
        Error::InvalidArgument(what) => {
            Error::InvalidArgument(format!("{}: {what}", file.display()))
        }
        other => other,
    }
}

/// The value of `--threads`, 0 without one.
pub fn thread_count(threads: Option<usize>) -> Result<usize> {
    match threads {
        None => Ok(0),
        Some(n) if (1..=4096).contains(&n) => Ok(n),
        Some(_) => Err(Error::InvalidArgument("--threads must be between 1 and 4096".into())),
    }
}

/// The value of `--size`.
pub fn parse_size(text: &str) -> Result<[u32; 2]> {
    let parse = || {
        let (w, h) = text.split_once(['x', 'X'])?;
        Some([w.parse().ok()?, h.parse().ok()?])
    };
    parse().filter(|s: &[u32; 2]| s.iter().all(|&n| n > 0)).ok_or_else(|| {
        Error::InvalidArgument(format!(
            "--size {text}: expected WIDTHxHEIGHT in pixels, such as 640x480"
        ))
    })
}

/// Does long `work` on `threads` threads (0: all processors) behind a progress bar, which the first
/// Ctrl-C cancels.
pub fn on_threads<R: Send>(
    threads: usize, quiet: bool, work: impl FnOnce(&Progress) -> Result<R> + Send,
) -> Result<R> {
    let pool = workers(threads)?;
    let progress = Arc::new(Progress::default());
    cancel_on_interrupt(&progress);
    let _bar = Bar::new(&progress, quiet);
    pool.install(|| work(&progress))
}

/// Cancels `progress` on the first Ctrl-C; the second one ends the process at once.
fn cancel_on_interrupt(progress: &Arc<Progress>) {
    let progress = Arc::clone(progress);
    let installed = ctrlc::set_handler(move || {
        if progress.is_cancelled() {
            std::process::exit(130);
        }
        progress.cancel();
    });
    if let Err(error) = installed {
        warn(&format!("Ctrl-C will not save the image so far: {error}"));
    }
}

/// A bar on standard error that follows a [`Progress`] until the bar is dropped; nothing where
/// standard error is no terminal.
struct Bar {
    stop: Arc<AtomicBool>,
    watcher: Option<JoinHandle<()>>,
}

impl Bar {
    /// Starts to follow `progress`.
    fn new(progress: &Arc<Progress>, quiet: bool) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let shown = !quiet && std::io::stderr().is_terminal();
        let watcher = shown.then(|| {
            let (progress, stop) = (Arc::clone(progress), Arc::clone(&stop));
            std::thread::spawn(move || follow(&progress, &stop))
        });
        Self { stop, watcher }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(watcher) = self.watcher.take() {
            // A bar that failed must not take the picture with it.
            let _ = watcher.join();
        }
    }
}

fn follow(progress: &Progress, stop: &AtomicBool) {
    let style =
        ProgressStyle::with_template("{msg:>12} [{bar:40}] {percent:>3}%  {per_sec}  {eta} left")
            .expect("the template is sound")
            .progress_chars("=> ");
    let bar = ProgressBar::no_length().with_style(style);
    let mut phase: Option<Phase> = None;
    while !stop.load(Ordering::Acquire) {
        let now = progress.snapshot();
        if phase != Some(now.phase) {
            phase = Some(now.phase);
            bar.reset();
            bar.set_message(now.phase.name());
        }
        bar.set_length(now.total.max(1));
        bar.set_position(now.done.min(now.total.max(1)));
        std::thread::sleep(Duration::from_millis(100));
    }
    bar.finish_and_clear();
}
