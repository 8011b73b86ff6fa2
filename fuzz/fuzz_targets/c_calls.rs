//! Any calls of the C interface with any values, in the order of a program: parameters, an image
//! from memory, a mesh, its arrays and reports. Nothing panics, statuses are known ones, and a mesh
//! that comes out is sound.
#![no_main]

use std::ffi::CString;
use std::ptr;

use lapd::capi::budget::*;
use lapd::capi::context::*;
use lapd::capi::image::*;
use lapd::capi::labels::*;
use lapd::capi::level::*;
use lapd::capi::mesh::*;
use lapd::capi::params::*;
use lapd::capi::report::*;
use lapd::capi::run::*;
use lapd::capi::status::*;
use lapd::capi::thin::*;
use libfuzzer_sys::fuzz_target;

/// Bytes that are read as values; zeros when they have ended.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn byte(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    fn int(&mut self) -> i32 {
        i32::from_le_bytes([self.byte(), self.byte(), self.byte(), self.byte()])
    }

    /// Often a usual number, sometimes any.
    fn number(&mut self) -> f64 {
        match self.byte() {
            n @ 0..240 => f64::from(n) / 40.0,
            _ => f64::from_bits(u64::from(self.int() as u32) << 32 | u64::from(self.int() as u32)),
        }
    }
}

/// A status that the header knows.
fn known(status: lapd_status) -> bool {
    let status = status as i32;
    assert!((0..=14).contains(&status), "status {status}");
    status == 0
}

/// Sets a parameter that the bytes choose.
unsafe fn set_something(
    bytes: &mut Bytes<'_>,
    context: *mut lapd_context,
    params: *mut lapd_params,
) {
    unsafe {
        let what = bytes.byte() % 22;
        known(match what {
            0 => lapd_params_set_delta(context, params, bytes.number()),
            1 => lapd_params_set_size(context, params, bytes.number()),
            2 => lapd_params_set_label_size(context, params, bytes.int(), bytes.number()),
            3 => lapd_params_set_radius_edge(context, params, bytes.number()),
            4 => lapd_params_set_facet_angle(context, params, 10.0 * bytes.number()),
            5 => lapd_params_set_target_dihedral(context, params, 10.0 * bytes.number()),
            6 => lapd_params_set_merge(context, params, &bytes.int(), 1, bytes.int()),
            7 => lapd_params_set_background_label(context, params, i32::from(bytes.byte() % 4)),
            8 => lapd_params_set_surface(context, params, i32::from(bytes.byte() % 4)),
            9 => lapd_params_set_border(context, params, i32::from(bytes.byte() % 4)),
            10 => lapd_params_set_sigma(context, params, bytes.number()),
            11 => lapd_params_set_adaptive(context, params, i32::from(bytes.byte() % 4)),
            12 => lapd_params_set_order(context, params, i32::from(bytes.byte() % 4)),
            13 => lapd_params_set_improve(context, params, i32::from(bytes.byte() % 4)),
            14 => lapd_params_set_min_voxels(context, params, u64::from(bytes.byte())),
            15 => lapd_params_set_target_tets(context, params, 16 * u64::from(bytes.byte())),
            16 => lapd_params_set_certificate(context, params, i32::from(bytes.byte() % 4)),
            17 => lapd_params_set_coarsen(context, params, 10.0 * bytes.number()),
            18 => lapd_params_set_across(context, params, f64::from(bytes.byte() % 8)),
            19 => lapd_params_set_least_size(context, params, bytes.number()),
            20 => lapd_params_set_gradation(context, params, bytes.number()),
            _ => lapd_params_set_partial(context, params, i32::from(bytes.byte() % 2)),
        });
    }
}

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes(data);
    // SAFETY: the calls of a well-behaved program: handles live until they are freed, and buffers
    // are as large as is said.
    unsafe {
        let (mut context, mut params) = (ptr::null_mut(), ptr::null_mut());
        assert!(known(lapd_context_create(&mut context)) && known(lapd_params_create(&mut params)));
        for _ in 0..bytes.byte() % 8 {
            set_something(&mut bytes, context, params);
        }
        // What is to be found is found in small runs.
        known(lapd_params_set_max_vertices(context, params, 3000));
        known(lapd_params_set_time_limit(context, params, 2.0));
        let dims = [0; 3].map(|_| usize::from(bytes.byte() % 7));
        let spacing = [0; 3].map(|_| bytes.number());
        let origin = [0; 3].map(|_| bytes.number());
        let voxels: Vec<i32> =
            (0..dims.iter().product()).map(|_| i32::from(bytes.byte() % 5)).collect();
        let mut image = ptr::null_mut();
        let status = lapd_image_create(
            context,
            voxels.as_ptr().cast(),
            lapd_voxel_type::LAPD_VOXEL_I32 as i32,
            dims.as_ptr(),
            ptr::null(),
            origin.as_ptr(),
            spacing.as_ptr(),
            ptr::null(),
            &mut image,
        );
        let mut mesh = ptr::null_mut();
        if known(status) {
            known(lapd_mesh_image(context, image, params, &mut mesh));
        }
        if !mesh.is_null() {
            let (mut tets, mut count) = (ptr::null(), 0);
            assert!(known(lapd_mesh_get_tets(mesh, &mut tets, &mut count)) && count > 0);
            let mut certificate: lapd_certificate = std::mem::zeroed();
            certificate.struct_size = size_of::<lapd_certificate>() as u64;
            // Unless nothing was to be measured.
            if known(lapd_mesh_get_certificate(mesh, &mut certificate)) {
                assert_eq!((certificate.inverted_tets, certificate.open_edges), (0, 0));
            }
            let path = CString::new("/dev/null/no-such-folder.json").unwrap();
            assert!(!known(lapd_mesh_write_report(context, mesh, path.as_ptr(), ptr::null())));
        }
        lapd_mesh_free(mesh);
        lapd_image_free(image);
        lapd_params_free(params);
        lapd_context_free(context);
    }
});
