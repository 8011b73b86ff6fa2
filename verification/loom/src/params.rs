//! The two choices of `lapd::params` that coordination depends on.

/// What a worker does after a conflict.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Contention {
    Local,
    Global,
    Random,
    Aggressive,
}

/// Whom a worker without work asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Begging {
    ByLevel,
    Flat,
}
