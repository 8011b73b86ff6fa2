// CGAL's tetrahedral_isotropic_remeshing on a mesh of several labels (remesh.py):
//
//   cgal_remesh IN.mesh EDGE OUT.mesh [keep]
//
// EDGE is the edge length asked for; with "keep" the interfaces stay as they are. Prints the
// seconds of the remeshing alone.

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/IO/File_medit.h>
#include <CGAL/Tetrahedral_remeshing/Remeshing_triangulation_3.h>
#include <CGAL/tetrahedral_remeshing.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Triangulation = CGAL::Tetrahedral_remeshing::Remeshing_triangulation_3<Kernel>;

int main(int argc, char **argv) {
    if (argc < 4) {
        std::fprintf(stderr, "usage: cgal_remesh IN.mesh EDGE OUT.mesh [keep]\n");
        return 2;
    }
    Triangulation triangulation;
    std::ifstream in(argv[1]);
    if (!CGAL::IO::read_MEDIT(in, triangulation)) {
        std::fprintf(stderr, "cgal_remesh: %s cannot be read\n", argv[1]);
        return 1;
    }
    const bool keep = argc > 4 && std::string(argv[4]) == "keep";
    const auto start = std::chrono::steady_clock::now();
    CGAL::tetrahedral_isotropic_remeshing(triangulation, std::atof(argv[2]),
                                          CGAL::parameters::remesh_boundaries(!keep));
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    std::ofstream out(argv[3]);
    out.precision(17);
    CGAL::IO::write_MEDIT(out, triangulation);
    std::printf("%.3f\n", seconds.count());
    return out ? 0 : 1;
}
