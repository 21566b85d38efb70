//! Progress on standard error: a bar with rate and time left when it is a terminal, else nothing but notes.

use std::io::{self, IsTerminal, Write};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::bricking::Progress;

/// A progress bar, when somebody can see it.
#[derive(Debug, Default)]
pub struct Bar {
    bar: Mutex<Option<ProgressBar>>,
}

impl Bar {
    fn with(&self, work: impl FnOnce(&mut Option<ProgressBar>)) {
        work(&mut self.bar.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Begins to count `total` frames; [`Progress::advance`] counts them.
    pub(super) fn begin_frames(&self, what: &str, total: u64) {
        let template = "{msg} [{bar:32}] {pos}/{len} frames  {per_sec}  {eta} left";
        self.begin_with(template, what, total);
    }

    /// Begins what nobody knows the end of.
    pub(super) fn begin_unmeasured(&self, what: &str) {
        self.begin_with("{spinner} {msg}  {elapsed}", what, 0);
    }

    fn begin_with(&self, template: &str, what: &str, total: u64) {
        if !io::stderr().is_terminal() {
            return;
        }
        let style = ProgressStyle::with_template(template)
            .unwrap_or_else(|_| ProgressStyle::default_bar())
            .progress_chars("=> ");
        let bar = ProgressBar::new(total)
            .with_style(style)
            .with_message(what.to_owned());
        bar.enable_steady_tick(Duration::from_millis(200));
        self.with(|slot| *slot = Some(bar));
    }
}

impl Progress for Bar {
    fn begin(&self, what: &str, total: u64) {
        let template = "{msg} [{bar:32}] {bytes}/{total_bytes}  {bytes_per_sec}  {eta} left";
        self.begin_with(template, what, total);
    }

    fn advance(&self, bytes: u64) {
        self.with(|slot| {
            if let Some(bar) = slot {
                bar.inc(bytes);
            }
        });
    }

    fn end(&self) {
        self.with(|slot| {
            if let Some(bar) = slot.take() {
                bar.finish_and_clear();
            }
        });
    }

    fn note(&self, message: &str) {
        let tell = || {
            // Standard error is gone: nobody to tell.
            let _ = writeln!(io::stderr(), "brickscope: {message}");
        };
        self.with(|slot| match slot {
            Some(bar) => bar.suspend(tell),
            None => tell(),
        });
    }
}
