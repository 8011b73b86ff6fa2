//! Names of labels, which images and meshes have.

use std::collections::BTreeMap;
use std::ffi::{CStr, CString, c_char};
use std::ptr;

use crate::image::LabelNames;
use crate::image::label_names::LabelName;

/// Names of labels, and the same as C has strings.
#[derive(Clone, Default)]
pub(super) struct Names {
    all: LabelNames,
    texts: BTreeMap<i32, CString>,
}

impl Names {
    /// Of names with a zero byte C hears nothing.
    pub fn new(all: LabelNames) -> Self {
        let text =
            |(label, name): (i32, &LabelName)| Some((label, CString::new(&*name.name).ok()?));
        Self { texts: all.iter().filter_map(text).collect(), all }
    }

    /// As the library has them.
    pub fn all(&self) -> &LabelNames {
        &self.all
    }

    /// Those in a mesh whose labels became others.
    pub fn merged(&self, merge: &BTreeMap<i32, i32>) -> Self {
        Self::new(self.all.merged(merge))
    }

    /// The name of a label, NULL where it has none.
    pub fn text(&self, label: i32) -> *const c_char {
        self.texts.get(&label).map_or(ptr::null(), |text| text.as_ptr())
    }

    /// Names a label; its colour stays.
    pub fn insert(&mut self, label: i32, text: &CStr, name: String) {
        let color = self.all.get(label).and_then(|known| known.color);
        self.all.insert(label, LabelName { name, color });
        self.texts.insert(label, text.to_owned());
    }
}
