//! The layers of a segmentation of 3D Slicer (`.seg.nrrd`): segments that overlap are in different layers, each a volume of
//! labels of its own. Source: Slicer's vtkMRMLSegmentationStorageNode.
//!
//! The header names for each segment its layer and its value there, and a name: `Segment0_Layer`, `Segment0_LabelValue`,
//! `Segment0_Name`. Its label is its value, if all values that occur differ from layer to layer. Else segments are numbered from 1,
//! in the order of the header, and a warning tells which is which. Values that the header does not name are segments, too, behind
//! those of the header, in the order in which they occur. Where segments overlap, that of the last layer counts.

use std::collections::HashMap;

use super::fields::{Fields, excerpt};
use crate::image::MAX_IDS;

/// Segments that a warning names.
const NAMED: usize = 20;

/// Which segments a file has, and what was seen of them.
pub(super) struct Segments {
    /// The number of the segment, from 1, that a layer's value stands for.
    numbers: HashMap<(usize, i32), i32>,
    /// All segments by their number, less one.
    segments: Vec<Segment>,
    /// How many of them the header names.
    named: usize,
    /// Voxels in several segments.
    overlapping: u64,
}

struct Segment {
    value: i32,
    name: String,
    occurs: bool,
}

impl Segments {
    /// The segments that a header names with their layers, if it does, all by numbers.
    pub(super) fn of_header(fields: &Fields) -> Option<Self> {
        let mut found = Self { numbers: HashMap::new(), segments: Vec::new(), named: 0, overlapping: 0 };
        for n in 0.. {
            let of = |what: &str| fields.pair(&format!("Segment{n}_{what}"));
            let (Some(layer), Some(value)) = (of("Layer"), of("LabelValue")) else { break };
            let (layer, value) = (layer.parse().ok()?, value.parse().ok()?);
            found.add(layer, value, excerpt(of("Name").or_else(|| of("ID")).unwrap_or("unnamed")));
        }
        found.named = found.segments.len();
        (found.named > 0).then_some(found)
    }

    /// Whether there are more than labels can be.
    pub(super) fn are_too_many(&self) -> bool {
        self.segments.len() >= MAX_IDS
    }

    fn add(&mut self, layer: usize, value: i32, name: String) -> i32 {
        self.segments.push(Segment { value, name, occurs: false });
        let number = self.segments.len() as i32;
        self.numbers.insert((layer, value), number);
        number
    }

    /// The number of the segment that a voxel belongs to, by its values in all layers; 0 for none.
    pub(super) fn number(&mut self, values: &[i32]) -> i32 {
        let (mut number, mut count) = (0, 0);
        for (layer, &value) in values.iter().enumerate().filter(|&(_, &value)| value != 0) {
            number = match self.numbers.get(&(layer, value)) {
                Some(&known) => known,
                None => {
                    self.add(layer, value, format!("value {value} of layer {layer}, which the header does not name"))
                }
            };
            self.segments[number as usize - 1].occurs = true;
            count += 1;
        }
        self.overlapping += u64::from(count > 1);
        number
    }

    /// When all voxels were seen: the label of a segment's number, and what a user should know, one line each.
    pub(super) fn finish(self) -> (impl Fn(i32) -> i32, Vec<String>) {
        let mut values: Vec<i32> = self.segments.iter().filter(|s| s.occurs).map(|s| s.value).collect();
        let count = values.len();
        values.sort_unstable();
        values.dedup();
        let differ = values.len() == count;
        let values: Vec<i32> = self.segments.iter().map(|segment| segment.value).collect();
        let label = move |number: i32| if differ { values[number as usize - 1] } else { number };
        let mut warnings = Vec::new();
        let mut tell = |why: &str, numbers: std::ops::RangeInclusive<usize>| {
            let count = numbers.clone().count();
            let names = numbers.take(NAMED).map(|n| format!("{} {}", label(n as i32), self.segments[n - 1].name));
            let names = names.collect::<Vec<_>>().join(", ");
            warnings.push(format!("{why}: {names}{}", if count > NAMED { ", ..." } else { "" }));
        };
        if !differ {
            tell("segments of several layers have the same value, so they are numbered", 1..=self.segments.len());
        } else if self.named < self.segments.len() {
            tell("there are segments that the header does not name", self.named + 1..=self.segments.len());
        }
        if self.overlapping > 0 {
            let count = self.overlapping;
            warnings
                .push(format!("{count} voxels are in several segments; the segment of the last layer counts there"));
        }
        (label, warnings)
    }
}
