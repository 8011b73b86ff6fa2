// cgal_mesh_3: meshes a label image with CGAL's Mesh_3 and reports speed and quality as JSON.
//
// Purpose: the reference of the comparisons in this project, run on the same image and at about as
// many tets. Licence: CGAL's Mesh_3 is GPL-3.0-or-later, and so is this program. It is a separate
// program; the library never links it. Method:  the surfaces are those of Labeled_mesh_domain_3 for
// a label image: the label of a point is the one whose indicator,
//          interpolated trilinearly between the eight voxel centres around it, is largest.
//          Refinement only: no exudation, no perturbation, no optimisation, so that what is timed
//          is Delaunay refinement; --optimize adds perturbation and exudation after it, each for at
//          most so many seconds, --optimizers without a limit, as is CGAL's default. The label
//          weights of CGAL are off.
// Timing:  `seconds.refine` is the wall time of make_mesh_3, `cpu_seconds` the user CPU time of the
// whole process in it.
//          `seconds.optimize` is that of perturbation and exudation.
//          Reading, measuring and writing are outside of all. `peak_rss_bytes` is taken when
//          make_mesh_3 returns.

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Image_3.h>
#include <CGAL/Labeled_mesh_domain_3.h>
#include <CGAL/Mesh_complex_3_in_triangulation_3.h>
#include <CGAL/Mesh_criteria_3.h>
#include <CGAL/Mesh_triangulation_3.h>
#include <CGAL/make_mesh_3.h>
#include <CGAL/version.h>

#include <lapd.h>

#include <tbb/global_control.h>
#include <tbb/version.h>

#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>

#ifndef CGAL_LINKED_WITH_TBB
#error "without TBB CGAL's Parallel_tag silently runs sequentially"
#endif

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Domain = CGAL::Labeled_mesh_domain_3<Kernel>;
namespace params = CGAL::parameters;

constexpr double PI = 3.14159265358979323846;

// What the command line asks for; lengths in the image's units, angles in degrees.
struct Options {
    std::string image, report, output;
    double facet_angle = 30, facet_size = 0, facet_distance = 0, cell_radius_edge = 2,
           cell_size = 0;
    bool optimizes = false;
    double optimize = 0; // seconds for each of perturbation and exudation, 0 for no limit
    bool parallel = true;
    unsigned threads = std::max(1u, std::thread::hardware_concurrency());
};

const char *const USAGE =
    "usage: cgal_mesh_3 IMAGE --facet-size A --facet-distance D --cell-size S\n"
    "                   [--facet-angle 30] [--cell-radius-edge 2] [--sequential | --parallel] "
    "[--threads N]\n"
    "                   [--optimize SECONDS | --optimizers] [--report OUT.json] [-o OUT.mesh]\n";

Options parse(int argc, char **argv) {
    Options o;
    for (int i = 1; i < argc; ++i) {
        const std::string arg = argv[i];
        auto text = [&]() -> std::string {
            if (i + 1 >= argc)
                throw std::invalid_argument(arg + " needs a value");
            return argv[++i];
        };
        auto number = [&]() {
            const std::string value = text();
            char *end = nullptr;
            const double x = std::strtod(value.c_str(), &end);
            if (end == value.c_str() || *end != '\0' || !std::isfinite(x) || x <= 0)
                throw std::invalid_argument(arg + " must be a number above 0, got " + value);
            return x;
        };
        if (arg == "--facet-angle")
            o.facet_angle = number();
        else if (arg == "--facet-size")
            o.facet_size = number();
        else if (arg == "--facet-distance")
            o.facet_distance = number();
        else if (arg == "--cell-radius-edge")
            o.cell_radius_edge = number();
        else if (arg == "--cell-size")
            o.cell_size = number();
        else if (arg == "--optimize")
            o.optimizes = true, o.optimize = number();
        else if (arg == "--optimizers")
            o.optimizes = true;
        else if (arg == "--sequential")
            o.parallel = false;
        else if (arg == "--parallel")
            o.parallel = true;
        else if (arg == "--threads")
            o.threads = static_cast<unsigned>(std::max(1.0, number()));
        else if (arg == "--report")
            o.report = text();
        else if (arg == "-o")
            o.output = text();
        else if (arg.size() > 1 && arg[0] == '-')
            throw std::invalid_argument("unknown option " + arg);
        else if (o.image.empty())
            o.image = arg;
        else
            throw std::invalid_argument("a second image " + arg);
    }
    if (o.image.empty())
        throw std::invalid_argument("no image given");
    if (o.facet_size == 0 || o.facet_distance == 0 || o.cell_size == 0)
        throw std::invalid_argument("--facet-size, --facet-distance and --cell-size are needed");
    if (!o.parallel)
        o.threads = 1;
    return o;
}

