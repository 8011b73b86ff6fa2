//! What a file's tets and facets belong to, and what that is called.
//!
//! A *region* is the tets of a label. A *boundary* is the facets of two labels; where the image
//! cuts a region off, those on each face of the image's box are a boundary of their own. Where
//! asked for, so is each connected part of a boundary: facets that have an edge in common.
//!
//! | what | name |
//! |---|---|
//! | region | the name of the label, or `label_7`; `background` |
//! | boundary between two regions | `liver__spleen`: the smaller label first, the background last |
//! | boundary on a face of the box | `liver__wall_x_min` |
//! | part of a boundary | `liver__spleen_1`, the largest first |
//!
//! All formats have the same names. They are made of letters, digits, `_` and `-`, begin with a
//! letter, differ in more than upper and lower case, and have at most 80 characters: what the
//! strictest of the formats takes, but for universal files, which have 40 and cut them. Other
//! characters of a label's name become `_`.
//!
//! Memory: next to nothing, since a facet's boundary is looked up by its labels and face of the
//! box; with parts 4 bytes per facet, and some 40 for a while.

use std::collections::{BTreeMap, BTreeSet};
use std::io;

use rayon::prelude::*;

use super::WriteOptions;
use super::groups::{Keyed, distinct};
use crate::Result;
use crate::image::{LabelNames, Wall};
use crate::memory::{filled, room, zeroed};
use crate::mesh::{NONE, TetMesh};
use crate::reduce::UnionFind;

/// The longest name of a label: two of them, and what comes behind, have 80 characters.
const MAX_NAME: usize = 34;

/// The name of what is outside of all regions.
const BACKGROUND: &str = "background";

/// The name of the field of VTU files that tells what the world axes mean.
pub(super) const SPACE: &str = "SPACE";

/// The regions of a mesh, in increasing order of their labels.
pub(super) struct Regions {
    pub labels: Vec<i32>,
    names: BTreeMap<i32, String>,
}

impl Regions {
    pub fn new(mesh: &TetMesh, options: &WriteOptions<'_>) -> Self {
        let labels = distinct(mesh.labels.iter().copied());
        // A mesh of facets alone has labels as well.
        let mut all: BTreeSet<i32> = labels.iter().copied().collect();
        all.extend(distinct(mesh.facet_labels.iter().copied()).into_iter().flatten());
        let names = names_of(all.into_iter(), options.names);
        Self { labels, names }
    }

    /// The name of a label's region.
    pub fn name(&self, label: i32) -> &str {
        self.names.get(&label).map_or(BACKGROUND, |name| name)
    }

    /// The place of a label among those of the regions.
    pub fn place(&self, label: i32) -> usize {
        self.labels.partition_point(|&other| other < label)
    }

    /// A comment line for each region that has another name than that of its label's number.
    pub fn comments(&self) -> String {
        let named = self.iter().filter(|(label, name)| *name != plain_name(*label));
        named.map(|(label, name)| format!("# tets {label}: {name}\n")).collect()
    }

    /// Labels with the names of their regions.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (i32, &str)> {
        self.labels.iter().map(|&label| (label, self.name(label)))
    }
}

/// The name of a label that was given none.
fn plain_name(label: i32) -> String {
    format!("label_{label}")
}

/// Names for labels, all different.
fn names_of(
    labels: impl Iterator<Item = i32>,
    given: Option<&LabelNames>,
) -> BTreeMap<i32, String> {
    let walls = Wall::OF_AXES.into_iter().flatten().filter_map(Wall::name);
    let devices = ["com", "lpt"].into_iter().flat_map(|port| (1..=9).map(move |n| (port, n)));
    let mut taken: BTreeSet<String> = walls
        .chain([BACKGROUND, SPACE])
        // Windows has no files of these names, and files are called by labels, too.
        .chain(["con", "prn", "aux", "nul"])
        .map(str::to_ascii_lowercase)
        .chain(devices.map(|(port, n)| format!("{port}{n}")))
        .collect();
    let mut names = BTreeMap::new();
    for label in labels.filter(|&label| label != 0) {
        let given = given.and_then(|names| names.get(label));
        let mut name = given.map_or_else(|| plain_name(label), |given| usable(&given.name, label));
        if taken.contains(&name.to_ascii_lowercase()) {
            let behind = format!("_{label}");
            name.truncate(MAX_NAME - behind.len());
            name += &behind;
        }
        while !taken.insert(name.to_ascii_lowercase()) {
            name.truncate(MAX_NAME - 1);
            name.insert(0, 'x');
        }
        names.insert(label, name);
    }
    names
}

