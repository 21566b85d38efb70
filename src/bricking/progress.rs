//! How far long work has come: told by the library, shown by its caller.

/// Hears of work done. Called often, and from any thread: keep it cheap.
pub trait Progress: Sync {
    /// Work of `total` bytes starts; `what` says which in a word or two.
    fn begin(&self, what: &str, total: u64);

    /// `bytes` more are done.
    fn advance(&self, bytes: u64);

    /// The work is over.
    fn end(&self);

    /// Something the user should know although the work goes on.
    fn note(&self, message: &str);
}

/// Tells nobody.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn begin(&self, _what: &str, _total: u64) {}
    fn advance(&self, _bytes: u64) {}
    fn end(&self) {}
    fn note(&self, _message: &str) {}
}
