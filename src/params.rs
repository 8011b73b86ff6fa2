//! What a run is asked for: sizes, quality bounds, the surface model. All lengths are in the
//! image's world units (mm for medical images).

use std::collections::BTreeMap;

use crate::parallel::machine::Machine;
pub use crate::parallel::policy::{Begging, Contention};
use crate::{Error, Result};

/// How labels between voxel centres are decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum SurfaceModel {
    /// For label images: the label whose indicator, interpolated trilinearly between the eight
    /// voxel centres around the point and multiplied by a weight of the label, is largest. The
    /// weights, from 2/3 to 1.5, are chosen such that each label has the volume of its voxels:
    /// interpolation alone shrinks thin convex labels by some percent. For images made of
    /// intensities or probabilities these are interpolated instead, without weights.
    #[default]
    Smooth,
    /// The label of the voxel that holds the point: interfaces are voxel faces.
    Voxel,
}

/// How the object is closed where it reaches the border of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ImageBorder {
    /// By flat walls, the outer faces of the outermost voxels, with sharp edges.
    #[default]
    Flat,
    /// As if one more layer of background lay around the image: by the smooth surface of
    /// [`SurfaceModel::Smooth`]. The same as [`ImageBorder::Flat`] in [`SurfaceModel::Voxel`].
    Smooth,
}

impl ImageBorder {
    /// Whether the object ends with flat walls where the image does.
    pub fn has_walls(self, model: SurfaceModel) -> bool {
        (self, model) != (Self::Smooth, SurfaceModel::Smooth)
    }
}

/// How the work is shared by threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Algorithm {
    /// All threads refine one triangulation, each where it comes to.
    #[default]
    Podm,
    /// The threads of each memory node refine a region of their own, of the same triangulation. On
    /// a machine of one memory node the same as [`Algorithm::Podm`].
    Lapd,
}

/// What is sampled more densely than delta.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Adaptive {
    /// Nothing.
    Off,
    /// Components and layers of a label that are thinner than 4/3 delta. What holds cubes of 32
    /// times the smallest side of a voxel is not looked at: it counts as thick whatever delta is.
    Thickness,
    /// Places where the mesh turns out to differ from the image in what is connected: where labels
    /// are torn or merged, have a hole too many or too few. And those where it ends before a wall
    /// that the object reaches. What is left of holes is mended with
    /// [`Improve::Full`]: a few tets get another label.
    #[default]
    Topology,
}

/// What may be changed to remove slivers from the refined mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Improve {
    /// Nothing: the mesh is as refinement leaves it, Delaunay and with slivers.
    None,
    /// What lies inside of the labels; their interfaces stay bit for bit.
    Interior,
    /// Interfaces, too: facets are flipped, and vertices move along what they belong to.
    #[default]
    Full,
}

/// What is measured on the finished mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum CertificateLevel {
    /// Nothing.
    None,
    /// All that is exact, and the shapes of tets: Delaunay and orientation, closed interfaces,
    /// rules that stay unmet, volumes, components with what became of them, Euler numbers, defects,
    /// quality.
    #[default]
    Sound,
    /// That, and the distances between mesh and image, in both directions.
    Full,
}

/// Largest value of [`MeshParams::target_dihedral`], in degrees.
pub const MAX_TARGET_DIHEDRAL: f64 = 30.0;

/// Largest value of [`MeshParams::coarsen`], in degrees.
pub const MAX_COARSEN: f64 = 30.0;

/// Largest value of [`MeshParams::across`].
pub const MAX_ACROSS: f64 = 100.0;

/// Largest standard deviation of [`MeshParams::sigma`].
pub const MAX_SIGMA: f64 = 5.0;

/// Most tets of a mesh that may be asked for: more than a triangulation can number.
pub const MAX_TARGET_TETS: u64 = u32::MAX as u64;

/// Most threads of a run.
pub const MAX_THREADS: usize = 254;

