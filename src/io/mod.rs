//! Files: [`read`] images, [`write`](mod@write) meshes. Each has one table of name endings, which
//! chooses the format.

pub mod read;
pub mod write;
