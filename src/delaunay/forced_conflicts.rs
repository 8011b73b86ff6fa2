//! Conflicts by force: in a build with the feature `force-conflicts`, and where the variable
//! `LAPD_FORCE_CONFLICTS` is set, every lock step of an operation is refused now and then, as if
//! another worker owned the tet or, one in four, as if the tet had changed. The environment is read
//! in such a build alone, which is for tests.
//!
//! Real conflicts are rare, and those at the last of eighty steps rarer. Here every third operation
//! is refused at a step drawn at random, the first to the 80th at which it asks for a tet or looks
//! whose one is: at the way in, in the middle of a cavity, at the last tet of a star. An operation
//! of fewer steps completes. So any refusal that leaves an owned tet or a half-written one behind
//! shows in the tests that refine with this feature (`tests/podm.rs`).

use std::sync::LazyLock;

use super::ownership::{Holder, OwnerId};

/// Most steps of an operation that may be refused.
const MAX: u64 = 80;

/// Which refusals a worker meets, by a pseudo-random sequence of its own.
#[derive(Debug)]
pub(super) struct ForcedConflicts {
    me: OwnerId,
    random: u64,
    /// Steps that this operation may still make, this one included, until it is refused; 0: it is
    /// not refused any more.
    left: u64,
}

impl ForcedConflicts {
    /// For worker `me`, if locks are to be refused.
    pub fn if_asked_for(me: OwnerId) -> Option<Self> {
        static ASKED_FOR: LazyLock<bool> =
            LazyLock::new(|| std::env::var_os("LAPD_FORCE_CONFLICTS").is_some());
        ASKED_FOR.then(|| Self::new(me))
    }

    /// For worker `me`.
    fn new(me: OwnerId) -> Self {
        let mut forced =
            Self { me, random: u64::from(me).wrapping_mul(0x9E37_79B9_7F4A_7C15), left: 0 };
        forced.next_operation();
        forced
    }

    /// A pseudo-random number (G. Marsaglia, "Xorshift RNGs", 2003).
    fn draw(&mut self) -> u64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        self.random >> 8
    }

    /// Whether this step is refused, and in whose name: any of the workers before this one, which
    /// exist; for the first it is the second.
    pub fn refuses(&mut self) -> Option<Holder> {
        self.left = self.left.checked_sub(1)?;
        if self.left > 0 {
            return None;
        }
        let draw = self.draw();
        Some(match u64::from(self.me) {
            _ if draw.is_multiple_of(4) => Holder::Changed,
            1 => Holder::Other(2),
            me => Holder::Other((1 + draw / 4 % (me - 1)) as OwnerId),
        })
    }

    /// The operation has ended.
    pub fn next_operation(&mut self) {
        let draw = self.draw();
        self.left = if draw.is_multiple_of(3) { 1 + draw / 3 % MAX } else { 0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_is_refused_and_most_operations_are_not() {
        let mut forced = ForcedConflicts::new(3);
        let mut refused = [0; MAX as usize];
        let mut changed = 0;
        for _ in 0..100_000 {
            if let Some((step, holder)) =
                (0..MAX as usize).find_map(|step| Some((step, forced.refuses()?)))
            {
                refused[step] += 1;
                match holder {
                    Holder::Changed => changed += 1,
                    other => assert!(matches!(other, Holder::Other(1 | 2))),
                }
            }
            forced.next_operation();
        }
        assert!((7_000..9_500).contains(&changed), "{changed}");
        assert!(refused.iter().all(|&count| count > 300), "{refused:?}");
        assert!(refused.iter().sum::<i32>() < 40_000, "{refused:?}");
    }
}