/// Parameters of one run.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshParams {
    /// Sample spacing on the interfaces; > 0.
    pub delta: f64,
    /// What is sampled more densely than delta, and its surroundings too, ever less so farther
    /// away.
    pub adaptive: Adaptive,
    /// No spacing of such samples is less than this times the smallest side of a voxel, but delta
    /// itself may be; > 0. With [`Adaptive::Thickness`] none is less than 0.9 sides anyway, nor
    /// than 0.75 about contacts.
    pub spacing_floor: f64,
    /// Components of a label (after merging, of voxels joined with all 26 around them) of fewer
    /// voxels than this are not meshed: they become a part of the label around them, and the report
    /// lists them. 0 or 1: all are meshed, as far as the floor of the spacing allows.
    pub min_voxels: u64,
    /// Upper bound on the circumradius of tets, where no label has its own; > 0. Samples are no
    /// farther apart than 0.7 of it: a larger delta is lowered to that.
    pub size: f64,
    /// Bounds for single labels (after merging), overriding `size`; delta is lowered around these
    /// labels likewise.
    pub label_sizes: BTreeMap<i32, f64>,
    /// So many elements, or more, across each layer of a label; 1 to [`MAX_ACROSS`]. Where it is t
    /// thick the edges of tets are t over this long on average: circumradii are at most 0.85 of
    /// that. What holds cubes of 32 times the smallest side of a voxel counts as thick. `None`:
    /// thickness does not matter for the sizes of tets.
    pub across: Option<f64>,
    /// No layer makes that bound smaller than this; at least 0. Nor does any make it smaller than
    /// the spacing floor over 0.7: by default 0.71 times the smallest side of a voxel.
    pub least_size: f64,
    /// By how much that bound grows per distance from a layer; > 0.
    pub gradation: f64,
    /// The tets of labels that the mesh is to have, within a tenth where that can be had. Delta,
    /// the sizes (the bounds of `across` and `least_size` too) and, above 1, the spacing floor are
    /// multiplied by one factor, which is searched.
    pub target_tets: Option<u64>,
    /// Upper bound on circumradius over shortest edge; at least 2 (below, Delaunay refinement need
    /// not end).
    pub radius_edge: f64,
    /// Lower bound on the planar angles of interface facets, in degrees; 0 to 30 (above, refinement
    /// need not end).
    pub facet_angle: f64,
    /// What may be changed to remove slivers.
    pub improve: Improve,
    /// Tets with a dihedral angle below this, or above 180 less this, are improved; in degrees,
    /// above 0 and at most [`MAX_TARGET_DIHEDRAL`].
    pub target_dihedral: f64,
    /// Make the refined mesh coarser where that changes nothing in what is connected: edges are
    /// contracted as long as tets and samples stay within `size` and `delta`, and interface facets
    /// keep planar angles of so many degrees, above 0 and at most [`MAX_COARSEN`]. Needs
    /// [`Improve::Full`]. `None`: the mesh stays as refinement made it.
    pub coarsen: Option<f64>,
    /// What is measured on the finished mesh.
    pub certificate: CertificateLevel,
    /// The order of tets: 1 for four nodes each, 2 for ten, one more in the middle of each edge.
    pub order: u32,
    /// Put the nodes in the middle of the edges of interface facets on the interfaces of the image,
    /// as far as tets stay valid. Needs order 2.
    pub curved: bool,
    /// The surface model.
    pub surface: SurfaceModel,
    /// Smooth the labels of a coarse segmentation first: the standard deviation of a Gaussian, in
    /// voxels along each axis of the image; 0 to [`MAX_SIGMA`], 0 for none. Voxels keep the labels
    /// of their centres, so that nothing thin or small is lost. For label images and the smooth
    /// model only.
    pub sigma: f64,
    /// How the object is closed at the border of the image.
    pub border: ImageBorder,
    /// Before all else each of these labels becomes another one, all at once. Label 0 may be
    /// either.
    pub merge: BTreeMap<i32, i32>,
    /// The label, after merging, that counts as background; it becomes 0. Where it is another than
    /// 0, no voxel may have label 0.
    pub background_label: i32,
    /// When not empty, only these labels (after merging) are meshed; all others count as
    /// background.
    pub keep: Vec<i32>,
    /// Keep the whole triangulation: tets outside the object get label 0.
    pub background: bool,
    /// Threads that refine, 1 to [`MAX_THREADS`]. One thread makes the same mesh in every run;
    /// several do not.
    pub threads: usize,
    /// How the work is shared.
    pub algorithm: Algorithm,
    /// Count the tets and vertices that each thread's operations visit, by the distance of the
    /// memory node where they are.
    pub count_accesses: bool,
    /// What threads do after conflicts.
    pub contention: Contention,
    /// Whom threads without work ask.
    pub begging: Begging,
    /// The machine that the threads are taken to run on, for [`Algorithm::Lapd`] and
    /// [`Begging::ByLevel`]; `None` is the one at hand, [`Machine::of_system`].
    pub machine: Option<Machine>,
    /// Bind each thread that refines to a core of its own, of those that the calling thread may
    /// use; more threads than cores share them. The calling thread's own affinity is as before when
    /// the run ends. Needs Linux.
    pub bind: bool,
    /// Keep for each thread what it did when.
    pub timeline: bool,
    /// End the refinement with [`Error::LimitReached`] when it needs more vertices than this;
    /// `None` is no limit of the caller's.
    pub max_vertices: Option<usize>,
    /// End the run with [`Error::TimeLimit`] when it has taken this many wall-clock seconds; > 0.
    /// Collecting the mesh and adding nodes of second order are not cut short.
    pub time_limit: Option<f64>,
    /// End the refinement with [`Error::MemoryLimit`] when the run's tables, those of the mesh to
    /// come included, would need more bytes than this.
    pub max_memory: Option<u64>,
    /// A limit that ends the run is no error: the mesh is made of what there is, and measured as
    /// far as the limit allows.
    pub partial: bool,
}