void check(lapd_status status, lapd_context *context) {
    if (status != LAPD_OK) {
        const char *message = context ? lapd_context_last_error(context) : "";
        throw std::runtime_error(*message ? message : lapd_status_message(status));
    }
}

// The one place where the image comes in, by the library's own reader: the voxels are the same by
// construction. Labels must fit 16 bits, unsigned. CGAL counts everything beyond the outermost
// voxel centres as outside, so a layer of label 0 is put around them; axes are the image's own,
// with no rotation.
CGAL::Image_3 load_image(const std::string &path) {
    lapd_context *opened = nullptr;
    check(lapd_context_create(&opened), nullptr);
    const std::unique_ptr<lapd_context, decltype(&lapd_context_free)> context(opened,
                                                                              lapd_context_free);
    lapd_image *read = nullptr;
    check(lapd_image_read(context.get(), path.c_str(), LAPD_WORLD_AS_STORED, &read), context.get());
    const std::unique_ptr<lapd_image, decltype(&lapd_image_free)> image(read, lapd_image_free);
    std::array<std::size_t, 3> dims;
    std::array<double, 3> spacing;
    check(lapd_image_get_dims(image.get(), dims.data()), nullptr);
    check(lapd_image_get_spacing(image.get(), spacing.data()), nullptr);
    std::vector<std::int32_t> labels(dims[0] * dims[1] * dims[2]);
    check(lapd_image_copy_voxels(image.get(), labels.data(), labels.size()), nullptr);

    const std::array<std::size_t, 3> padded{dims[0] + 2, dims[1] + 2, dims[2] + 2};
    _image *raw = _createImage(padded[0], padded[1], padded[2], 1, spacing[0], spacing[1],
                               spacing[2], 2, WK_FIXED, SGN_UNSIGNED);
    if (raw == nullptr)
        throw std::runtime_error(path + ": no memory for CGAL's image");
    const CGAL::Image_3 result(raw);
    raw->tx = static_cast<float>(-spacing[0]);
    raw->ty = static_cast<float>(-spacing[1]);
    raw->tz = static_cast<float>(-spacing[2]);
    auto *out = static_cast<std::uint16_t *>(raw->data);
    std::fill(out, out + padded[0] * padded[1] * padded[2], std::uint16_t{0});
    auto label = labels.cbegin();
    for (std::size_t k = 1; k <= dims[2]; ++k)
        for (std::size_t j = 1; j <= dims[1]; ++j)
            for (std::size_t i = 1; i <= dims[0]; ++i, ++label) {
                if (*label < 0 || *label > 65535)
                    throw std::runtime_error(path + ": label " + std::to_string(*label) +
                                             " does not fit 16 bits, unsigned");
                out[i + padded[0] * (j + padded[1] * k)] = static_cast<std::uint16_t>(*label);
            }
    return result;
}

// Voxels per label, without label 0.
std::map<int, std::size_t> count_voxels(const CGAL::Image_3 &image) {
    std::map<int, std::size_t> labels;
    const auto *data = static_cast<const std::uint16_t *>(image.image()->data);
    std::vector<std::size_t> count(65536, 0);
    for (std::size_t i = 0; i < image.size(); ++i)
        ++count[data[i]];
    for (int label = 1; label < 65536; ++label)
        if (count[label] > 0)
            labels[label] = count[label];
    return labels;
}

struct Spent {
    double wall, user;
    std::size_t peak_bytes; // of resident memory, from the start of the process on
    static Spent now() {
        rusage usage{};
        getrusage(RUSAGE_SELF, &usage);
        const auto clock = std::chrono::steady_clock::now().time_since_epoch();
        return {std::chrono::duration<double>(clock).count(),
                usage.ru_utime.tv_sec + 1e-6 * usage.ru_utime.tv_usec,
                static_cast<std::size_t>(usage.ru_maxrss) * 1024};
    }
};

struct LabelSum {
    std::size_t tets = 0;
    double volume = 0;
};

struct Quality {
    std::map<int, LabelSum> labels;
    double min_dihedral = 180, max_dihedral = 0, max_radius_edge = 0, min_facet_angle = 180;
    std::array<std::size_t, 18>
        histogram{}; // all six dihedral angles of every tet, in bins of 10 degrees
    std::size_t interface_facets = 0, vertices = 0;
};

