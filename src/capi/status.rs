//! Status codes.

use std::ffi::CStr;

use crate::Error;

/// What a function came to. The numbers are stable: none will ever change its meaning, new ones may
/// be added. 0 is success.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_status {
    /// The function did what it says.
    LAPD_OK = 0,
    /// An argument is NULL, out of its range, or not a value of its enum.
    LAPD_ERROR_INVALID_ARGUMENT = 1,
    /// The value exists in this interface, but not yet in this version of the library, in this
    /// build, or on this system.
    LAPD_ERROR_UNSUPPORTED = 2,
    /// A file could not be opened, read or written.
    LAPD_ERROR_IO = 3,
    /// A file was read, but it holds no valid image of its format, or uses what this version does
    /// not read.
    LAPD_ERROR_FORMAT = 4,
    /// The image holds no label to mesh.
    LAPD_ERROR_EMPTY_IMAGE = 5,
    /// The caller's limit of vertices was reached, or one of the library's own: that of the ids, or
    /// of what a file format can number.
    LAPD_ERROR_LIMIT_REACHED = 6,
    /// The run was cancelled by its progress callback or by lapd_context_cancel.
    LAPD_ERROR_CANCELLED = 7,
    /// Memory could not be had.
    LAPD_ERROR_OUT_OF_MEMORY = 8,
    /// An invariant of the library broke. This is a bug of lapd, please report it.
    LAPD_ERROR_INTERNAL = 9,
    /// The caller's buffer is too small for the copy. Nothing was written.
    LAPD_ERROR_BUFFER_TOO_SMALL = 10,
    /// The context is in use by a run that has not returned yet.
    LAPD_ERROR_BUSY = 11,
    /// The caller's limit of time was reached.
    LAPD_ERROR_TIME_LIMIT = 12,
    /// The caller's limit of memory was reached.
    LAPD_ERROR_MEMORY_LIMIT = 13,
    /// The mesh has no certificate: nothing was measured on it.
    LAPD_ERROR_NOT_MEASURED = 14,
}

use lapd_status::*;

const ALL: [lapd_status; 15] = [
    LAPD_OK,
    LAPD_ERROR_INVALID_ARGUMENT,
    LAPD_ERROR_UNSUPPORTED,
    LAPD_ERROR_IO,
    LAPD_ERROR_FORMAT,
    LAPD_ERROR_EMPTY_IMAGE,
    LAPD_ERROR_LIMIT_REACHED,
    LAPD_ERROR_CANCELLED,
    LAPD_ERROR_OUT_OF_MEMORY,
    LAPD_ERROR_INTERNAL,
    LAPD_ERROR_BUFFER_TOO_SMALL,
    LAPD_ERROR_BUSY,
    LAPD_ERROR_TIME_LIMIT,
    LAPD_ERROR_MEMORY_LIMIT,
    LAPD_ERROR_NOT_MEASURED,
];

impl lapd_status {
    pub(super) fn from_number(number: i32) -> Option<Self> {
        ALL.into_iter().find(|&status| status as i32 == number)
    }

    pub(super) fn name(self) -> &'static CStr {
        match self {
            LAPD_OK => c"LAPD_OK",
            LAPD_ERROR_INVALID_ARGUMENT => c"LAPD_ERROR_INVALID_ARGUMENT",
            LAPD_ERROR_UNSUPPORTED => c"LAPD_ERROR_UNSUPPORTED",
            LAPD_ERROR_IO => c"LAPD_ERROR_IO",
            LAPD_ERROR_FORMAT => c"LAPD_ERROR_FORMAT",
            LAPD_ERROR_EMPTY_IMAGE => c"LAPD_ERROR_EMPTY_IMAGE",
            LAPD_ERROR_LIMIT_REACHED => c"LAPD_ERROR_LIMIT_REACHED",
            LAPD_ERROR_CANCELLED => c"LAPD_ERROR_CANCELLED",
            LAPD_ERROR_OUT_OF_MEMORY => c"LAPD_ERROR_OUT_OF_MEMORY",
            LAPD_ERROR_INTERNAL => c"LAPD_ERROR_INTERNAL",
            LAPD_ERROR_BUFFER_TOO_SMALL => c"LAPD_ERROR_BUFFER_TOO_SMALL",
            LAPD_ERROR_BUSY => c"LAPD_ERROR_BUSY",
            LAPD_ERROR_TIME_LIMIT => c"LAPD_ERROR_TIME_LIMIT",
            LAPD_ERROR_MEMORY_LIMIT => c"LAPD_ERROR_MEMORY_LIMIT",
            LAPD_ERROR_NOT_MEASURED => c"LAPD_ERROR_NOT_MEASURED",
        }
    }

    pub(super) fn message(self) -> &'static CStr {
        match self {
            LAPD_OK => c"success",
            LAPD_ERROR_INVALID_ARGUMENT => {
                c"an argument is NULL, out of its range, or not a value of its enum"
            }
            LAPD_ERROR_UNSUPPORTED => c"not supported by this version of lapd",
            LAPD_ERROR_IO => c"a file could not be opened, read or written",
            LAPD_ERROR_FORMAT => {
                c"the file holds no valid image of its format, or one that lapd does not read"
            }
            LAPD_ERROR_EMPTY_IMAGE => c"the image holds no label to mesh",
            LAPD_ERROR_LIMIT_REACHED => {
                c"the limit of vertices, or one of the library's own, was reached"
            }
            LAPD_ERROR_CANCELLED => c"cancelled",
            LAPD_ERROR_OUT_OF_MEMORY => c"out of memory",
            LAPD_ERROR_INTERNAL => c"an invariant broke; this is a bug of lapd",
            LAPD_ERROR_BUFFER_TOO_SMALL => c"the buffer is too small for the copy",
            LAPD_ERROR_BUSY => c"the context is in use by a run that has not returned yet",
            LAPD_ERROR_TIME_LIMIT => c"the limit of time was reached",
            LAPD_ERROR_MEMORY_LIMIT => c"the limit of memory was reached",
            LAPD_ERROR_NOT_MEASURED => c"nothing was measured on the mesh: it has no certificate",
        }
    }
}

impl From<&Error> for lapd_status {
    fn from(error: &Error) -> Self {
        match error {
            Error::InvalidArgument(_) => LAPD_ERROR_INVALID_ARGUMENT,
            Error::Unsupported(_) => LAPD_ERROR_UNSUPPORTED,
            Error::Io { .. } => LAPD_ERROR_IO,
            Error::Format { .. } => LAPD_ERROR_FORMAT,
            Error::EmptyImage => LAPD_ERROR_EMPTY_IMAGE,
            Error::LimitReached(_) => LAPD_ERROR_LIMIT_REACHED,
            Error::TimeLimit(_) => LAPD_ERROR_TIME_LIMIT,
            Error::MemoryLimit(_) => LAPD_ERROR_MEMORY_LIMIT,
            Error::Cancelled => LAPD_ERROR_CANCELLED,
            Error::OutOfMemory { .. } => LAPD_ERROR_OUT_OF_MEMORY,
            Error::Internal(_) => LAPD_ERROR_INTERNAL,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_names_and_messages_are_complete() {
        for (number, status) in ALL.into_iter().enumerate() {
            assert_eq!(status as usize, number);
            assert_eq!(status.name().to_str().unwrap(), format!("{status:?}"));
            assert!(!status.message().is_empty());
        }
        assert_eq!(lapd_status::from_number(-1), None);
        assert_eq!(lapd_status::from_number(ALL.len() as i32), None);
    }
}
