//! The progress bar and Ctrl-C.

use indicatif::{ProgressBar, ProgressStyle};
use lumicache::progress::{Phase, Progress};
use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Cancels `progress` on the first Ctrl-C; the second one ends the process at once.
pub fn cancel_on_interrupt(progress: &Arc<Progress>) {
    let progress = Arc::clone(progress);
    let installed = ctrlc::set_handler(move || {
        if progress.is_cancelled() {
            std::process::exit(130);
        }
        progress.cancel();
    });
    if let Err(error) = installed {
        eprintln!("lumicache: warning: Ctrl-C will not save the image so far: {error}");
    }
}

/// A bar on standard error that follows a [`Progress`] until it is dropped; nothing where standard
/// error is no terminal.
pub struct Bar {
    stop: Arc<AtomicBool>,
    watcher: Option<JoinHandle<()>>,
}

impl Bar {
    /// Starts to follow `progress`.
    pub fn new(progress: &Arc<Progress>, quiet: bool) -> Self {
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
