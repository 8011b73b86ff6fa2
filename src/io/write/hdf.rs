//! Arrays of HDF5 files, by the HDF5 library: contiguous, not compressed, written in batches into a
//! temporary file that takes its name in the end.

use std::io;
use std::path::Path;

use hdf5_metno as hdf5;
use hdf5_metno::types::FixedAscii;
use hdf5_metno::{Hyperslab, SliceOrIndex};
use ndarray::{ArrayD, IxDyn};

use super::output::Output;
use crate::monitor::CancelFlag;
use crate::{Error, Result};

/// Rows that are handed to HDF5 at once.
const BATCH: usize = 1 << 15;

/// What ends the writing.
pub(super) enum Failure {
    Ours(Error),
    Hdf5(hdf5::Error),
}

impl From<hdf5::Error> for Failure {
    fn from(error: hdf5::Error) -> Self {
        Self::Hdf5(error)
    }
}

/// Makes the file `path`, which has no name yet, of what `fill` writes.
pub(super) fn write_file<'c>(
    path: &Path,
    cancel: Option<&'c CancelFlag>,
    fill: impl FnOnce(&Arrays<'_>) -> std::result::Result<(), Failure>,
) -> Result<Output<'c>> {
    let output = Output::create(path)?.watching(cancel);
    let written = output.by_path(|temporary| {
        let file = hdf5::File::create(temporary)?;
        fill(&Arrays { group: file.as_group()?, cancel })?;
        // Dropping the file would keep its error to itself.
        file.flush()?;
        Ok(file.close()?)
    });
    match written {
        Ok(()) => Ok(output),
        Err(Failure::Ours(error)) => Err(error),
        Err(Failure::Hdf5(error)) => {
            Err(Error::io(path, io::Error::other(said(&error.to_string()))))
        }
    }
}

/// Where arrays go.
pub(super) struct Arrays<'a> {
    group: hdf5::Group,
    cancel: Option<&'a CancelFlag>,
}

impl Arrays<'_> {
    /// A group within this one.
    pub fn within(&self, name: &str) -> std::result::Result<Self, Failure> {
        Ok(Self { group: self.group.create_group(name)?, cancel: self.cancel })
    }

    /// Gives the group an attribute of some numbers.
    pub fn attribute(&self, name: &str, values: &[i64]) -> std::result::Result<(), Failure> {
        let attribute = self.group.new_attr::<i64>().shape(values.len()).create(name)?;
        Ok(attribute.write_raw(values)?)
    }

    /// Gives the group an attribute of `N` ASCII characters.
    pub fn text_attribute<const N: usize>(
        &self,
        name: &str,
        text: &[u8; N],
    ) -> std::result::Result<(), Failure> {
        let text = FixedAscii::<N>::from_ascii(text).map_err(io::Error::other);
        let text = text.map_err(|error| Failure::Ours(Error::io(Path::new(name), error)))?;
        let attribute = self.group.new_attr::<FixedAscii<N>>().create(name)?;
        Ok(attribute.write_scalar(&text)?)
    }

    /// Writes a list of `count` values.
    pub fn list<T: hdf5::H5Type + Copy + Default>(
        &self,
        name: &str,
        count: usize,
        value: impl Fn(usize) -> T,
    ) -> std::result::Result<(), Failure> {
        self.write(name, &[count], |i, row| row[0] = value(i))
    }

    /// Writes an array of `count` rows.
    pub fn rows<T: hdf5::H5Type + Copy + Default>(
        &self,
        name: &str,
        count: usize,
        width: usize,
        fill: impl Fn(usize, &mut [T]),
    ) -> std::result::Result<(), Failure> {
        self.write(name, &[count, width], fill)
    }

    /// Writes an array of one or two axes, row by row.
    fn write<T: hdf5::H5Type + Copy + Default>(
        &self,
        name: &str,
        sizes: &[usize],
        fill: impl Fn(usize, &mut [T]),
    ) -> std::result::Result<(), Failure> {
        let set = self.group.new_dataset::<T>().shape(sizes).create(name)?;
        let (count, width) = (sizes[0], sizes.get(1).copied().unwrap_or(1));
        for start in (0..count).step_by(BATCH) {
            if self.cancel.is_some_and(CancelFlag::is_cancelled) {
                return Err(Failure::Ours(Error::Cancelled));
            }
            let end = count.min(start + BATCH);
            let mut shape = sizes.to_vec();
            shape[0] = end - start;
            let mut batch = ArrayD::<T>::default(IxDyn(&shape));
            let values = batch.as_slice_mut().unwrap_or_default();
            for (row, i) in values.chunks_exact_mut(width.max(1)).zip(start..) {
                fill(i, row);
            }
            let mut places = vec![SliceOrIndex::from(..); sizes.len()];
            places[0] = SliceOrIndex::from(start..end);
            set.write_slice(&batch, Hyperslab::from(places))?;
        }
        Ok(())
    }
}

/// What the system said, where HDF5 tells it among addresses and the names of temporary files.
fn said(message: &str) -> &str {
    let behind = message.split_once("error message = '").map(|(_, behind)| behind);
    behind.and_then(|behind| behind.split_once('\'')).map_or(message, |(said, _)| said)
}
