//! The course of a simulated run, and its steady state.
//!
//! **Steady state.** A run begins with few vertices, which have no room for many workers, and ends
//! with work that runs out. Both take times that grow with the logarithm of the number of workers,
//! or of tets, not with the tets themselves: in a run of 3 million tets for each worker they hardly
//! count, in one of 20 thousand they are half of the time. So rates that are to be compared with
//! such a run are those of its middle: from the moment when the first of [`STEADY`] of all tets has
//! been made, to that of the second. Tets are counted as they are made, whether they live to the
//! end or not: so is the work. One worker's rate is that between the same parts.
//!
//! **Marks** are taken whenever some thousand tets have been made ([`super::world`]); what workers
//! did until then comes from their timelines when the run has ended.

use std::ops::Sub;

use crate::refine::activity::ThreadReport;

/// The parts of all tets made between which a run is steady: before, samples go in and workers
/// join; after, some run out of work.
pub const STEADY: [f64; 2] = [0.5, 0.9];

/// What workers do: as many kinds as [`crate::refine::activity::Doing`] has.
pub const KINDS: usize = 5;

/// What had happened until a moment of a run; or, as the difference of two, between two moments.
/// Sums are those of all workers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mark {
    /// Virtual seconds since the beginning.
    pub seconds: f64,
    /// Tets made, living or not.
    pub made: u64,
    /// Records that came from other nodes.
    pub fetched: u64,
    /// Virtual seconds in which these travelled or were served, of all workers.
    pub travel_seconds: f64,
    /// Virtual seconds in which they waited for routers, of all workers.
    pub queue_seconds: f64,
    /// Virtual seconds by what workers did, in the order of [`crate::refine::activity::Doing`], of
    /// all workers; zeros without timelines.
    pub doing: [f64; KINDS],
}

impl Sub for Mark {
    type Output = Self;

    /// What happened after `earlier`.
    fn sub(self, earlier: Self) -> Self {
        Self {
            seconds: self.seconds - earlier.seconds,
            made: self.made - earlier.made,
            fetched: self.fetched - earlier.fetched,
            travel_seconds: self.travel_seconds - earlier.travel_seconds,
            queue_seconds: self.queue_seconds - earlier.queue_seconds,
            doing: std::array::from_fn(|kind| self.doing[kind] - earlier.doing[kind]),
        }
    }
}

/// The first mark at which that part of all tets had been made, of marks in the order of time.
pub(super) fn at(course: &[Mark], part: f64) -> Mark {
    let all = course.last().copied().unwrap_or_default();
    course.iter().copied().find(|mark| mark.made as f64 >= part * all.made as f64).unwrap_or(all)
}

/// Notes in each mark what workers had done until then. Cost: one step for each span and each mark
/// within it.
pub(super) fn add_timelines(course: &mut [Mark], threads: &[ThreadReport]) {
    for span in threads.iter().flat_map(|thread| &thread.timeline) {
        let (kind, mut from) = (span.doing as usize, span.start);
        let first = course.partition_point(|mark| mark.seconds <= from);
        for mark in &mut course[first..] {
            let until = span.end.min(mark.seconds);
            mark.doing[kind] += until - from;
            from = until;
            if from >= span.end {
                break;
            }
        }
    }
    // Until now each mark has what happened since the one before.
    for at in 1..course.len() {
        let before = course[at - 1].doing;
        course[at].doing.iter_mut().zip(before).for_each(|(sum, before)| *sum += before);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::refine::activity::{Doing, Span};

    fn mark(seconds: f64, made: u64) -> Mark {
        Mark { seconds, made, ..Mark::default() }
    }

    #[test]
    fn a_window_lies_between_parts_of_the_tets_made_not_of_the_time() {
        // Slow at first, slow at last.
        let course =
            [mark(0.0, 0), mark(8.0, 100), mark(9.0, 500), mark(10.0, 900), mark(30.0, 1000)];
        let window = at(&course, 0.9) - at(&course, 0.1);
        assert_eq!((window.seconds, window.made), (2.0, 800));
        // Between two marks: the later one.
        assert_eq!(at(&course, 0.3), course[2]);
        assert_eq!(at(&course, 1.0), course[4]);
        assert_eq!(at(&[], 0.5), Mark::default());
    }

    #[test]
    fn spans_are_dealt_to_the_marks_within_them() {
        let mut course = [mark(0.0, 0), mark(2.0, 1), mark(3.0, 2), mark(6.0, 3)];
        let span = |doing, start, end| Span { doing, start, end };
        let thread = |timeline| ThreadReport { timeline, ..ThreadReport::default() };
        let threads = [
            thread(vec![
                span(Doing::Sampling, 0.0, 1.0),
                span(Doing::Refining, 1.0, 5.0),
                span(Doing::Begging, 5.0, 7.0),
            ]),
            thread(vec![
                span(Doing::Sampling, 0.0, 2.5),
                span(Doing::Waiting, 2.5, 2.75),
                span(Doing::Refining, 2.75, 6.0),
            ]),
        ];
        add_timelines(&mut course, &threads);
        let doing = course.map(|mark| mark.doing);
        assert_eq!(doing[0], [0.0; KINDS]);
        assert_eq!(doing[1], [3.0, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(doing[2], [3.5, 2.25, 0.0, 0.25, 0.0]);
        assert_eq!(doing[3], [3.5, 7.25, 0.0, 0.25, 1.0]);
        // Between the last two all of both workers' time is accounted for.
        assert_eq!((course[3] - course[2]).doing.iter().sum::<f64>(), 2.0 * 3.0);
    }
}
