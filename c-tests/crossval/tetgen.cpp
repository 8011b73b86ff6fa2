// tetgen NAME DELTA SIZE: the whole triangulation against TetGen's Delaunay tetrahedralisation of
// the same vertices, and our mesh read into TetGen, which checks its consistency and measures it.
//
// TetGen breaks ties of the in-sphere test in the order of its vertex numbers, lapd in the
// lexicographic order of coordinates. So tets may differ, but only inside groups of exactly
// cospherical vertices; exact predicates (CGAL's) tell whether they do.

#include "cases.hpp"
#include "cells.hpp"
#include "shape.hpp"

#define TETLIBRARY
#include <tetgen.h>

#include <unistd.h>

#include <cstdlib>
#include <limits>
#include <map>
#include <regex>
#include <sstream>

namespace {

using namespace crossval;

// Runs TetGen and returns what it printed: its library has no other way to tell what it found.
std::string tetrahedralized(const std::string &switches, tetgenio &in, tetgenio &out) {
    std::fflush(stdout);
    const std::unique_ptr<std::FILE, int (*)(std::FILE *)> file(std::tmpfile(), std::fclose);
    const int kept = dup(STDOUT_FILENO);
    if (file == nullptr || kept < 0 || dup2(fileno(file.get()), STDOUT_FILENO) < 0) {
        throw std::runtime_error("standard output cannot be redirected");
    }
    int error = 0;
    try {
        std::string text = switches;
        tetrahedralize(text.data(), &in, &out);
    } catch (const int code) {
        error = code;
    }
    std::fflush(stdout);
    dup2(kept, STDOUT_FILENO);
    close(kept);
    std::string printed;
    std::rewind(file.get());
    for (int c = std::fgetc(file.get()); c != EOF; c = std::fgetc(file.get())) {
        printed += static_cast<char>(c);
    }
    if (error != 0) {
        throw std::runtime_error("TetGen gave up with error " + std::to_string(error) + ": " +
                                 printed);
    }
    return printed;
}

bool says(const std::string &printed, const char *line) {
    return check(printed.find(line) != std::string::npos, std::string("TetGen says: ") + line);
}

void compare_with_tetgen(const Meshing &mesh, const std::vector<Point> &points) {
    tetgenio in, out;
    in.numberofpoints = static_cast<int>(mesh.vertices());
    in.pointlist = new REAL[3 * mesh.vertices()];
    std::copy_n(mesh.point(0), 3 * mesh.vertices(), in.pointlist);
    tetrahedralized("Q", in, out);
    check(out.numberofpoints == in.numberofpoints, "TetGen takes every vertex and adds none");
    std::vector<Tet> theirs(static_cast<std::size_t>(out.numberoftetrahedra));
    for (std::size_t t = 0; t < theirs.size(); ++t) {
        for (int i = 0; i < 4; ++i) {
            theirs[t][i] = static_cast<std::uint32_t>(out.tetrahedronlist[4 * t + i]);
        }
    }
    compare_tets(points, sorted_tets(mesh), std::move(theirs), "TetGen");
}

// Our tets, all of them or those of the tissues, with the interface facets where asked for, as
// TetGen's input.
struct Input {
    tetgenio io;
    std::vector<std::uint32_t> vertices; // which of ours each vertex is

