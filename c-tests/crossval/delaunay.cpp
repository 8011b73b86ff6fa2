// delaunay NAME DELTA SIZE: the whole triangulation against CGAL's Delaunay_triangulation_3 of the
// same vertices and CGAL's exact predicates, and our quality report against every tet measured once
// more.
//
// CGAL and lapd break ties of the in-sphere test by the same symbolic perturbation (Devillers and
// Teillaud 2003), in the lexicographic order of points. So the sets of tets are equal even where
// vertices are cospherical, as the four corners of a side of the box are, and the test insists on
// it.

#include "cases.hpp"
#include "cells.hpp"
#include "shape.hpp"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <cstdlib>
#include <limits>
#include <utility>

namespace {

using namespace crossval;

using VertexBase = CGAL::Triangulation_vertex_base_with_info_3<std::uint32_t, Kernel>;
using Tds = CGAL::Triangulation_data_structure_3<VertexBase,
                                                 CGAL::Delaunay_triangulation_cell_base_3<Kernel>>;
using Delaunay = CGAL::Delaunay_triangulation_3<Kernel, Tds>;

// To this part our figures and those measured here must agree.
constexpr double RELATIVE = 1e-9;

void check_predicates(const Meshing &mesh, const std::vector<Point> &points) {
    std::size_t inverted = 0, not_delaunay = 0, ties = 0, inside_box = 0;
    const CGAL::Bbox_3 box = CGAL::bbox_3(points.begin(), points.end());
    for (std::size_t t = 0; t < mesh.tets(); ++t) {
        const Tet tet = mesh.tet(t);
        inverted += orientation(points, tet) != CGAL::POSITIVE;
        for (int i = 0; i < 4; ++i) {
            const std::uint32_t n = mesh.neighbor(t, i);
            if (n == LAPD_NO_TET) {
                // A facet without a tet across it lies in a side of the box.
                bool on_side = false;
                for (int axis = 0; axis < 3; ++axis) {
                    for (const double side : {box.min(axis), box.max(axis)}) {
                        bool all = true;
                        for (int j = 0; j < 4; ++j) {
                            all = all && (j == i || points[tet[j]][axis] == side);
                        }
                        on_side = on_side || all;
                    }
                }
                inside_box += !on_side;
                continue;
            }
            for (const std::uint32_t v : mesh.tet(n)) {
                if (std::find(tet.begin(), tet.end(), v) == tet.end()) {
                    const CGAL::Bounded_side side = side_of_sphere(points, tet, v);
                    not_delaunay += side == CGAL::ON_BOUNDED_SIDE;
                    ties += side == CGAL::ON_BOUNDARY;
                }
            }
        }
    }
    check(inverted == 0, std::to_string(inverted) + " tets are inverted");
    check(not_delaunay == 0, std::to_string(not_delaunay) + " facets are not Delaunay");
    check(inside_box == 0,
          std::to_string(inside_box) + " facets without a neighbour are not on the box");
    std::printf("CGAL's predicates: %zu tets positive, all facets Delaunay; %zu facets are exact "
                "ties of the in-sphere test\n",
                mesh.tets() - inverted, ties / 2);
}

void compare_with_cgal(const Meshing &mesh, const std::vector<Point> &points) {
    Delaunay triangulation;
    {
        std::vector<std::pair<Point, std::uint32_t>> numbered;
        numbered.reserve(points.size());
        for (std::size_t v = 0; v < points.size(); ++v) {
            numbered.emplace_back(points[v], static_cast<std::uint32_t>(v));
        }
        triangulation.insert(numbered.begin(), numbered.end());
    }
    check(triangulation.number_of_vertices() == points.size(), "CGAL takes every vertex");
    std::vector<Tet> theirs;
    theirs.reserve(triangulation.number_of_finite_cells());
    for (auto cell = triangulation.finite_cells_begin(); cell != triangulation.finite_cells_end();
         ++cell) {
        theirs.push_back({cell->vertex(0)->info(), cell->vertex(1)->info(), cell->vertex(2)->info(),
                          cell->vertex(3)->info()});
    }
    triangulation.clear();
    check(compare_tets(points, sorted_tets(mesh), std::move(theirs), "CGAL") == 0,
          "the set of tets is CGAL's");
}

void check_quality(const Meshing &mesh) {
    lapd_quality reported{};
    reported.struct_size = sizeof reported;
    check(lapd_mesh_get_quality(mesh.mesh(), &reported) == LAPD_OK, "quality");

    std::vector<double> tens;
    for (int i = 1; i < 18; ++i) {
        tens.push_back(10 * i);
    }
    Histogram histogram(tens, 1e-8L);
    Real smallest = 180, largest = 0, radius_edge = 0, facet_angle = 180;
    std::map<std::int32_t, std::pair<std::size_t, Real>> labels;
    for (std::size_t t = 0; t < mesh.tets(); ++t) {
        if (mesh.label(t) == 0) {
            continue;
        }
        std::array<Vector, 4> corners;
        for (int i = 0; i < 4; ++i) {
            corners[i] = vector(mesh.point(mesh.tet(t)[i]));
        }
        const TetShape shape = tet_shape(corners);
        for (const Real dihedral : shape.dihedrals) {
            smallest = std::min(smallest, dihedral);
            largest = std::max(largest, dihedral);
            histogram.add(dihedral);
        }
        radius_edge = std::max(radius_edge, shape.radius_edge);
        auto &[count, volume] = labels[mesh.label(t)];
        ++count;
        volume += shape.volume;
    }
    for (std::size_t f = 0; f < mesh.facets(); ++f) {
        const auto [a, b, c] = mesh.facet(f);
        for (const Real angle :
             triangle_angles(vector(mesh.point(a)), vector(mesh.point(b)), vector(mesh.point(c)))) {
            facet_angle = std::min(facet_angle, angle);
        }
    }
    near(reported.min_dihedral, smallest, RELATIVE, "smallest dihedral angle");
    near(reported.max_dihedral, largest, RELATIVE, "largest dihedral angle");
    near(reported.max_radius_edge, radius_edge, RELATIVE, "largest radius-edge ratio");
    near(reported.min_facet_angle, facet_angle, RELATIVE, "smallest facet angle");
    check(histogram.agrees(reported.dihedral_histogram), "histogram of dihedral angles");

    std::size_t rows = 0;
    check(lapd_mesh_get_label_row_count(mesh.mesh(), &rows) == LAPD_OK, "rows");
    std::size_t meshed = 0;
    for (std::size_t i = 0; i < rows; ++i) {
        lapd_label_row row{};
        row.struct_size = sizeof row;
        check(lapd_mesh_get_label_row(mesh.mesh(), i, &row) == LAPD_OK, "row");
        const auto &[count, volume] = labels[static_cast<std::int32_t>(row.label)];
        check(row.tets == count, "tets of label " + std::to_string(row.label));
        near(row.mesh_volume, volume, RELATIVE, "volume of label " + std::to_string(row.label));
        meshed += row.tets > 0;
    }
    check(labels.size() == rows, "every label of a tet has its row");
    std::printf("quality: dihedral angles %.6g to %.8g degrees, radius-edge %.6g, facet angles "
                "from %.6g degrees, "
                "volumes of %zu labels: as measured "
                "here\n",
                reported.min_dihedral, reported.max_dihedral, reported.max_radius_edge,
                reported.min_facet_angle, meshed);
}

void checks(int argc, char **argv) {
    if (argc != 4) {
        throw std::runtime_error("usage: delaunay NAME DELTA SIZE");
    }
    const Meshing mesh(argv[1], std::atof(argv[2]), std::atof(argv[3]));
    const std::vector<Point> points = cgal_points(mesh);
    check_predicates(mesh, points);
    compare_with_cgal(mesh, points);
    check_quality(mesh);
}

} // namespace

int main(int argc, char **argv) {
    return run(argc, argv, checks);
}