double degrees(double cosine) {
    return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / PI;
}

double planar_angle(const Kernel::Vector_3 &u, const Kernel::Vector_3 &v) {
    return degrees(u * v / std::sqrt(u.squared_length() * v.squared_length()));
}

template <class C3t3> Quality measure(const C3t3 &mesh) {
    using Vertex_handle = typename C3t3::Vertex_handle;
    Quality q;
    std::set<Vertex_handle> used;
    for (auto cell = mesh.cells_in_complex_begin(); cell != mesh.cells_in_complex_end(); ++cell) {
        std::array<Kernel::Point_3, 4> p;
        for (int i = 0; i < 4; ++i) {
            used.insert(cell->vertex(i));
            p[i] = mesh.triangulation().point(cell, i).point();
        }
        auto &sum = q.labels[mesh.subdomain_index(cell)];
        ++sum.tets;
        sum.volume += std::abs(CGAL::volume(p[0], p[1], p[2], p[3]));
        double shortest = std::numeric_limits<double>::max();
        std::array<Kernel::Vector_3, 4>
            normal; // outward or all inward: the angle between two faces needs only that they agree
        for (int i = 0; i < 4; ++i) {
            const auto &a = p[(i + 1) % 4], &b = p[(i + 2) % 4], &c = p[(i + 3) % 4];
            const auto n = CGAL::cross_product(b - a, c - a);
            normal[i] = (n * (p[i] - a) > 0 ? 1.0 : -1.0) * n;
        }
        for (int i = 0; i < 4; ++i)
            for (int j = i + 1; j < 4; ++j) {
                shortest = std::min(shortest, CGAL::squared_distance(p[i], p[j]));
                const double angle = 180 - planar_angle(normal[i], normal[j]);
                q.min_dihedral = std::min(q.min_dihedral, angle);
                q.max_dihedral = std::max(q.max_dihedral, angle);
                ++q.histogram[std::min(17, static_cast<int>(angle / 10))];
            }
        q.max_radius_edge = std::max(
            q.max_radius_edge, std::sqrt(CGAL::squared_radius(p[0], p[1], p[2], p[3]) / shortest));
    }
    q.vertices = used.size();
    for (auto facet = mesh.facets_in_complex_begin(); facet != mesh.facets_in_complex_end();
         ++facet) {
        ++q.interface_facets;
        std::array<Kernel::Point_3, 3> p;
        for (int i = 0; i < 3; ++i)
            p[i] = mesh.triangulation().point(facet->first, (facet->second + 1 + i) % 4).point();
        for (int i = 0; i < 3; ++i)
            q.min_facet_angle = std::min(
                q.min_facet_angle, planar_angle(p[(i + 1) % 3] - p[i], p[(i + 2) % 3] - p[i]));
    }
    return q;
}

std::string quoted(const std::string &s) {
    std::string out = "\"";
    for (const char c : s) {
        if (c == '"' || c == '\\')
            out += '\\';
        out += c;
    }
    return out + '"';
}

std::string version() {
    return std::string("CGAL ") + CGAL_STR(CGAL_VERSION) + " with TBB " +
           std::to_string(TBB_VERSION_MAJOR) + "." + std::to_string(TBB_VERSION_MINOR);
}

