// surfaces NAME DELTA SIZE [EDGE | improved]: the interfaces are closed, and our MEDIT file gives
// CGAL the mesh that we have.
//
// - Around every label its facets, turned outwards, form a cycle: each edge is used as often in one
// direction as
//   in the other, so an even number of times. The volume inside, by the divergence theorem, is that
//   of the label's tets.
// - CGAL builds a Mesh_complex_3_in_triangulation_3 from our MEDIT file: its triangulation is
// valid, cells of
//   every subdomain and facets of every pair of labels are as many as ours, and no edge is the
//   border of a surface.
// - With "improved", slivers are removed first, and the dihedral angles, measured by CGAL, are
// those that were asked
//   for, but for the tets that are listed.
// - With EDGE, CGAL's tetrahedral_isotropic_remeshing takes the mesh to this edge length, and every
// label keeps
//   its volume.

#include "cases.hpp"
#include "shape.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Mesh_3/tet_soup_to_c3t3.h>
#include <CGAL/Mesh_complex_3_in_triangulation_3.h>
#include <CGAL/Tetrahedral_remeshing/Remeshing_triangulation_3.h>
#include <CGAL/tetrahedral_remeshing.h>

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <set>
#include <tuple>
#include <vector>

namespace {

using namespace crossval;

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Triangulation = CGAL::Tetrahedral_remeshing::Remeshing_triangulation_3<Kernel>;
using Complex = CGAL::Mesh_complex_3_in_triangulation_3<Triangulation>;

void check_closed(const Meshing &mesh) {
    // Label and edge, smaller vertex first; how often it is used, and the sum of directions.
    struct Use {
        std::int32_t label;
        std::uint32_t a, b;
        int direction;
    };
    std::vector<Use> uses;
    uses.reserve(6 * mesh.facets());
    std::map<std::int32_t, Real> inside, volumes;
    const Vector origin = vector(mesh.point(0));
    std::size_t misordered = 0;
    for (std::size_t f = 0; f < mesh.facets(); ++f) {
        const Facet facet = mesh.facet(f);
        const auto labels = mesh.facet_labels(f);
        misordered += labels[0] == 0 || (labels[1] != 0 && labels[0] >= labels[1]);
        const Vector p[3] = {vector(mesh.point(facet[0])) - origin,
                             vector(mesh.point(facet[1])) - origin,
                             vector(mesh.point(facet[2])) - origin};
        const Real cone = dot(cross(p[0], p[1]), p[2]) / 6;
        for (int side = 0; side < 2; ++side) {
            // The normal leads out of the first label and into the second one.
            const int sign = side == 0 ? 1 : -1;
            inside[labels[side]] += sign * cone;
            for (int i = 0; i < 3; ++i) {
                const std::uint32_t a = facet[i], b = facet[(i + 1) % 3];
                uses.push_back(
                    {labels[side], std::min(a, b), std::max(a, b), a < b ? sign : -sign});
            }
        }
    }
    check(misordered == 0, "the smaller label comes first, the background last");
    std::sort(uses.begin(), uses.end(), [](const Use &x, const Use &y) {
        return std::tie(x.label, x.a, x.b) < std::tie(y.label, y.a, y.b);
    });
    std::size_t open = 0, crossings = 0, edges = 0;
    for (std::size_t i = 0; i < uses.size();) {
        int sum = 0;
        std::size_t n = 0;
        for (const Use &first = uses[i];
             i + n < uses.size() && std::tie(uses[i + n].label, uses[i + n].a, uses[i + n].b) ==
                                        std::tie(first.label, first.a, first.b);
             ++n) {
            sum += uses[i + n].direction;
        }
        open += sum != 0 || n % 2 != 0;
        crossings += n > 2;
        ++edges;
        i += n;
    }
    check(open == 0,
          std::to_string(open) + " edges where the surface of a label is open or turns over");

    for (std::size_t t = 0; t < mesh.tets(); ++t) {
        std::array<Vector, 4> p;
        for (int i = 0; i < 4; ++i) {
            p[i] = vector(mesh.point(mesh.tet(t)[i]));
        }
        volumes[mesh.label(t)] += tet_shape(p).volume;
    }
    for (const auto &[label, volume] : volumes) {
        if (label != 0) {
            near(inside[label], volume, 1e-9,
                 "volume inside the surface of label " + std::to_string(label));
        }
    }
    std::printf("surfaces of %zu labels: closed, consistently oriented, and their insides have the "
                "volumes of the "
                "tets; %zu edges, %zu of them on more than "
                "two facets of a label\n",
                inside.size(), edges, crossings);
}

// Volume and number of the cells of each subdomain.
std::map<int, std::pair<std::size_t, double>> subdomains(const Triangulation &triangulation) {
    std::map<int, std::pair<std::size_t, double>> sums;
    for (auto cell = triangulation.finite_cells_begin(); cell != triangulation.finite_cells_end();
         ++cell) {
        auto &[count, volume] = sums[cell->subdomain_index()];
        ++count;
        volume += triangulation.tetrahedron(cell).volume();
    }
    return sums;
}

void load(const Meshing &mesh, Triangulation &triangulation) {
    const std::string path = "crossval-" + std::to_string(getpid()) + ".mesh";
    mesh.write(path);
    std::ifstream file(path);
    const bool built =
        CGAL::build_triangulation_from_file<Triangulation, false>(file, triangulation);
    std::remove(path.c_str());
    if (!built) {
        throw std::runtime_error("CGAL builds no triangulation from our MEDIT file");
    }
}

void check_complex(const Meshing &mesh) {
    Complex complex;
    load(mesh, complex.triangulation());
    complex.rescan_after_load_of_triangulation();
    const Triangulation &triangulation = complex.triangulation();
    check(triangulation.is_valid(), "CGAL's triangulation from our MEDIT file is valid");
    check(triangulation.number_of_vertices() == mesh.vertices(),
          "vertices in CGAL's triangulation");
    check(triangulation.number_of_finite_cells() == mesh.tets(), "cells in CGAL's triangulation");

    std::map<int, std::size_t> tets;
    for (std::size_t t = 0; t < mesh.tets(); ++t) {
        ++tets[mesh.label(t)];
    }
    const auto loaded = subdomains(triangulation);
    bool same = tets.size() == loaded.size();
    for (const auto &[label, sum] : loaded) {
        same = same && tets[label] == sum.first;
    }
    check(same, "cells of every subdomain are the tets of its label");
    check(complex.number_of_cells_in_complex() == mesh.tets() - tets[0], "cells in the complex");
    check(complex.number_of_facets_in_complex() == mesh.facets(), "facets in the complex");

    // A facet of the complex separates two subdomains, and every one that does is in it.
    std::map<std::pair<int, int>, std::size_t> pairs, loaded_pairs;
    for (std::size_t f = 0; f < mesh.facets(); ++f) {
        const auto labels = mesh.facet_labels(f);
        ++pairs[std::minmax(labels[0], labels[1])];
    }
    // Walls are patches of their own, so a pair of labels may have several.
    std::map<int, std::pair<int, int>> patches;
    std::size_t wrong = 0;
    for (auto facet = triangulation.finite_facets_begin();
         facet != triangulation.finite_facets_end(); ++facet) {
        const auto mirror = triangulation.mirror_facet(*facet);
        const auto subdomain = [&](auto cell) {
            return triangulation.is_infinite(cell) ? 0 : cell->subdomain_index();
        };
        const int a = subdomain(facet->first), b = subdomain(mirror.first);
        wrong += (a != b) != complex.is_in_complex(*facet);
        if (a != b) {
            const std::pair<int, int> pair = std::minmax(a, b);
            ++loaded_pairs[pair];
            const int patch = complex.surface_patch_index(*facet);
            wrong += patches.emplace(patch, pair).first->second != pair;
        }
    }
    check(wrong == 0, std::to_string(wrong) + " facets are in the complex but between equal "
                                              "labels, or otherwise, or of another patch");
    check(pairs == loaded_pairs, "facets of every pair of labels");

    std::map<Complex::Face_status, std::size_t> edges;
    for (auto edge = triangulation.finite_edges_begin(); edge != triangulation.finite_edges_end();
         ++edge) {
        ++edges[complex.face_status(*edge)];
    }
    check(edges[Complex::BOUNDARY] == 0, "no edge of the complex is a border");
    check(edges[Complex::ISOLATED] == 0, "no edge of the complex is alone");
    std::printf("C3t3 from our MEDIT file: %zu cells in %zu subdomains, %zu facets in %zu patches, "
                "edges with two "
                "facets %zu, with more %zu, with one "
                "%zu\n",
                static_cast<std::size_t>(complex.number_of_cells_in_complex()),
                tets.size() - tets.count(0),
                static_cast<std::size_t>(complex.number_of_facets_in_complex()), patches.size(),
                edges[Complex::REGULAR], edges[Complex::SINGULAR], edges[Complex::BOUNDARY]);
}

void check_remeshing(const Meshing &mesh, double edge) {
    Triangulation triangulation;
    load(mesh, triangulation);
    const auto before = subdomains(triangulation);
    CGAL::tetrahedral_isotropic_remeshing(triangulation, edge);
    check(triangulation.is_valid(), "the remeshed triangulation is valid");
    const auto after = subdomains(triangulation);
    for (const auto &[label, sum] : before) {
        const auto found = after.find(label);
        if (label != 0 &&
            check(found != after.end(), "remeshing keeps label " + std::to_string(label))) {
            near(found->second.second, sum.second, 0.05,
                 "volume of label " + std::to_string(label) + " after remeshing");
        }
    }
    std::printf("CGAL's tetrahedral remeshing to edges of %g: valid, every label there, volumes "
                "within 5 %%\n",
                edge);
}

// The dihedral angles of tissue by CGAL.
void check_angles(const Meshing &mesh) {
    lapd_improvement reported{};
    reported.struct_size = sizeof reported;
    check(lapd_mesh_get_improvement(mesh.mesh(), &reported) == LAPD_OK, "improvement");
    std::set<std::size_t> listed;
    for (std::size_t i = 0; i < reported.left; ++i) {
        lapd_left left{};
        left.struct_size = sizeof left;
        check(lapd_mesh_get_left(mesh.mesh(), i, &left) == LAPD_OK, "left");
        listed.insert(static_cast<std::size_t>(left.tet));
    }
    const auto point = [&](std::uint32_t v) {
        return Kernel::Point_3(mesh.point(v)[0], mesh.point(v)[1], mesh.point(v)[2]);
    };
    const double target = reported.target_dihedral;
    double least = 180, largest = 0;
    std::size_t beyond = 0;
    for (std::size_t t = 0; t < mesh.tets(); ++t) {
        if (mesh.label(t) == 0 || listed.count(t) > 0) {
            continue;
        }
        const Tet tet = mesh.tet(t);
        static constexpr int EDGES[6][4] = {{0, 1, 2, 3}, {0, 2, 1, 3}, {0, 3, 1, 2},
                                            {1, 2, 0, 3}, {1, 3, 0, 2}, {2, 3, 0, 1}};
        for (const auto &e : EDGES) {
            const double angle = std::abs(CGAL::to_double(CGAL::approximate_dihedral_angle(
                point(tet[e[0]]), point(tet[e[1]]), point(tet[e[2]]), point(tet[e[3]]))));
            least = std::min(least, angle);
            largest = std::max(largest, angle);
            beyond += angle < target - 1e-4 || angle > 180 - target + 1e-4;
        }
    }
    std::printf("dihedral angles by CGAL: %.4f to %.4f degrees, %zu tets listed as left\n", least,
                largest, listed.size());
    check(beyond == 0, std::to_string(beyond) + " angles beyond the target");
    check(listed.size() <= 10, std::to_string(listed.size()) + " tets are left");
}

void checks(int argc, char **argv) {
    if (argc != 4 && argc != 5) {
        throw std::runtime_error("usage: surfaces NAME DELTA SIZE [EDGE | improved]");
    }
    const bool improved = argc == 5 && std::string(argv[4]) == "improved";
    const Meshing mesh(argv[1], std::atof(argv[2]), std::atof(argv[3]), improved);
    check_closed(mesh);
    check_complex(mesh);
    if (improved) {
        check_angles(mesh);
    } else if (argc == 5) {
        check_remeshing(mesh, std::atof(argv[4]));
    }
}

} // namespace

int main(int argc, char **argv) {
    return run(argc, argv, checks);
}