impl Default for MeshParams {
    fn default() -> Self {
        Self {
            delta: 1.0,
            adaptive: Adaptive::default(),
            spacing_floor: 0.5,
            min_voxels: 0,
            size: 2.0,
            label_sizes: BTreeMap::new(),
            across: None,
            least_size: 0.0,
            gradation: 0.4,
            target_tets: None,
            radius_edge: 2.0,
            facet_angle: 30.0,
            improve: Improve::Full,
            target_dihedral: 15.0,
            coarsen: None,
            certificate: CertificateLevel::Sound,
            order: 1,
            curved: false,
            surface: SurfaceModel::Smooth,
            sigma: 0.0,
            border: ImageBorder::Flat,
            merge: BTreeMap::new(),
            background_label: 0,
            keep: Vec::new(),
            background: false,
            threads: 1,
            algorithm: Algorithm::Podm,
            count_accesses: false,
            contention: Contention::Local,
            begging: Begging::ByLevel,
            machine: None,
            bind: false,
            timeline: false,
            max_vertices: None,
            time_limit: None,
            max_memory: None,
            partial: false,
        }
    }
}

/// # Errors
/// [`Error::InvalidArgument`], naming the parameter and its value.
fn positive(name: &str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(Error::InvalidArgument(format!("{name} must be a finite number above 0, got {value}")))
    }
}

/// Checks the range of a single label's size.
///
/// # Errors
/// [`Error::InvalidArgument`], naming the label and the size.
pub fn check_label_size(label: i32, size: f64) -> Result<()> {
    // Named where it is wrong only: there may be many of them.
    if size.is_finite() && size > 0.0 {
        return Ok(());
    }
    positive(&format!("size of label {label}"), size)
}

/// Where delta is less than so many smallest sides of a voxel all differences from the image count.
const ALL_COUNT_BELOW: f64 = 2.0;