void write_report(std::ostream &os, const Options &o, const CGAL::Image_3 &image,
                  std::size_t all_tets, const Spent &spent, double seconds_optimize,
                  double seconds_read, const Quality &q) {
    const auto voxels = count_voxels(image);
    const double voxel_volume = std::abs(image.vx() * image.vy() * image.vz());
    std::size_t tets = 0;
    for (const auto &[label, sum] : q.labels)
        tets += sum.tets;

    os << std::setprecision(8) << "{ \"version\": " << quoted(version())
       << ", \"input\": " << quoted(o.image) << ",\n  \"algorithm\": \""
       << (o.parallel ? "Parallel_tag" : "Sequential_tag") << "\", \"threads\": " << o.threads
       << ",\n  \"criteria\": {\"facet_angle\": " << o.facet_angle
       << ", \"facet_size\": " << o.facet_size << ", \"facet_distance\": " << o.facet_distance
       << ", \"cell_radius_edge\": " << o.cell_radius_edge << ", \"cell_size\": " << o.cell_size
       << "}"
       << ",\n  \"tets\": " << tets << ", \"vertices\": " << q.vertices
       << ", \"interface_facets\": " << q.interface_facets << ", \"all_tets\": " << all_tets
       << ", \"peak_rss_bytes\": " << spent.peak_bytes
       << ",\n  \"seconds\": {\"read\": " << seconds_read << ", \"refine\": " << spent.wall
       << ", \"optimize\": " << seconds_optimize << "}, \"cpu_seconds\": " << spent.user
       << ", \"tets_per_second\": " << tets / spent.wall
       << ", \"tets_per_cpu_second\": " << tets / spent.user
       << ",\n  \"quality\": {\"min_dihedral\": " << q.min_dihedral
       << ", \"max_dihedral\": " << q.max_dihedral << ", \"max_radius_edge\": " << q.max_radius_edge
       << ", \"min_facet_angle\": " << q.min_facet_angle << ", \"dihedral_histogram\": [";
    for (std::size_t i = 0; i < q.histogram.size(); ++i)
        os << (i ? ", " : "") << q.histogram[i];
    os << "]},\n  \"labels_lost\": [";
    bool first = true;
    for (const auto &[label, count] : voxels)
        if (!q.labels.count(label)) {
            os << (first ? "" : ", ") << label;
            first = false;
        }
    os << "],\n  \"labels\": [";
    first = true;
    for (const auto &[label, count] : voxels) {
        const auto found = q.labels.find(label);
        const LabelSum sum = found == q.labels.end() ? LabelSum{} : found->second;
        os << (first ? "\n    " : ",\n    ") << "{\"label\": " << label
           << ", \"tets\": " << sum.tets << ", \"mesh_volume\": " << sum.volume
           << ", \"image_volume\": " << count * voxel_volume << ", \"voxels\": " << count << "}";
        first = false;
    }
    os << "] }\n";
}

template <class Concurrency> void run(const Options &o) {
    using Triangulation =
        typename CGAL::Mesh_triangulation_3<Domain, CGAL::Default, Concurrency>::type;
    using C3t3 = CGAL::Mesh_complex_3_in_triangulation_3<Triangulation>;
    using Criteria = CGAL::Mesh_criteria_3<Triangulation>;
    static_assert(std::is_same<typename Triangulation::Concurrency_tag, Concurrency>::value,
                  "the tag asked for is the one that runs");

    const Spent start = Spent::now();
    const CGAL::Image_3 image = load_image(o.image);
    const Spent read = Spent::now();
    const Domain domain = Domain::create_labeled_image_mesh_domain(image);
    const Criteria criteria(params::facet_angle = o.facet_angle, params::facet_size = o.facet_size,
                            params::facet_distance = o.facet_distance,
                            params::cell_radius_edge_ratio = o.cell_radius_edge,
                            params::cell_size = o.cell_size);
    const Spent before = Spent::now();
    C3t3 mesh = CGAL::make_mesh_3<C3t3>(domain, criteria, params::no_perturb(), params::no_exude());
    const Spent after = Spent::now();
    if (o.optimizes) {
        CGAL::perturb_mesh_3(mesh, domain, params::time_limit = o.optimize);
        CGAL::exude_mesh_3(mesh, params::time_limit = o.optimize);
    }

    const Spent optimized = Spent::now();
    const Quality quality = measure(mesh);
    const Spent spent{after.wall - before.wall, after.user - before.user, after.peak_bytes};
    auto report = [&](std::ostream &os) {
        const auto all_tets = mesh.triangulation().number_of_finite_cells();
        write_report(os, o, image, all_tets, spent, optimized.wall - after.wall,
                     read.wall - start.wall, quality);
    };
    if (o.report.empty()) {
        report(std::cout);
    } else {
        std::ofstream os(o.report);
        report(os);
        if (!os.flush())
            throw std::runtime_error(o.report + ": cannot be written");
    }
    if (!o.output.empty()) {
        std::ofstream os(o.output);
        os << std::setprecision(9);
        mesh.output_to_medit(os, /* renumber labels */ false, /* patches */ false);
        if (!os.flush())
            throw std::runtime_error(o.output + ": cannot be written");
    }
}

} // namespace

int main(int argc, char **argv) {
    Options options;
    try {
        options = parse(argc, argv);
    } catch (const std::exception &e) {
        std::cerr << "cgal_mesh_3: " << e.what() << "\n" << USAGE;
        return 2;
    }
    try {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                        options.threads);
        if (options.parallel)
            run<CGAL::Parallel_tag>(options);
        else
            run<CGAL::Sequential_tag>(options);
    } catch (const std::exception &e) {
        std::cerr << "cgal_mesh_3: " << e.what() << "\n";
        return 1;
    }
    return 0;
}
