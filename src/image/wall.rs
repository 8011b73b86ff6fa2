//! The six faces of the image's box.

/// A face of the image's box, where the image cuts the object off; `x`, `y`, `z` are the axes of
/// the image, and `Min` is the face of the voxels with the smallest indices.
///
/// Its numbers are those of the C interface.
#[repr(u8)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Wall {
    /// None of them.
    #[default]
    None = 0,
    /// In front of the first voxels along x.
    XMin = 1,
    /// Behind the last voxels along x.
    XMax = 2,
    /// In front of the first voxels along y.
    YMin = 3,
    /// Behind the last voxels along y.
    YMax = 4,
    /// In front of the first voxels along z.
    ZMin = 5,
    /// Behind the last voxels along z.
    ZMax = 6,
}

impl Wall {
    /// The faces, each axis with its two.
    pub const OF_AXES: [[Self; 2]; 3] =
        [[Self::XMin, Self::XMax], [Self::YMin, Self::YMax], [Self::ZMin, Self::ZMax]];

    /// As files name it; `None` for none.
    pub fn name(self) -> Option<&'static str> {
        match self {
            Self::None => None,
            Self::XMin => Some("wall_x_min"),
            Self::XMax => Some("wall_x_max"),
            Self::YMin => Some("wall_y_min"),
            Self::YMax => Some("wall_y_max"),
            Self::ZMin => Some("wall_z_min"),
            Self::ZMax => Some("wall_z_max"),
        }
    }
}
