//! What a caller may choose of how threads share work.

/// What a thread does when another one owns a tet that it needs: the contention manager. All give
/// up the operation first, with nothing changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Contention {
    /// It waits until the thread that it met has made some progress, unless that one waits itself.
    #[default]
    Local,
    /// It waits, in one list for all threads, until others have made some progress; the last one
    /// that works never waits.
    Global,
    /// After some conflicts in sequence it sleeps for a random time.
    Random,
    /// It goes on at once.
    Aggressive,
}

/// Whom a thread without work asks for some first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Begging {
    /// The threads of its own cache, then of its socket, then of the machine.
    #[default]
    ByLevel,
    /// All threads alike.
    Flat,
}
