//! What the library is: its version, its parts, the texts of its statuses.

use std::ffi::c_char;

use super::boundary::value_or;
use super::status::lapd_status;

/// The version of the library that runs, as "MAJOR.MINOR.PATCH". LAPD_VERSION is that of the header
/// the caller was compiled with.
///
/// The string is static. May be called from any thread.
#[unsafe(no_mangle)]
pub extern "C" fn lapd_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// The optional parts that the library that runs was built with, by name and separated by spaces;
/// "" for none. "hwloc": the machine is as hwloc tells it, and lapd_params_set_topology takes
/// descriptions of others; without it Linux tells the machine in /sys. "hdf5": .xdmf and
/// .vtkhdf files are written. "tiff": .tif files are read.
///
/// The string is static. May be called from any thread.
#[unsafe(no_mangle)]
pub extern "C" fn lapd_features() -> *const c_char {
    match (cfg!(feature = "hdf5"), cfg!(feature = "hwloc"), cfg!(feature = "tiff")) {
        (false, false, false) => c"",
        (false, false, true) => c"tiff",
        (false, true, false) => c"hwloc",
        (false, true, true) => c"hwloc tiff",
        (true, false, false) => c"hdf5",
        (true, false, true) => c"hdf5 tiff",
        (true, true, false) => c"hdf5 hwloc",
        (true, true, true) => c"hdf5 hwloc tiff",
    }
    .as_ptr()
}

/// The name of a status code, such as "LAPD_ERROR_IO"; "LAPD_UNKNOWN_STATUS" for a number that is
/// none.
///
/// The string is static. May be called from any thread.
#[unsafe(no_mangle)]
pub extern "C" fn lapd_status_name(status: i32) -> *const c_char {
    let unknown = c"LAPD_UNKNOWN_STATUS";
    value_or(unknown, || lapd_status::from_number(status).map_or(unknown, lapd_status::name))
        .as_ptr()
}

/// What a status code means, in one line; "unknown status" for a number that is none.
/// lapd_context_last_error() says more about the call that failed.
///
/// The string is static. May be called from any thread.
#[unsafe(no_mangle)]
pub extern "C" fn lapd_status_message(status: i32) -> *const c_char {
    let unknown = c"unknown status";
    value_or(unknown, || lapd_status::from_number(status).map_or(unknown, lapd_status::message))
        .as_ptr()
}