/// A label's name as all formats take it.
fn usable(name: &str, label: i32) -> String {
    let is_usable = |c: char| c.is_ascii_alphanumeric() || c == '-';
    let parts: Vec<&str> = name.split(|c| !is_usable(c)).filter(|part| !part.is_empty()).collect();
    let mut usable = parts.join("_");
    if !usable.starts_with(|c: char| c.is_ascii_alphabetic()) {
        usable = format!("label_{label}{}{usable}", if usable.is_empty() { "" } else { "_" });
    }
    usable.truncate(MAX_NAME);
    usable
}

/// A boundary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Boundary {
    /// The labels behind and before its facets.
    pub labels: [i32; 2],
    /// The face of the image's box that it lies on.
    pub wall: Wall,
    /// The number of the connected part, from 1; 0 for all parts together.
    pub part: u32,
}

/// The boundaries of a mesh, in increasing order of their labels, faces of the box and parts. Each
/// has a facet, so that facets in groups by their boundaries come in the order of `all`.
pub(super) struct Boundaries<'m> {
    mesh: &'m TetMesh,
    /// The part of each facet, where parts were asked for.
    parts: Option<Vec<u32>>,
    pub all: Vec<Boundary>,
    pub names: Vec<String>,
    /// Of each boundary how many of its facets have no tet before them, and how many have one.
    before: Vec<[usize; 2]>,
}

impl<'m> Boundaries<'m> {
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(mesh: &'m TetMesh, options: &WriteOptions<'_>, regions: &Regions) -> Result<Self> {
        let parts =
            if options.parts { Some(parts(mesh, |f| whole_boundary(mesh, f))?) } else { None };
        let mut found = Self { mesh, parts, all: vec![], names: vec![], before: vec![] };
        let mut sides: BTreeMap<Boundary, [usize; 2]> = BTreeMap::new();
        // Neighbouring facets mostly have the same.
        let mut same = None;
        let mut counts = [0; 2];
        for (f, tets) in mesh.facet_tets.iter().enumerate() {
            let boundary = found.key(f);
            if let Some(last) = same.filter(|&last| last != boundary) {
                add(&mut sides, last, std::mem::take(&mut counts));
            }
            same = Some(boundary);
            counts[usize::from(tets[1] != NONE)] += 1;
        }
        if let Some(last) = same {
            add(&mut sides, last, counts);
        }
        (found.all, found.before) = sides.into_iter().unzip();
        found.names = found.all.iter().map(|boundary| name_of(boundary, regions)).collect();
        Ok(found)
    }

    /// The index of a facet's boundary.
    pub fn of_facet(&self, f: usize) -> usize {
        let boundary = self.key(f);
        self.all.partition_point(|known| *known < boundary)
    }

    /// Whether a boundary is one of a label's region. Of split interfaces each side is a boundary
    /// of one region alone.
    pub fn bounds(&self, boundary: usize, label: i32) -> bool {
        let [first, second] = self.all[boundary].labels;
        first == label || second == label && self.before[boundary][1] > 0
    }

    /// Whether all facets of a boundary have tets on both sides.
    pub fn has_two_sides(&self, boundary: usize) -> bool {
        self.before[boundary][0] == 0
    }

    /// The name of a boundary that there is.
    pub fn name(&self, boundary: &Boundary) -> &str {
        let place = self.all.partition_point(|known| known < boundary);
        self.names.get(place).map_or("", |name| name)
    }

