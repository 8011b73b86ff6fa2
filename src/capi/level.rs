//! What is measured on the finished mesh.

use super::context::lapd_context;
use super::params::{change, lapd_params, read, unknown};
use super::status::lapd_status;
use crate::params::CertificateLevel;

/// What is measured on the finished mesh.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum lapd_certificate_level {
    /// Nothing. Functions that tell of it return LAPD_ERROR_NOT_MEASURED.
    LAPD_CERTIFICATE_NONE = 0,
    /// All that is exact, and the shapes of tets: Delaunay and orientation, closed interfaces,
    /// rules that stay unmet, volumes, components with what became of them, Euler numbers, defects,
    /// quality. The default.
    LAPD_CERTIFICATE_SOUND = 1,
    /// That, and the distances between mesh and image, in both directions, which take about half
    /// as long as the refinement.
    LAPD_CERTIFICATE_FULL = 2,
}

use lapd_certificate_level::*;

impl From<CertificateLevel> for lapd_certificate_level {
    fn from(level: CertificateLevel) -> Self {
        match level {
            CertificateLevel::None => Self::LAPD_CERTIFICATE_NONE,
            CertificateLevel::Sound => Self::LAPD_CERTIFICATE_SOUND,
            CertificateLevel::Full => Self::LAPD_CERTIFICATE_FULL,
        }
    }
}

/// Sets what is measured on the finished mesh, a lapd_certificate_level. What was not measured says
/// so where it is asked for, and is never 0. No other thread may use `params` or the context
/// meanwhile.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is none of the enum.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_set_certificate(
    context: *mut lapd_context,
    params: *mut lapd_params,
    level: i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe {
        change(context, params, |p| {
            p.certificate = match level {
                l if l == LAPD_CERTIFICATE_NONE as i32 => CertificateLevel::None,
                l if l == LAPD_CERTIFICATE_SOUND as i32 => CertificateLevel::Sound,
                l if l == LAPD_CERTIFICATE_FULL as i32 => CertificateLevel::Full,
                _ => return Err(unknown("level", "a lapd_certificate_level", level)),
            };
            Ok(())
        })
    }
}

/// What is measured on the finished mesh, a lapd_certificate_level. Any thread, unless another one
/// changes `params`.
///
/// Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lapd_params_get_certificate(
    params: *const lapd_params,
    level: *mut i32,
) -> lapd_status {
    // SAFETY: see the module's head.
    unsafe { read(params, level, "level", |p| lapd_certificate_level::from(p.certificate) as i32) }
}
