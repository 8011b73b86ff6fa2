// cgal_delaunay_3: how long CGAL's Delaunay_triangulation_3 takes for the vertices of one of our
// meshes.
//
//   cgal_delaunay_3 collect IMAGE DELTA SIZE THREADS POINTS
//       meshes the image with lapd, and writes all vertices of the triangulation, those of the
//       background and of the box too
//   cgal_delaunay_3 time POINTS
//       prints a JSON object: version, vertices, tets, seconds
//
// Purpose: a yardstick for refinement. It has to make the same triangulation, and to find the
// vertices besides. Licence: CGAL's triangulations are GPL-3.0-or-later, and so is this program. It
// is a separate program; the library never links it. Method: exact predicates and inexact
// constructions, sequential; insertion of the range with CGAL's own spatial sort, on the clock.
// Format: POINTS has three doubles for each vertex, in this machine's byte order.

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/version.h>

#include <lapd.hpp>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Delaunay = CGAL::Delaunay_triangulation_3<Kernel>;
using Point = Kernel::Point_3;

const char *const USAGE = "usage: cgal_delaunay_3 collect IMAGE DELTA SIZE THREADS POINTS | "
                          "cgal_delaunay_3 time POINTS\n";

double number(const std::string &text) {
    char *end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    if (end == text.c_str() || *end != '\0' || !(value > 0))
        throw std::invalid_argument("not a number above 0: " + text);
    return value;
}

void collect(const std::string &path, double delta, double size, double threads,
             const std::string &output) {
    lapd::context context;
    lapd::params params;
    params.set_delta(delta)
        .set_size(size)
        .set_threads(static_cast<std::size_t>(threads))
        .set_background(true);
    // As the runs beside it.
    params.set_adaptive(LAPD_ADAPTIVE_OFF).set_improve(LAPD_IMPROVE_NONE);
    const lapd::image image = lapd::image::read(context, path);
    const lapd::mesh mesh = lapd::mesh::make(context, image, params);
    const auto coordinates = mesh.points().values();
    std::ofstream file(output, std::ios::binary);
    file.write(reinterpret_cast<const char *>(coordinates.data()),
               static_cast<std::streamsize>(coordinates.size() * sizeof(double)));
    if (!file.flush())
        throw std::runtime_error(output + ": cannot be written");
}

std::vector<Point> read_points(const std::string &path) {
    std::ifstream file(path, std::ios::binary);
    std::vector<Point> points;
    double p[3];
    while (file.read(reinterpret_cast<char *>(p), sizeof p))
        points.emplace_back(p[0], p[1], p[2]);
    if (points.empty())
        throw std::runtime_error(path + ": no points in it");
    return points;
}

void time(const std::string &path) {
    const std::vector<Point> points = read_points(path);
    Delaunay triangulation;
    const auto start = std::chrono::steady_clock::now();
    triangulation.insert(points.begin(), points.end());
    const double seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::cout << "{\"version\": \"CGAL " << CGAL_STR(CGAL_VERSION)
              << "\", \"vertices\": " << triangulation.number_of_vertices()
              << ", \"tets\": " << triangulation.number_of_finite_cells()
              << ", \"seconds\": " << seconds << "}\n";
}

} // namespace

int main(int argc, char **argv) {
    const std::vector<std::string> arguments(argv + 1, argv + argc);
    try {
        if (arguments.size() == 6 && arguments[0] == "collect") {
            collect(arguments[1], number(arguments[2]), number(arguments[3]), number(arguments[4]),
                    arguments[5]);
        } else if (arguments.size() == 2 && arguments[0] == "time") {
            time(arguments[1]);
        } else {
            std::cerr << USAGE;
            return 2;
        }
    } catch (const std::exception &e) {
        std::cerr << "cgal_delaunay_3: " << e.what() << "\n";
        return 1;
    }
    return 0;
}
