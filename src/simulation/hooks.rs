//! What the locking policies call in a build with simulations (`delaunay/access`): each does
//! nothing but in a simulation of the calling thread.

use std::cell::RefCell;

use super::virtual_time;
use super::world::{Kind, World};
use crate::delaunay::access::Effort;
use crate::delaunay::{TetId, Triangulation, VertexId};

thread_local! {
    /// Never borrowed while workers take turns.
    static WORLD: RefCell<Option<World>> = const { RefCell::new(None) };
}

/// Lets `world` be that of the calling thread, and gives back the one before.
pub(super) fn exchange(world: Option<World>) -> Option<World> {
    WORLD.replace(world)
}

/// The worker that runs did some work.
#[inline]
pub fn spend(effort: Effort) {
    if virtual_time::is_running() {
        let price =
            WORLD.with_borrow_mut(|world| world.as_mut().map_or(0, |world| world.price(effort)));
        virtual_time::advance(price);
    }
}

/// The worker that runs is about to look at, or to change, what others see.
#[inline]
pub fn pause() {
    if virtual_time::is_running() {
        virtual_time::pause();
    }
}

/// Worker `me` visits a tet.
#[inline]
pub fn visit_tet(me: usize, t: TetId) {
    visit(me, Kind::Tet, t);
}

/// Worker `me` visits a vertex.
#[inline]
pub fn visit_vertex(me: usize, v: VertexId) {
    visit(me, Kind::Vertex, v);
}

fn visit(me: usize, kind: Kind, id: u32) {
    if !virtual_time::is_running() {
        return;
    }
    let visited =
        WORLD.with_borrow_mut(|world| world.as_mut().map(|world| world.visit(me, kind, id)));
    let Some((price, source)) = visited else { return };
    virtual_time::advance(price);
    if let Some(source) = source {
        // Routers are asked for in the order of time.
        virtual_time::pause();
        let here =
            WORLD.with_borrow_mut(|world| world.as_mut().map(|world| world.fetch(me, source)));
        virtual_time::advance(here.map_or(0, |here| here - virtual_time::now()));
    }
}

/// Worker `me` looks at a tet and its neighbours, owning nothing.
pub fn look(me: usize, triangulation: &Triangulation, t: TetId) {
    if virtual_time::is_running() {
        spend(Effort::Look);
        visit_tet(me, t);
        let record = triangulation.tet(t);
        let neighbors: [_; 4] = std::array::from_fn(|i| record.neighbor(i));
        neighbors
            .iter()
            .filter(|facet| !facet.is_none())
            .for_each(|facet| visit_tet(me, facet.tet()));
    }
}
