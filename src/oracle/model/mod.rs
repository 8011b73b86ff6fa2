//! What the interfaces are: the label of each point of a cell, from what its corners have.
//!
//! | file | what it is |
//! |---|---|
//! | `voxel` | the record of a voxel and of the cell that begins with it |
//! | `cells` | sets of cells as bits |
//! | `indicator` | the indicators of labels, interpolated in a cell |
//! | `contacts` | cells where parts of one label meet in an edge or a corner only |
//! | `weights` | the weights of labels, which keep their volumes |
//! | `field` | other values than indicators: intensities, probabilities, smoothed labels |
//! | `mixtures` | the labels near a voxel and their values |
//! | `smoothing` | labels convolved with a Gaussian |
//! | `border` | how the object is closed where the image ends |

pub(crate) mod border;
pub(crate) mod cells;
pub(crate) mod contacts;
pub(crate) mod field;
pub(crate) mod indicator;
mod mixtures;
mod smoothing;
pub(crate) mod voxel;
pub(crate) mod weights;
