//! Values of any kind as labels: each distinct value gets a label of its own.
//!
//! For files whose numbers only tell regions apart: 42.5 and 85, or 64-bit ids. Values are compared
//! exactly, 64-bit integers too. 0 is the background; the others become 1, 2, ... in increasing
//! order.

use std::cmp::Ordering;
use std::collections::HashMap;

use crate::image::MAX_IDS;
use crate::{Result, memory};

/// What is counted where there is no memory.
const WHAT: &str = "distinct values";

/// A finite number of a file.
#[derive(Clone, Copy, Debug)]
pub(super) enum Number {
    Whole(i128),
    Real(f64),
    /// Of a file in single precision: 0.1, and not 0.10000000149011612.
    Single(f32),
}

impl Default for Number {
    fn default() -> Self {
        Self::Whole(0)
    }
}

impl Number {
    /// `None` for what is no finite number. Whole numbers are the same whatever type they had.
    pub(super) fn of_real(value: f64) -> Option<Self> {
        let is_whole = value.fract() == 0.0 && value.abs() < 2_f64.powi(100);
        value.is_finite().then_some(if is_whole {
            Self::Whole(value as i128)
        } else {
            Self::Real(value)
        })
    }

    /// As [`Self::of_real`], of a number in single precision.
    pub(super) fn of_single(value: f32) -> Option<Self> {
        Self::of_real(f64::from(value)).map(|number| match number {
            Self::Real(_) => Self::Single(value),
            whole => whole,
        })
    }

    /// What tells it from all others of its file, which are of one type.
    fn key(self) -> (bool, i128) {
        match self {
            Self::Whole(n) => (true, n),
            Self::Real(x) => (false, i128::from(x.to_bits())),
            Self::Single(x) => (false, i128::from(x.to_bits())),
        }
    }

    /// The order of values.
    fn order(self, other: Self) -> Ordering {
        match (self, other) {
            (Self::Whole(a), Self::Whole(b)) => a.cmp(&b),
            (a, b) => a.real().total_cmp(&b.real()),
        }
    }

    fn real(self) -> f64 {
        match self {
            Self::Whole(n) => n as f64,
            Self::Real(x) => x,
            Self::Single(x) => f64::from(x),
        }
    }

    /// All its digits.
    fn text(self) -> String {
        match self {
            Self::Whole(n) => n.to_string(),
            Self::Real(x) => x.to_string(),
            Self::Single(x) => x.to_string(),
        }
    }
}

impl PartialEq for Number {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

/// The distinct values seen so far, which are numbered from 1 on as they come; 0 is the value 0.
#[derive(Default)]
pub(super) struct Distinct {
    numbers: HashMap<(bool, i128), i32>,
    values: Vec<Number>,
}

impl Distinct {
    /// Appends the numbers of values; there is room for them.
    pub(super) fn number(&mut self, values: &[Number], numbers: &mut Vec<i32>) -> Result<()> {
        for run in values.chunk_by(|a, b| a == b) {
            let number = match run[0] {
                Number::Whole(0) => 0,
                value => match self.numbers.get(&value.key()) {
                    Some(&known) => known,
                    None => self.add(value)?,
                },
            };
            numbers.extend(std::iter::repeat_n(number, run.len()));
        }
        Ok(())
    }

    fn add(&mut self, value: Number) -> Result<i32> {
        memory::reserve(&mut self.values, 1, WHAT)?;
        self.values.push(value);
        let number = self.values.len() as i32;
        memory::insert(&mut self.numbers, value.key(), number, WHAT)?;
        Ok(number)
    }

    /// Whether there are more values than labels.
    pub(super) fn are_too_many(&self) -> bool {
        self.values.len() >= MAX_IDS
    }

    /// The label of each number from 1 on, in order of value, and the text of the value of each
    /// label from 1 on.
    pub(super) fn finish(self) -> Result<(Vec<i32>, Vec<String>)> {
        let mut order = memory::collected(0..self.values.len(), WHAT)?;
        order.sort_unstable_by(|&a, &b| self.values[a].order(self.values[b]));
        let mut labels = memory::zeroed(order.len(), WHAT)?;
        for (rank, &n) in order.iter().enumerate() {
            labels[n] = rank as i32 + 1;
        }
        let texts = order.into_iter().map(|n| self.values[n].text());
        Ok((labels, memory::collected(texts, WHAT)?))
    }
}

/// A line that tells what became of values: the first of them.
pub(super) fn told(texts: &[String]) -> String {
    const MAX: usize = 5;
    let pairs: Vec<String> = texts
        .iter()
        .take(MAX)
        .enumerate()
        .map(|(n, text)| format!("{text} is label {}", n + 1))
        .collect();
    let rest = if texts.len() > MAX { ", and so on" } else { "" };
    format!("{} distinct values became labels: {}{rest}", texts.len(), pairs.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_told_apart_exactly_and_put_in_order() {
        let mut distinct = Distinct::default();
        let mut numbers = Vec::new();
        let large = 1_i128 << 60;
        let values = [85.0, 0.0, 42.5, -3.0, 85.0].map(|x| Number::of_real(x).unwrap());
        distinct.number(&values, &mut numbers).unwrap();
        distinct
            .number(
                &[Number::Whole(large + 1), Number::Whole(large), Number::Whole(85)],
                &mut numbers,
            )
            .unwrap();
        assert_eq!(numbers, [1, 0, 2, 3, 1, 4, 5, 1]);
        let (labels, texts) = distinct.finish().unwrap();
        assert_eq!(labels, [3, 2, 1, 5, 4]);
        assert_eq!(texts, ["-3", "42.5", "85", "1152921504606846976", "1152921504606846977"]);
        assert!(
            told(&texts)
                .starts_with("5 distinct values became labels: -3 is label 1, 42.5 is label 2,")
        );
        assert_eq!(Number::of_single(0.1).map(Number::text).as_deref(), Some("0.1"));
        assert_eq!(Number::of_real(f64::NAN), None);
        assert_eq!(Number::of_real(-0.0), Some(Number::Whole(0)));
    }
}
