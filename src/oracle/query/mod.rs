//! Questions about the interfaces.
//!
//! | file | what it is |
//! |---|---|
//! | `labels` | the label of a point, and a bound of its distance to all interfaces |
//! | `crossing` | where a segment first crosses an interface |
//! | `estimate` | how many tets a mesh may have |

mod crossing;
mod estimate;
mod labels;
