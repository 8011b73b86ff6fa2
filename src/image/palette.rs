//! What differs from cell to cell of the region, and is one of a few: the spacing of samples, and
//! what follows from it.

/// One of a few things for each cell; the same for all, where there is but one.
pub struct Palette<'a, T> {
    things: Vec<T>,
    /// Which one each cell has, as the voxels that cells begin with lie in memory.
    levels: Option<&'a [u8]>,
}

impl<'a, T> Palette<'a, T> {
    /// One thing for all cells.
    pub fn uniform(thing: T) -> Self {
        Self { things: vec![thing], levels: None }
    }

    /// The thing of each cell by its level. There is a thing for every level that occurs; `levels`
    /// are in the bricks of the region of the oracle that is asked about these cells.
    pub fn of_levels(things: Vec<T>, levels: &'a [u8]) -> Self {
        Self { things, levels: Some(levels) }
    }

    /// What follows from each thing.
    pub fn map<U>(&self, follows: impl Fn(&T) -> U) -> Palette<'a, U> {
        Palette { things: self.things.iter().map(follows).collect(), levels: self.levels }
    }

    /// That of the cell from the voxel at this address on.
    #[inline(always)]
    pub(crate) fn at(&self, address: usize) -> &T {
        &self.things[self.levels.map_or(0, |levels| usize::from(levels[address]))]
    }
}
