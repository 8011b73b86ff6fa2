//! Large tables: an error that names the table where `Vec` alone would end the process.

use crate::{Error, Result};

/// Values between two questions whether to go on: the system hands out memory when it is first written to, which takes its time for large tables.
const STEP: usize = 1 << 16;

/// Room for exactly `count` values, counted as `what`.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn room<T>(count: usize, what: &'static str) -> Result<Vec<T>> {
    let mut values = Vec::new();
    values.try_reserve_exact(count).map_err(|_| Error::OutOfMemory { count, what })?;
    Ok(values)
}

/// `count` copies of a value, counted as `what`.
///
/// # Errors
/// [`Error::OutOfMemory`]; those of `go_on`, which is asked every some thousand values.
pub fn filled<T: Clone>(count: usize, value: T, what: &'static str, go_on: impl Fn() -> Result<()>) -> Result<Vec<T>> {
    let mut values = room(count, what)?;
    while values.len() < count {
        go_on()?;
        values.resize((values.len() + STEP).min(count), value.clone());
    }
    Ok(values)
}