    /// The number of a facet's boundary, from 1.
    pub fn number(&self, f: usize) -> u32 {
        self.of_facet(f) as u32 + 1
    }

    /// The name of a boundary between two regions seen from its second label.
    pub fn reversed_name(&self, boundary: usize, regions: &Regions) -> String {
        let Boundary { labels: [first, second], wall, part } = self.all[boundary];
        name_of(&Boundary { labels: [second, first], wall, part }, regions)
    }

    /// A comment line for each boundary: its number, its labels, its name.
    pub fn comments(&self) -> String {
        let lines = self.all.iter().zip(&self.names).zip(1..);
        let lines = lines.map(|((Boundary { labels: [first, second], .. }, name), number)| {
            format!("# facets {number}: labels {first} {second} {name}\n")
        });
        lines.collect()
    }
}

impl Keyed for Boundaries<'_> {
    type Key = Boundary;

    fn count(&self) -> usize {
        self.mesh.facets.len()
    }

    fn key(&self, f: usize) -> Boundary {
        let part = self.parts.as_ref().map_or(0, |parts| parts[f]);
        Boundary { part, ..whole_boundary(self.mesh, f) }
    }
}

/// The boundary of a facet, all its parts together.
fn whole_boundary(mesh: &TetMesh, f: usize) -> Boundary {
    Boundary { labels: mesh.facet_labels[f], wall: mesh.facet_wall(f), part: 0 }
}

/// Adds to what was counted of a boundary.
fn add(sides: &mut BTreeMap<Boundary, [usize; 2]>, boundary: Boundary, counts: [usize; 2]) {
    let sum = sides.entry(boundary).or_default();
    *sum = [sum[0] + counts[0], sum[1] + counts[1]];
}

/// Positive numbers of regions and boundaries, for formats that take no others: all different.
pub(super) struct Tags {
    pub volumes: Vec<i32>,
    pub surfaces: Vec<i32>,
}

impl Tags {
    /// The tags of labels, which are in increasing order, and of so many surfaces; none is above
    /// `max`. A label from 1 to `max` has itself. Others, from 0 downwards and then from `max`
    /// upwards, have the numbers after the largest of these, and surfaces those after them. Should
    /// these run out, the smallest numbers that no label has.
    pub fn new(labels: &[i32], surfaces: usize, max: i32) -> Self {
        let (low, high) =
            (labels.partition_point(|&label| label <= 0), labels.partition_point(|&l| l <= max));
        let own = &labels[low..high];
        let largest = own.last().copied().unwrap_or(0);
        let mut free =
            (largest..=max).skip(1).chain(1..largest).filter(|tag| own.binary_search(tag).is_err());
        let mut volumes: Vec<i32> = free.by_ref().take(low).collect();
        volumes.reverse();
        volumes.extend_from_slice(own);
        volumes.extend(free.by_ref().take(labels.len() - high));
        // In increasing order, since nodes belong to the surface of the smallest number.
        let mut surfaces: Vec<i32> = free.take(surfaces).collect();
        surfaces.sort_unstable();
        Self { volumes, surfaces }
    }
}

/// The regions and boundaries of a mesh, as writers want them.
///
/// # Errors
/// [`OutOfMemory`](crate::Error::OutOfMemory), as one of input and output.
pub(super) fn regions_and_boundaries<'m>(
    mesh: &'m TetMesh,
    options: &WriteOptions<'_>,
) -> io::Result<(Regions, Boundaries<'m>)> {
    let regions = Regions::new(mesh, options);
    let boundaries = Boundaries::new(mesh, options, &regions).map_err(io::Error::other)?;
    Ok((regions, boundaries))
}

/// What is counted where there is no memory.
const WHAT: &str = "boundaries of facets";

fn name_of(
    &Boundary { labels: [first, second], wall, part }: &Boundary,
    regions: &Regions,
) -> String {
    let second = wall.name().unwrap_or_else(|| regions.name(second));
    let name = format!("{}__{second}", regions.name(first));
    if part == 0 { name } else { format!("{name}_{part}") }
}

