//! Names and colours of labels, as segmentations and tables of labels give them.

use std::collections::BTreeMap;

/// The name and the colour of a label.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LabelName {
    /// One line, not empty.
    pub name: String,
    /// Red, green, blue.
    pub color: Option<[u8; 3]>,
}

/// The names of labels, as far as they have any.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LabelNames(BTreeMap<i32, LabelName>);

impl LabelNames {
    /// Names a label; the last name counts.
    pub fn insert(&mut self, label: i32, name: LabelName) {
        self.0.insert(label, name);
    }

    /// Takes over all names of `others`.
    pub fn extend(&mut self, others: Self) {
        self.0.extend(others.0);
    }

    /// Name and colour of a label.
    pub fn get(&self, label: i32) -> Option<&LabelName> {
        self.0.get(&label)
    }

    /// Labels with their names, in increasing order.
    pub fn iter(&self) -> impl Iterator<Item = (i32, &LabelName)> {
        self.0.iter().map(|(&label, name)| (label, name))
    }

    /// Whether no label has a name.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The names in a mesh whose labels became others (`merge`) before all else: names follow the
    /// voxels. A label that stayed keeps its name, whatever became it. One that has none, or became
    /// another itself, gets the names of those that became it, joined by `+`, and the colour of the
    /// first.
    pub fn merged(&self, merge: &BTreeMap<i32, i32>) -> Self {
        let target_of = |label: i32| merge.get(&label).copied().unwrap_or(label);
        let mut names = Self::default();
        for (&label, name) in self.0.iter().filter(|&(&label, _)| target_of(label) != label) {
            match names.0.get_mut(&target_of(label)) {
                Some(others) => others.name = format!("{}+{}", others.name, name.name),
                None => names.insert(target_of(label), name.clone()),
            }
        }
        let stayed = self.0.iter().filter(|&(&label, _)| target_of(label) == label);
        names.0.extend(stayed.map(|(&label, name)| (label, name.clone())));
        names
    }
}

impl FromIterator<(i32, LabelName)> for LabelNames {
    fn from_iter<I: IntoIterator<Item = (i32, LabelName)>>(names: I) -> Self {
        Self(names.into_iter().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_merged_labels() {
        let named = |names: &[(i32, &str)]| -> LabelNames {
            names
                .iter()
                .map(|&(label, name)| (label, LabelName { name: name.into(), color: None }))
                .collect()
        };
        let names = named(&[(1, "left"), (2, "right"), (3, "skull")]);
        let merged = |merge: &[(i32, i32)]| names.merged(&merge.iter().copied().collect());
        assert_eq!(merged(&[]), names);
        assert_eq!(merged(&[(1, 3)]), named(&[(2, "right"), (3, "skull")]));
        assert_eq!(merged(&[(1, 9), (2, 9)]), named(&[(3, "skull"), (9, "left+right")]));
        let exchanged = named(&[(1, "right"), (2, "left"), (3, "skull")]);
        assert_eq!(merged(&[(1, 2), (2, 1)]), exchanged);
    }
}
