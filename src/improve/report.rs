//! What improvement did, and what it left.

/// What is counted while a mesh is improved.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Counts {
    /// Edges removed inside of a label.
    pub edge_removals: u64,
    /// Edges flipped on an interface.
    pub interface_flips: u64,
    /// Moves of vertices inside of a label.
    pub moves_inside: u64,
    /// Moves of vertices on an interface between two labels, and in walls.
    pub moves_on_interfaces: u64,
    /// Moves of vertices of lines and corners, where three labels or more meet.
    pub moves_on_junctions: u64,
    /// Edges split.
    pub splits: u64,
    /// Edges contracted.
    pub contractions: u64,
    /// The largest distance between an interface edge and the one that replaced it.
    pub max_flip: f64,
    /// The largest distance of a moved vertex on an interface from where refinement put the
    /// interface around it; of two that met, from the image's interface.
    pub max_interface_move: f64,
    /// By how much the volume of labels grew, in the order in which they were changed first.
    pub volumes: Vec<(i32, f64)>,
}

impl Counts {
    /// Adds to the volume of a label.
    pub(super) fn add_volume(&mut self, label: i32, volume: f64) {
        match self.volumes.iter_mut().find(|(of, _)| *of == label) {
            Some((_, sum)) => *sum += volume,
            None => self.volumes.push((label, volume)),
        }
    }

    /// By how much the volume of a label grew.
    pub fn volume_of(&self, label: i32) -> f64 {
        self.volumes.iter().find(|(of, _)| *of == label).map_or(0.0, |(_, volume)| *volume)
    }

    /// Adds what another block counted.
    pub(super) fn add(&mut self, other: &Self) {
        self.edge_removals += other.edge_removals;
        self.interface_flips += other.interface_flips;
        self.moves_inside += other.moves_inside;
        self.moves_on_interfaces += other.moves_on_interfaces;
        self.moves_on_junctions += other.moves_on_junctions;
        self.splits += other.splits;
        self.contractions += other.contractions;
        self.max_flip = self.max_flip.max(other.max_flip);
        self.max_interface_move = self.max_interface_move.max(other.max_interface_move);
        other.volumes.iter().for_each(|&(label, volume)| self.add_volume(label, volume));
    }

    /// How many operations were carried out to improve tets.
    pub fn operations(&self) -> u64 {
        let moves = self.moves_inside + self.moves_on_interfaces + self.moves_on_junctions;
        self.edge_removals + self.interface_flips + moves + self.splits
    }
}

/// Why a tet is left below the target: what its vertices belong to, the first of these that one
/// belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// A contact of voxels, where a boundary touches itself, is within a voxel.
    Contact,
    /// A wall, where the image cuts the object off.
    Wall,
    /// A line or corner where three labels or more meet.
    Junction,
    /// An interface between two labels.
    Interface,
    /// The inside of a label.
    Inside,
}

/// A tet that is left below the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Left {
    /// Its index in the mesh.
    pub tet: u32,
    /// Its centroid, in world coordinates.
    pub position: [f64; 3],
    /// Its smallest and its largest dihedral angle, in degrees.
    pub angles: [f64; 2],
    /// What is in the way.
    pub cause: Cause,
}

/// What improvement did. Lengths are in world units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Improvement {
    /// The target in degrees; 0 where nothing was to be improved.
    pub target: f64,
    /// How far interfaces might be moved.
    pub tolerance: f64,
    /// What was counted.
    pub counts: Counts,
    /// Tets of the object below the target before.
    pub below_before: u64,
    /// The tets that are left below it.
    pub left: Vec<Left>,
    /// Rounds of blocks.
    pub rounds: u32,
    /// Facets between tets of the object that are not Delaunay afterwards.
    pub non_delaunay_facets: u64,
    /// Tets of background that became a part of a label where the image cuts it off.
    pub nicks_filled: u64,
    /// Tets that got another label, so that a component has the image's Euler characteristic, or is
    /// joined with a piece that was torn off.
    pub tets_mended: u64,
    /// Tets of the object before it was coarsened; 0 where it was not.
    pub tets_before: u64,
    /// Interface facets with an angle below what refinement was asked for. It leaves a few where
    /// the image cuts the object off; others come of mending and of coarsening.
    pub facets_below: u64,
    /// The largest distance of a vertex from where refinement put it, or where two met on the
    /// image's interface or line; those inside of labels may move far.
    pub max_move: f64,
}

impl Improvement {
    /// Adds what was done to the mesh before.
    pub fn add_earlier(&mut self, earlier: &Self) {
        let mut counts = earlier.counts.clone();
        counts.add(&self.counts);
        self.counts = counts;
        self.below_before = earlier.below_before;
        self.tets_before = earlier.tets_before;
        self.rounds += earlier.rounds;
        self.max_move = self.max_move.max(earlier.max_move);
    }

    /// Adds tets that went from one label to another, with their volumes.
    pub fn add_mended(&mut self, mended: impl Iterator<Item = (i32, i32, f64)>) {
        for (from, to, volume) in mended {
            self.tets_mended += 1;
            let grown = [(from, -volume), (to, volume)];
            grown.into_iter().filter(|(label, _)| *label != 0).for_each(|(label, volume)| {
                self.counts.add_volume(label, volume);
            });
        }
    }

    /// Adds nicks that were filled, by label and volume.
    pub fn add_filled(&mut self, filled: &[(i32, f64)]) {
        self.nicks_filled += filled.len() as u64;
        filled.iter().for_each(|&(label, volume)| self.counts.add_volume(label, volume));
    }
}