/// The number of the connected part of each facet, from 1 for each boundary: parts with more facets
/// come first, then those with a facet that comes first.
fn parts(mesh: &TetMesh, key: impl Fn(usize) -> Boundary) -> Result<Vec<u32>> {
    let facets = mesh.facets.len();
    let mut edges: Vec<([u32; 2], u32)> = room(3 * facets, WHAT)?;
    for (f, &[a, b, c]) in (0..).zip(&mesh.facets) {
        edges.extend([[a, b], [b, c], [c, a]].map(|[v, w]| ([v.min(w), v.max(w)], f)));
    }
    edges.par_sort_unstable();
    let sets = UnionFind::new(facets, WHAT)?;
    for around in edges.chunk_by(|one, other| one.0 == other.0) {
        for (i, &(_, f)) in around.iter().enumerate() {
            for &(_, g) in &around[..i] {
                if key(f as usize) == key(g as usize) {
                    sets.join(f, g);
                }
            }
        }
    }
    drop(edges);
    let mut counts: Vec<u32> = zeroed(facets, WHAT)?;
    (0..facets as u32).for_each(|f| counts[sets.root(f) as usize] += 1);
    // Roots are first facets.
    let roots = (0..facets).filter(|&f| counts[f] > 0);
    let mut order: Vec<(Boundary, u32, usize)> =
        roots.map(|f| (key(f), u32::MAX - counts[f], f)).collect();
    order.sort_unstable();
    let mut numbers = filled(facets, 0, WHAT, || Ok(()))?;
    for of_boundary in order.chunk_by(|one, other| one.0 == other.0) {
        for (number, &(_, _, root)) in (1..).zip(of_boundary) {
            numbers[root] = number;
        }
    }
    let of_roots = |f: u32| numbers[sets.root(f) as usize];
    Ok((0..facets as u32).map(of_roots).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::label_names::LabelName;
    use crate::mesh::testing::kuhn_box;

    fn named(names: &[(i32, &str)]) -> LabelNames {
        let name = |name: &str| LabelName { name: name.into(), color: None };
        names.iter().map(|&(label, text)| (label, name(text))).collect()
    }

    fn all_names(labels: &[i32], given: &[(i32, &str)]) -> Vec<String> {
        names_of(labels.iter().copied(), Some(&named(given))).into_values().collect()
    }

    #[test]
    fn names_are_what_all_formats_take() {
        assert_eq!(all_names(&[-3, 0, 7], &[]), ["label_-3", "label_7"]);
        let given =
            [(1, "Left lung (upper)"), (2, "3rd-Ventricle"), (3, "\u{80ba}"), (4, "a__b.c")];
        let expected = ["Left_lung_upper", "label_2_3rd-Ventricle", "label_3", "a_b_c"];
        assert_eq!(all_names(&[1, 2, 3, 4], &given), expected);
        // What is the same gets the label, what is too long is cut.
        let long = "x".repeat(99);
        let given =
            [(1, "Bone"), (2, "bone"), (3, "Background"), (4, &*long), (5, &*long), (6, "label_7")];
        let names = all_names(&[1, 2, 3, 4, 5, 6, 7], &given);
        assert_eq!(names[..3], ["Bone", "bone_2", "Background_3"]);
        assert_eq!([names[3].len(), names[4].len()], [MAX_NAME; 2]);
        assert!(names[4].ends_with("x_5"));
        assert_eq!(names[5..], ["label_7", "label_7_7"]);
        // What boundaries or fields of files are called.
        let given = [(1, "wall x min"), (2, "space")];
        assert_eq!(all_names(&[1, 2], &given), ["wall_x_min_1", "space_2"]);
        assert!(2 * MAX_NAME + "__".len() + "_12345678".len() <= 80);
    }

    /// Two regions side by side along x, and the first again behind the second.
    fn layers() -> TetMesh {
        let mut mesh = kuhn_box([3, 1, 1], [1.0; 3], |i, _, _| [7, 9, 7][i]);
        let on = |x: f64, mesh: &TetMesh, f: usize| {
            mesh.facet_labels[f][1] == 0 && mesh.facets[f].iter().all(|&v| mesh.point(v).x == x)
        };
        let wall = |f| if on(0.0, &mesh, f) { Wall::XMin } else { Wall::None };
        mesh.facet_walls = (0..mesh.facets.len()).map(wall).collect();
        mesh
    }

    #[test]
    fn boundaries_have_walls_and_parts() {
        let mesh = layers();
        let names = named(&[(7, "liver")]);
        let mut options = WriteOptions { names: Some(&names), ..WriteOptions::default() };
        let boundaries = |options: &WriteOptions<'_>| {
            Boundaries::new(&mesh, options, &Regions::new(&mesh, options)).unwrap()
        };
        let found = boundaries(&options);
        assert_eq!(
            found.names,
            ["liver__background", "liver__wall_x_min", "liver__label_9", "label_9__background"]
        );
        let count = |number| (0..mesh.facets.len()).filter(|&f| found.number(f) == number).count();
        // Ten squares of two triangles are around the liver's two cubes; one is the wall.
        assert_eq!([1, 2, 3, 4].map(count), [18, 2, 4, 8]);
        options.parts = true;
        let found = boundaries(&options);
        let parts = |name: &str| {
            found.names.iter().filter(|other| other.starts_with(name)).cloned().collect::<Vec<_>>()
        };
        assert_eq!(parts("liver__b"), ["liver__background_1", "liver__background_2"]);
        assert_eq!(parts("liver__l"), ["liver__label_9_1", "liver__label_9_2"]);
        // The second cube of the liver has the end of the box as well, so more facets.
        let first = found.names.iter().position(|name| name == "liver__background_1").unwrap();
        let of_first = (0..mesh.facets.len()).filter(|&f| found.of_facet(f) == first);
        assert!(of_first.clone().count() == 10);
        assert!(of_first.flat_map(|f| mesh.facets[f]).all(|v| mesh.point(v).x >= 2.0));
    }

    #[test]
    fn comments_name_all() {
        let mesh = layers();
        let options = WriteOptions::default();
        let boundaries = Boundaries::new(&mesh, &options, &Regions::new(&mesh, &options)).unwrap();
        let comments = boundaries.comments();
        let lines: Vec<&str> = comments.lines().collect();
        assert_eq!(lines[1], "# facets 2: labels 7 0 label_7__wall_x_min");
        assert_eq!(lines.len(), 4);
    }

    #[test]
    fn tags_are_positive_and_differ() {
        let tags = |labels: &[i32]| {
            let Tags { volumes, surfaces } = Tags::new(labels, 2, i32::MAX);
            (volumes, surfaces)
        };
        assert_eq!(tags(&[]), (vec![], vec![1, 2]));
        assert_eq!(tags(&[1, 5, 900_000]), (vec![1, 5, 900_000], vec![900_001, 900_002]));
        assert_eq!(tags(&[-7, -2, 0, 3, 9]), (vec![12, 11, 10, 3, 9], vec![13, 14]));
        assert_eq!(tags(&[i32::MIN, -1, 0]), (vec![3, 2, 1], vec![4, 5]));
        let max = i32::MAX;
        assert_eq!(tags(&[-3, 0, 1, 2, 4, max]), (vec![5, 3, 1, 2, 4, max], vec![6, 7]));
        assert_eq!(tags(&[max - 1]), (vec![max - 1], vec![1, max]));
        assert_eq!(tags(&[-1, 0, max - 1]), (vec![1, max, max - 1], vec![2, 3]));
        let Tags { volumes, surfaces } = Tags::new(&[-1, 5, 8, 99, 100, max], 2, 99);
        assert_eq!((volumes, surfaces), (vec![1, 5, 8, 99, 2, 3], vec![4, 6]));
    }
}
