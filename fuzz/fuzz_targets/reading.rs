//! What the targets of readers share.

use std::cell::OnceCell;

use lapd::image::LabelImage;
use lapd::io::read::values::read_gray;
use lapd::io::read::{LabelValues, ReadOptions, WorldFrame, read_image_with};

thread_local! {
    /// A folder in memory where there is one.
    static FOLDER: OnceCell<tempfile::TempDir> = const { OnceCell::new() };
}

/// Reads `data` as a file of that name ending: as labels in all three ways, and as a scan. Whatever
/// it holds, a reader gives the whole image or one error of one line.
pub fn read(ending: &str, data: &[u8]) {
    FOLDER.with(|folder| {
        let folder = folder.get_or_init(|| {
            tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap()
        });
        let path = folder.path().join(format!("image.{ending}"));
        std::fs::write(&path, data).unwrap();
        for values in [LabelValues::Whole, LabelValues::Rounded, LabelValues::Distinct] {
            let options = ReadOptions { world: WorldFrame::Ras, values, ..ReadOptions::default() };
            match read_image_with(&path, &options, &|_| Ok(())) {
                Ok(read) => {
                    check(&read.image);
                    assert!(read.warnings.iter().all(|line| !line.contains('\n')));
                }
                Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
            }
        }
        if let Ok(read) = read_gray(&path, &ReadOptions::default(), &|_| Ok(())) {
            let _ = format!("{:?}", read.warnings);
        }
    });
}

/// An image is whole: an id for each voxel, a label for each id, a finite frame.
fn check(image: &LabelImage) {
    let [nx, ny, nz] = image.dims();
    assert_eq!(image.ids().len(), nx * ny * nz);
    assert!(image.ids().iter().all(|&id| usize::from(id) < image.labels().len()));
    assert_eq!(image.labels()[0], 0);
    assert!(image.frame().spacing().min_element() > 0.0 && image.frame().origin().is_finite());
}
