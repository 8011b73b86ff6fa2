// Two triangulations of the same points, compared tet by tet, with CGAL's exact predicates.
//
// The Delaunay subdivision of a point set is unique: its cells are the convex hulls of the points
// on one empty sphere. A cell with more than four points can be cut into tets in several ways, and
// every triangulation chooses its own. So tets that only one side has must fill the same cells on
// both sides. A cell is put together from tets across facets where the opposite vertex lies exactly
// on the circumsphere. If cells of equal vertex sets come out on both sides, the triangulations
// differ only inside groups of exactly cospherical points.
//
// Looking only at the tets that differ is enough: what the common tets leave of a cell is the same
// region on both sides, and its vertices are the same, because every point of a sphere is extreme
// among the points of it.
#ifndef CROSSVAL_CELLS_HPP
#define CROSSVAL_CELLS_HPP

#include "cases.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <numeric>
#include <set>
#include <vector>

namespace crossval {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;

inline std::vector<Point> cgal_points(const Meshing &mesh) {
    std::vector<Point> points;
    points.reserve(mesh.vertices());
    for (std::size_t v = 0; v < mesh.vertices(); ++v) {
        points.emplace_back(mesh.point(v)[0], mesh.point(v)[1], mesh.point(v)[2]);
    }
    return points;
}

inline CGAL::Orientation orientation(const std::vector<Point> &p, const Tet &t) {
    return CGAL::orientation(p[t[0]], p[t[1]], p[t[2]], p[t[3]]);
}

// Where vertex v lies: ON_BOUNDED_SIDE inside the circumsphere of t, which must not be flat,
// whatever its orientation.
inline CGAL::Bounded_side side_of_sphere(const std::vector<Point> &p, const Tet &t,
                                         std::uint32_t v) {
    return CGAL::side_of_bounded_sphere(p[t[0]], p[t[1]], p[t[2]], p[t[3]], p[v]);
}

// Tets as sorted vertices, sorted: equal triangulations give equal lists.
inline void normalize(std::vector<Tet> &tets) {
    for (Tet &t : tets) {
        std::sort(t.begin(), t.end());
    }
    std::sort(tets.begin(), tets.end());
}

inline std::vector<Tet> sorted_tets(const Meshing &mesh) {
    std::vector<Tet> tets(mesh.tets());
    for (std::size_t t = 0; t < tets.size(); ++t) {
        tets[t] = mesh.tet(t);
    }
    normalize(tets);
    return tets;
}

// The vertex sets of the cells that these tets make up. Flat tets, which have no sphere, join a
// neighbour on whose sphere they lie.
inline std::set<std::vector<std::uint32_t>> delaunay_cells(const std::vector<Point> &points,
                                                           const std::vector<Tet> &tets) {
    std::vector<std::size_t> parent(tets.size());
    std::iota(parent.begin(), parent.end(), std::size_t(0));
    const auto root = [&](std::size_t t) {
        while (parent[t] != t) {
            t = parent[t] = parent[parent[t]];
        }
        return t;
    };
    const auto flat = [&](std::size_t t) { return orientation(points, tets[t]) == CGAL::COPLANAR; };
    const auto on_sphere = [&](std::size_t t, std::uint32_t v) {
        return !flat(t) && side_of_sphere(points, tets[t], v) == CGAL::ON_BOUNDARY;
    };
    std::map<Facet, std::pair<std::size_t, int>> open;
    for (std::size_t t = 0; t < tets.size(); ++t) {
        for (int i = 0; i < 4; ++i) {
            const Facet facet{tets[t][i < 1 ? 1 : 0], tets[t][i < 2 ? 2 : 1],
                              tets[t][i < 3 ? 3 : 2]};
            const auto [other, is_new] = open.try_emplace(facet, t, i);
            if (!is_new) {
                const auto [u, j] = other->second;
                if (on_sphere(t, tets[u][j]) || on_sphere(u, tets[t][i])) {
                    parent[root(t)] = root(u);
                }
                open.erase(other);
            }
        }
    }
    std::map<std::size_t, std::vector<std::size_t>> members;
    for (std::size_t t = 0; t < tets.size(); ++t) {
        members[root(t)].push_back(t);
    }
    std::set<std::vector<std::uint32_t>> cells;
    for (const auto &[r, group] : members) {
        const auto round =
            std::find_if(group.begin(), group.end(), [&](std::size_t t) { return !flat(t); });
        if (!check(round != group.end(), "a cell has a tet that is not flat")) {
            continue;
        }
        std::vector<std::uint32_t> vertices;
        for (const std::size_t t : group) {
            vertices.insert(vertices.end(), tets[t].begin(), tets[t].end());
        }
        std::sort(vertices.begin(), vertices.end());
        vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
        const bool cospherical =
            std::all_of(vertices.begin(), vertices.end(), [&](std::uint32_t v) {
                const Tet &t = tets[*round];
                return std::find(t.begin(), t.end(), v) != t.end() || on_sphere(*round, v);
            });
        check(cospherical, "the vertices of a cell lie exactly on one sphere");
        cells.insert(std::move(vertices));
    }
    return cells;
}

// Compares our tets, sorted_tets(), with those of another triangulation of the same points. Prints
// what it found. Returns the number of tets that only we have.
inline std::size_t compare_tets(const std::vector<Point> &points, const std::vector<Tet> &ours,
                                std::vector<Tet> theirs, const char *name) {
    normalize(theirs);
    std::vector<Tet> our_own, their_own;
    std::set_difference(ours.begin(), ours.end(), theirs.begin(), theirs.end(),
                        std::back_inserter(our_own));
    std::set_difference(theirs.begin(), theirs.end(), ours.begin(), ours.end(),
                        std::back_inserter(their_own));
    std::printf("%s: %zu tets, %zu of them ours too", name, theirs.size(),
                ours.size() - our_own.size());
    if (our_own.empty() && their_own.empty()) {
        std::printf(": the same set\n");
        return 0;
    }
    const auto our_cells = delaunay_cells(points, our_own),
               their_cells = delaunay_cells(points, their_own);
    std::size_t largest = 0;
    for (const auto &cell : our_cells) {
        largest = std::max(largest, cell.size());
    }
    std::printf("; ours alone %zu, %s's alone %zu, in %zu and %zu cells of exactly cospherical "
                "vertices, at most %zu "
                "of them in one\n",
                our_own.size(), name, their_own.size(), our_cells.size(), their_cells.size(),
                largest);
    check(our_cells == their_cells, std::string("the cells are those of ") + name);
    return our_own.size();
}

} // namespace crossval

#endif