impl MeshParams {
    /// Checks every range.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] or [`Error::Unsupported`], naming the parameter and its value.
    pub fn validate(&self) -> Result<()> {
        positive("delta", self.delta)?;
        positive("spacing floor", self.spacing_floor)?;
        positive("size", self.size)?;
        self.label_sizes.iter().try_for_each(|(&label, &size)| check_label_size(label, size))?;
        if let Some(across) = self.across.filter(|n| !(1.0..=MAX_ACROSS).contains(n)) {
            return Err(Error::InvalidArgument(format!(
                "elements across a layer must lie in 1 to {MAX_ACROSS}, got {across}"
            )));
        }
        if !(self.least_size.is_finite() && self.least_size >= 0.0) {
            return Err(Error::InvalidArgument(format!(
                "least size must be a finite number of at least 0, got {}",
                self.least_size
            )));
        }
        positive("gradation", self.gradation)?;
        if let Some(tets) = self.target_tets.filter(|tets| !(1..=MAX_TARGET_TETS).contains(tets)) {
            return Err(Error::InvalidArgument(format!(
                "target tets must lie in 1 to {MAX_TARGET_TETS}, got {tets}"
            )));
        }
        if !(self.radius_edge.is_finite() && self.radius_edge >= 2.0) {
            return Err(Error::InvalidArgument(format!(
                "radius-edge bound must be at least 2, got {}",
                self.radius_edge
            )));
        }
        if !(0.0..=30.0).contains(&self.facet_angle) {
            return Err(Error::InvalidArgument(format!(
                "facet angle must lie in 0 to 30 degrees, got {}",
                self.facet_angle
            )));
        }
        if !(self.target_dihedral > 0.0 && self.target_dihedral <= MAX_TARGET_DIHEDRAL) {
            return Err(Error::InvalidArgument(format!(
                "target dihedral angle must lie above 0 and not above {MAX_TARGET_DIHEDRAL} \
                 degrees, got {}",
                self.target_dihedral
            )));
        }
        if let Some(degrees) = self.coarsen.filter(|d| !(*d > 0.0 && *d <= MAX_COARSEN)) {
            return Err(Error::InvalidArgument(format!(
                "coarsening keeps facet angles above 0 and not above {MAX_COARSEN} degrees, got \
                 {degrees}"
            )));
        }
        if !(1..=2).contains(&self.order) {
            return Err(Error::InvalidArgument(format!(
                "order must be 1 or 2, got {}",
                self.order
            )));
        }
        if !(0.0..=MAX_SIGMA).contains(&self.sigma) {
            return Err(Error::InvalidArgument(format!(
                "sigma must lie in 0 to {MAX_SIGMA} voxels, got {}",
                self.sigma
            )));
        }
        if self.sigma > 0.0 && self.surface != SurfaceModel::Smooth {
            return Err(Error::InvalidArgument(format!(
                "sigma {} smooths interfaces, and the voxel model keeps the faces of voxels",
                self.sigma
            )));
        }
        if let Some(seconds) = self.time_limit {
            positive("time limit", seconds)?;
        }
        if !(1..=MAX_THREADS).contains(&self.threads) {
            return Err(Error::InvalidArgument(format!(
                "threads must lie in 1 to {MAX_THREADS}, got {}",
                self.threads
            )));
        }
        Ok(())
    }

    /// Whether all differences from the image take samples with [`Adaptive::Topology`], where this
    /// is the smallest side of a voxel: where delta is less than two such sides.
    pub(crate) fn all_differences_count(&self, side: f64) -> bool {
        self.delta < ALL_COUNT_BELOW * side
    }

    /// The largest circumradius of a label's tets.
    pub fn size_of(&self, label: i32) -> f64 {
        self.label_sizes.get(&label).copied().unwrap_or(self.size)
    }

    /// The same with all lengths that decide how many tets there are multiplied by `factor`: delta,
    /// the sizes, and the spacing floor where that makes it larger. A finer mesh is no reason to
    /// look for structure that the voxels do not have. Where the mesh is coarsened the floor stays:
    /// it does not decide how many tets there are in the end.
    pub fn scaled(&self, factor: f64) -> Self {
        let mut scaled = self.clone();
        scaled.delta *= factor;
        scaled.size *= factor;
        scaled.label_sizes.values_mut().for_each(|size| *size *= factor);
        scaled.across = scaled.across.map(|across| across / factor);
        scaled.least_size *= factor;
        if self.coarsen.is_none() {
            scaled.spacing_floor *= factor.max(1.0);
        }
        scaled
    }

    /// Checks what must hold between parameters. Not a part of [`Self::validate`]: whoever sets
    /// them one by one may set either first.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`].
    pub fn validate_together(&self) -> Result<()> {
        if self.curved && self.order != 2 {
            return Err(Error::InvalidArgument(format!(
                "curved tets need order 2, got {}",
                self.order
            )));
        }
        if self.coarsen.is_some() && self.improve != Improve::Full {
            return Err(Error::InvalidArgument(
                "coarsening needs improvement full: it makes slivers, and changes interfaces"
                    .to_owned(),
            ));
        }
        Ok(())
    }
}
