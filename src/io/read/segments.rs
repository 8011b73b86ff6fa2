//! The layers of a segmentation of 3D Slicer (`.seg.nrrd`): segments that overlap are in different
//! layers, each a volume of labels of its own. Source: Slicer's vtkMRMLSegmentationStorageNode.
//!
//! The header names for each segment its layer and its value there, and a name: `Segment0_Layer`,
//! `Segment0_LabelValue`, `Segment0_Name`. Its label is its value, if all values that occur differ
//! from layer to layer. Else segments are numbered from 1, in the order of the header, and a
//! warning tells which is which. Values that the header does not name are segments, too, behind
//! those of the header, in the order in which they occur. Where segments overlap, that of the last
//! layer counts, or of the one that comes last in an order that the caller gives.

use std::collections::HashMap;

use super::fields::Fields;
use crate::error::excerpt;
use crate::image::MAX_IDS;
use crate::image::label_names::{LabelName, LabelNames};
use crate::{Result, memory};

/// What is counted where there is no memory.
const WHAT: &str = "segments of a file";

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
    /// The place of each layer in the order in which they count; none for the order of the file.
    places: Vec<usize>,
}

/// What is known when all voxels were seen.
pub(super) struct Finished<F> {
    /// The label of a segment's number.
    pub label: F,
    /// The names that the header gives to labels.
    pub names: LabelNames,
    /// What a user should know, one line each.
    pub warnings: Vec<String>,
}

struct Segment {
    value: i32,
    name: LabelName,
    occurs: bool,
}

/// A colour as the header has it: three numbers from 0 to 1.
fn color_of(text: &str) -> Option<[u8; 3]> {
    let mut parts = text.split_whitespace().map(str::parse::<f64>);
    let mut part = || Some((parts.next()?.ok()?.clamp(0.0, 1.0) * 255.0).round() as u8);
    Some([part()?, part()?, part()?])
}

impl Segments {
    /// The segments that a header names with their layers, if it does, all by numbers.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`](crate::Error).
    pub(super) fn of_header(fields: &Fields) -> Result<Option<Self>> {
        let mut found = Self {
            numbers: HashMap::new(),
            segments: Vec::new(),
            named: 0,
            overlapping: 0,
            places: Vec::new(),
        };
        for n in 0.. {
            let of = |what: &str| fields.pair(&format!("Segment{n}_{what}"));
            let (Some(layer), Some(value)) = (of("Layer"), of("LabelValue")) else { break };
            let (Ok(layer), Ok(value)) = (layer.parse(), value.parse()) else { return Ok(None) };
            let name = excerpt(of("Name").or_else(|| of("ID")).unwrap_or("unnamed"));
            let color = of("Color").and_then(color_of);
            found.add(layer, value, LabelName { name, color })?;
        }
        found.named = found.segments.len();
        Ok((found.named > 0).then_some(found))
    }

    /// The names of the labels of a file with a single layer, whose values are its labels.
    pub(super) fn names_of_values(&self) -> LabelNames {
        self.segments.iter().map(|segment| (segment.value, segment.name.clone())).collect()
    }

    /// Has the `count` layers count in another order than that of the file: later ones over earlier
    /// ones. False, and nothing done, if `order` does not name each layer once.
    pub(super) fn set_order(&mut self, order: &[usize], count: usize) -> bool {
        let mut sorted = order.to_vec();
        sorted.sort_unstable();
        if !sorted.into_iter().eq(0..count) {
            return false;
        }
        self.places = vec![0; count];
        order.iter().enumerate().for_each(|(place, &layer)| self.places[layer] = place);
        true
    }

    /// Whether there are more than labels can be.
    pub(super) fn are_too_many(&self) -> bool {
        self.segments.len() >= MAX_IDS
    }

    fn add(&mut self, layer: usize, value: i32, name: LabelName) -> Result<i32> {
        memory::reserve(&mut self.segments, 1, WHAT)?;
        self.segments.push(Segment { value, name, occurs: false });
        let number = self.segments.len() as i32;
        memory::insert(&mut self.numbers, (layer, value), number, WHAT)?;
        Ok(number)
    }

    /// The number of the segment that a voxel belongs to, by its values in all layers; 0 for none.
    /// Segments that the header does not name get their numbers in the order of the file, whatever
    /// the order in which layers count.
    pub(super) fn number(&mut self, values: &[i32]) -> Result<i32> {
        let (mut number, mut highest, mut count) = (0, 0, 0);
        for (layer, &value) in values.iter().enumerate().filter(|&(_, &value)| value != 0) {
            let of_layer = match self.numbers.get(&(layer, value)) {
                Some(&known) => known,
                None => {
                    let name =
                        format!("value {value} of layer {layer}, which the header does not name");
                    self.add(layer, value, LabelName { name, color: None })?
                }
            };
            self.segments[of_layer as usize - 1].occurs = true;
            let place = self.places.get(layer).copied().unwrap_or(layer);
            if count == 0 || place > highest {
                (number, highest) = (of_layer, place);
            }
            count += 1;
        }
        self.overlapping += u64::from(count > 1);
        Ok(number)
    }

    /// When all voxels were seen.
    pub(super) fn finish(self) -> Result<Finished<impl Fn(i32) -> i32>> {
        let mut values = memory::room(self.segments.len(), WHAT)?;
        values.extend(self.segments.iter().filter(|s| s.occurs).map(|s| s.value));
        let count = values.len();
        values.sort_unstable();
        values.dedup();
        let differ = values.len() == count;
        let values = memory::collected(self.segments.iter().map(|segment| segment.value), WHAT)?;
        let label = move |number: i32| if differ { values[number as usize - 1] } else { number };
        let mut warnings = Vec::new();
        let mut tell = |why: &str, numbers: std::ops::RangeInclusive<usize>| {
            let count = numbers.clone().count();
            let names = numbers
                .take(NAMED)
                .map(|n| format!("{} {}", label(n as i32), self.segments[n - 1].name.name));
            let names = names.collect::<Vec<_>>().join(", ");
            warnings.push(format!("{why}: {names}{}", if count > NAMED { ", ..." } else { "" }));
        };
        if !differ {
            tell(
                "segments of several layers have the same value, so they are numbered",
                1..=self.segments.len(),
            );
        } else if self.named < self.segments.len() {
            tell(
                "there are segments that the header does not name",
                self.named + 1..=self.segments.len(),
            );
        }
        if self.overlapping > 0 {
            let counts = if self.places.is_empty() {
                "the segment of the last layer counts there"
            } else {
                "the segment of the layer that is later in the order asked for counts there"
            };
            warnings.push(format!("{} voxels are in several segments; {counts}", self.overlapping));
        }
        let named =
            self.segments[..self.named].iter().zip(1..).filter(|(segment, _)| segment.occurs);
        let names = named.map(|(segment, number)| (label(number), segment.name.clone())).collect();
        Ok(Finished { label, names, warnings })
    }
}
