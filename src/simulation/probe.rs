//! What tells a simulation of the work of its workers: the probe of the calling thread's world.

use std::cell::RefCell;

use super::world::{Kind, Work, World};
use crate::delaunay::probe::{Effort, Probe};
use crate::delaunay::{TetId, Triangulation, VertexId};
use crate::refine::probe::RefineProbe;
use crate::sync::virtual_time;

thread_local! {
    /// Never borrowed while workers take turns.
    static WORLD: RefCell<Option<World>> = const { RefCell::new(None) };
}

/// Lets `world` be that of the calling thread, and gives back the one before.
pub(super) fn exchange(world: Option<World>) -> Option<World> {
    WORLD.replace(world)
}

/// The probe of one virtual worker.
#[derive(Clone, Copy, Debug)]
pub struct SimProbe {
    me: usize,
}

impl SimProbe {
    /// That of worker `me`.
    pub fn new(me: usize) -> Self {
        Self { me }
    }

    fn visit(self, kind: Kind, id: u32) {
        let visited = WORLD
            .with_borrow_mut(|world| world.as_mut().map(|world| world.visit(self.me, kind, id)));
        let Some((price, source)) = visited else { return };
        virtual_time::advance(price);
        if let Some(source) = source {
            // Routers are asked for in the order of time.
            virtual_time::pause();
            let here = WORLD
                .with_borrow_mut(|world| world.as_mut().map(|world| world.fetch(self.me, source)));
            virtual_time::advance(here.map_or(0, |here| here - virtual_time::now()));
        }
    }
}

/// The worker that runs did some work.
fn spend(work: Work) {
    let price = WORLD.with_borrow_mut(|world| world.as_mut().map_or(0, |world| world.price(work)));
    virtual_time::advance(price);
}

impl Probe for SimProbe {
    fn spend(&mut self, effort: Effort) {
        spend(Work::Kernel(effort));
    }

    fn before_claim(&mut self) {
        spend(Work::Claim);
        virtual_time::pause();
    }

    fn before_release(&mut self) {
        virtual_time::pause();
    }

    fn visit_tet(&mut self, t: TetId) {
        self.visit(Kind::Tet, t);
    }

    fn visit_vertex(&mut self, v: VertexId) {
        self.visit(Kind::Vertex, v);
    }
}

impl RefineProbe for SimProbe {
    fn pause(&mut self) {
        virtual_time::pause();
    }

    /// A tet and its neighbours.
    fn inspect(&mut self, triangulation: &Triangulation, t: TetId) {
        spend(Work::Look);
        self.visit_tet(t);
        let record = triangulation.tet(t);
        let neighbors: [_; 4] = std::array::from_fn(|i| record.neighbor(i));
        neighbors
            .iter()
            .filter(|facet| !facet.is_none())
            .for_each(|facet| self.visit_tet(facet.tet()));
    }

    fn look_up_labels(&mut self, count: u64) {
        spend(Work::Labels(count));
    }

    fn look_up_crossings(&mut self, count: u64) {
        spend(Work::Crossings(count));
    }
}