    Input(const Meshing &mesh, bool background, bool facets) {
        std::vector<int> number(mesh.vertices(), -1);
        std::vector<int> corners;
        const auto numbered = [&](std::uint32_t v) {
            if (number[v] < 0) {
                number[v] = static_cast<int>(vertices.size());
                vertices.push_back(v);
            }
            return number[v];
        };
        for (std::size_t t = 0; t < mesh.tets(); ++t) {
            if (mesh.label(t) != 0 || background) {
                for (const std::uint32_t v : mesh.tet(t)) {
                    corners.push_back(numbered(v));
                }
            }
        }
        io.numberofpoints = static_cast<int>(vertices.size());
        io.pointlist = new REAL[3 * vertices.size()];
        for (std::size_t v = 0; v < vertices.size(); ++v) {
            std::copy_n(mesh.point(vertices[v]), 3, io.pointlist + 3 * v);
        }
        io.numberoftetrahedra = static_cast<int>(corners.size() / 4);
        io.tetrahedronlist = new int[corners.size()];
        std::copy(corners.begin(), corners.end(), io.tetrahedronlist);
        if (facets) {
            io.numberoftrifaces = static_cast<int>(mesh.facets());
            io.trifacelist = new int[3 * mesh.facets()];
            io.trifacemarkerlist = new int[mesh.facets()];
            for (std::size_t f = 0; f < mesh.facets(); ++f) {
                for (int i = 0; i < 3; ++i) {
                    io.trifacelist[3 * f + i] = number[mesh.facet(f)[i]];
                }
                io.trifacemarkerlist[f] = 1;
            }
        }
    }
};

// The number that TetGen prints after a name.
double number_after(const std::string &printed, const std::string &name) {
    const std::size_t at = printed.find(name);
    if (at == std::string::npos) {
        throw std::runtime_error("TetGen printed no " + name);
    }
    return std::strtod(printed.c_str() + at + name.size(), nullptr);
}

// The counts of its histogram of dihedral angles, in increasing order of the angles.
std::vector<std::size_t> dihedral_counts(const std::string &printed) {
    static const std::regex bin("([0-9]+) - *([0-9]+) degrees: *([0-9]+)");
    std::map<int, std::size_t> counts;
    const std::string part = printed.substr(printed.find("Dihedral angle histogram:"));
    for (std::sregex_iterator m(part.begin(), part.end(), bin), end; m != end; ++m) {
        counts[std::stoi((*m)[1])] = std::stoull((*m)[3]);
    }
    std::vector<std::size_t> values;
    for (const auto &[from, count] : counts) {
        values.push_back(count);
    }
    return values;
}

struct Figures {
    Real smallest_volume = std::numeric_limits<double>::max(), largest_volume = 0,
         smallest_dihedral = 180, largest_dihedral = 0, smallest_face_angle = 180,
         largest_face_angle = 0;
};

// TetGen's statistics of a mesh against the same figures measured here, to the digits that it
// prints.
Figures check_statistics(const std::string &printed, const Input &input) {
    Figures figures;
    Histogram histogram({5, 10, 20, 30, 40, 50, 60, 70, 80, 110, 120, 130, 140, 150, 160, 170, 175},
                        1e-6L);
    for (int t = 0; t < input.io.numberoftetrahedra; ++t) {
        std::array<Vector, 4> p;
        for (int i = 0; i < 4; ++i) {
            p[i] = vector(input.io.pointlist + 3 * input.io.tetrahedronlist[4 * t + i]);
        }
        const TetShape shape = tet_shape(p);
        figures.smallest_volume = std::min(figures.smallest_volume, shape.volume);
        figures.largest_volume = std::max(figures.largest_volume, shape.volume);
        for (const Real dihedral : shape.dihedrals) {
            figures.smallest_dihedral = std::min(figures.smallest_dihedral, dihedral);
            figures.largest_dihedral = std::max(figures.largest_dihedral, dihedral);
            histogram.add(dihedral);
        }
        for (int i = 0; i < 4; ++i) {
            for (const Real angle :
                 triangle_angles(p[(i + 1) % 4], p[(i + 2) % 4], p[(i + 3) % 4])) {
                figures.smallest_face_angle = std::min(figures.smallest_face_angle, angle);
                figures.largest_face_angle = std::max(figures.largest_face_angle, angle);
            }
        }
    }
    // Five digits, or four after the point.
    const double digits = 1e-4, places = 1e-4;
    near(number_after(printed, "Smallest volume:"), figures.smallest_volume, digits,
         "TetGen's smallest volume");
    near(number_after(printed, "Largest volume:"), figures.largest_volume, digits,
         "TetGen's largest volume");
    near(number_after(printed, "Smallest facangle:"), figures.smallest_face_angle, digits,
         "TetGen's smallest face angle");
    near(number_after(printed, "Largest facangle:"), figures.largest_face_angle, digits,
         "TetGen's largest face angle");
    near(number_after(printed, "Largest dihedral:"), figures.largest_dihedral, digits,
         "TetGen's largest dihedral angle");
    // TetGen takes its angles from cosines, which tell small ones no better than to some 1e-6
    // degrees.
    check(std::abs(number_after(printed, "Smallest dihedral:") - figures.smallest_dihedral) <=
              digits * figures.smallest_dihedral + places,
          "TetGen's smallest dihedral angle");
    const std::vector<std::size_t> counts = dihedral_counts(printed);
    check(counts.size() == 18 && histogram.agrees(counts), "TetGen's histogram of dihedral angles");
    return figures;
}

// The facets that TetGen's check calls non-Delaunay are ties that it breaks otherwise, each of them
// exact.
void check_complaints(const std::string &printed, const Input &input,
                      const std::vector<Point> &points) {
    static const std::regex line(
        "Non-locally Delaunay \\(([0-9]+), ([0-9]+), ([0-9]+)\\) - ([0-9]+), ([0-9]+)");
    std::size_t complaints = 0, ties = 0;
    for (std::sregex_iterator m(printed.begin(), printed.end(), line), end; m != end; ++m) {
        std::array<std::uint32_t, 5> v;
        for (int i = 0; i < 5; ++i) {
            v[i] = input.vertices.at(std::stoul((*m)[i + 1]));
        }
        ++complaints;
        ties += side_of_sphere(points, {v[0], v[1], v[2], v[3]}, v[4]) == CGAL::ON_BOUNDARY;
    }
    if (complaints == 0) {
        says(printed, "The mesh is Delaunay.");
    } else {
        says(printed, ("Found " + std::to_string(complaints) + " non-Delaunay faces.").c_str());
    }
    check(ties == complaints, "facets that TetGen finds not Delaunay are exact ties");
    std::printf("TetGen -rCC: consistent and Delaunay, but for %zu facets that are exact ties\n",
                complaints);
}

// We hand over no segments; TetGen infers them from the angles between facets, and takes a vertex
// with two of them in line for one that it once put on a segment itself. It expects these two to
// run in one direction, and complains where they do not. That is the only complaint allowed here.
void check_segments(const std::string &printed) {
    static const std::regex complaint("\n  !! ([^\n]*)");
    std::size_t complaints = 0;
    for (std::sregex_iterator m(printed.begin(), printed.end(), complaint), end; m != end; ++m) {
        const std::string text = (*m)[1];
        if (text.rfind("!! !! !! Found", 0) != 0) {
            check(text.rfind("Wrong seg-seg connection at point", 0) == 0,
                  "TetGen complains: " + text);
            ++complaints;
        }
    }
    if (complaints == 0) {
        says(printed, "Segments are connected properly.");
        return;
    }
    const double inferred = number_after(printed, "Steiner points on segments:");
    check(static_cast<double>(complaints) <= inferred,
          "complaints are about vertices that TetGen puts on segments");
    std::printf("TetGen -rC: complains about the direction of segments at %zu of the %g vertices "
                "that it takes for "
                "points put on segments\n",
                complaints, inferred);
}

void check_ours(const Meshing &mesh, const std::vector<Point> &points) {
    // -r reads a mesh, -O0 leaves it as it is, -C checks it, -CC its Delaunay property too, -V
    // measures it.
    {
        // With the interfaces, which must be facets of tets.
        Input input(mesh, true, true);
        tetgenio out;
        const std::string printed = tetrahedralized("rO0CV", input.io, out);
        says(printed, "In my studied opinion, the mesh appears to be consistent.");
        says(printed, "Mesh boundaries connected correctly.");
        check_segments(printed);
        check(printed.find("is missing") == std::string::npos,
              "TetGen finds every interface facet");
        check(printed.find("Warning") == std::string::npos,
              "TetGen reads the mesh without a warning: " + printed.substr(0, 2000));
        check(out.numberoftetrahedra == input.io.numberoftetrahedra &&
                  out.numberofpoints == input.io.numberofpoints,
              "TetGen keeps the mesh as it is");
        check_statistics(printed, input);
    }
    {
        // TetGen exempts facets on boundaries from its Delaunay check, so here is none.
        Input input(mesh, true, false);
        tetgenio out;
        const std::string printed = tetrahedralized("rO0CC", input.io, out);
        says(printed, "In my studied opinion, the mesh appears to be consistent.");
        check_complaints(printed, input, points);
    }
    {
        Input input(mesh, false, false);
        tetgenio out;
        const std::string printed = tetrahedralized("rO0CCV", input.io, out);
        says(printed, "In my studied opinion, the mesh appears to be consistent.");
        check_complaints(printed, input, points);
        const Figures figures = check_statistics(printed, input);
        lapd_quality reported{};
        reported.struct_size = sizeof reported;
        check(lapd_mesh_get_quality(mesh.mesh(), &reported) == LAPD_OK, "quality");
        near(figures.smallest_dihedral, reported.min_dihedral, 1e-9, "our smallest dihedral angle");
        near(figures.largest_dihedral, reported.max_dihedral, 1e-9, "our largest dihedral angle");
        std::printf(
            "TetGen's statistics of the tissues: dihedral angles %g to %g degrees, volumes from %g "
            "to %g: ours "
            "to its digits\n",
            number_after(printed, "Smallest dihedral:"), number_after(printed, "Largest dihedral:"),
            number_after(printed, "Smallest volume:"), number_after(printed, "Largest volume:"));
    }
}

void checks(int argc, char **argv) {
    if (argc != 4) {
        throw std::runtime_error("usage: tetgen NAME DELTA SIZE");
    }
    const Meshing mesh(argv[1], std::atof(argv[2]), std::atof(argv[3]));
    const std::vector<Point> points = cgal_points(mesh);
    compare_with_tetgen(mesh, points);
    check_ours(mesh, points);
}

} // namespace

int main(int argc, char **argv) {
    return run(argc, argv, checks);
}
