//! What is sampled of the interfaces: where they cross the edges of the grid, the lines and points
//! where several meet, the walls where the image ends.
//!
//! | file | what it is |
//! |---|---|
//! | `edges` | crossings of the interfaces with the edges of the grid and of its subdivisions |
//! | `junctions` | where three labels or more meet, on planes of the grid |
//! | `ties` | points of a cell where several labels are equal |
//! | `walls` | walls, rims and edges where the image cuts the object off |
//! | `tiles` | columns of the region, for passes over places near each other |

pub(crate) mod edges;
pub(crate) mod junctions;
mod ties;
pub(crate) mod tiles;
pub(crate) mod walls;
