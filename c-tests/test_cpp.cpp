// lapd.hpp, compiled as C++17 and as C++20: ownership, views, errors, and exceptions of callbacks.
#include <lapd.hpp>

#include <chrono>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>
#if __cplusplus >= 202002L
#include <algorithm>
#include <span>
#endif

#include "check.h"

namespace {

// The status that a call fails with; LAPD_OK when it does not.
template <class Call> lapd_status status_of(Call call) {
    try {
        call();
    } catch (const lapd::error &error) {
        CHECK(std::strlen(error.what()) > 0);
        return error.status();
    }
    return LAPD_OK;
}

// Whether a call throws a std::runtime_error with this text.
template <class Call> bool throws(Call call, const char *text) {
    try {
        call();
    } catch (const std::runtime_error &error) {
        return std::strcmp(error.what(), text) == 0;
    }
    return false;
}

constexpr std::size_t n = 8;

// A block of label 5 with one of label 9 in it.
template <class T> std::vector<T> block() {
    std::vector<T> voxels(n * n * n);
    for (std::size_t i = 0; i < voxels.size(); i++) {
        const std::size_t x = i % n, y = i / n % n, z = i / n / n;
        const bool outer = x > 0 && x < 7 && y > 0 && y < 7 && z > 0 && z < 7;
        const bool inner = x > 2 && x < 6 && y > 2 && y < 6 && z > 2 && z < 6;
        voxels[i] = static_cast<T>(inner ? 9 : outer ? 5 : 0);
    }
    return voxels;
}

lapd::grid cube() {
    lapd::grid grid;
    grid.dims = {n, n, n};
    return grid;
}

lapd::image block_image(lapd::context &context) {
    // The voxels are gone when the image is used.
    return lapd::image::create(context, block<std::uint8_t>().data(), cube());
}

void types() {
    static_assert(!std::is_copy_constructible_v<lapd::context> &&
                  std::is_nothrow_move_constructible_v<lapd::context>);
    static_assert(!std::is_copy_constructible_v<lapd::image> &&
                  std::is_nothrow_move_constructible_v<lapd::image>);
    static_assert(!std::is_copy_constructible_v<lapd::params> &&
                  std::is_nothrow_move_constructible_v<lapd::params>);
    static_assert(!std::is_copy_constructible_v<lapd::mesh> &&
                  std::is_nothrow_move_constructible_v<lapd::mesh>);
    static_assert(std::is_nothrow_move_assignable_v<lapd::mesh> &&
                  std::is_nothrow_move_assignable_v<lapd::image>);
    static_assert(std::is_trivially_copyable_v<lapd::span<double>> &&
                  lapd::rows<double, 3>::width == 3);
    CHECK(std::strcmp(lapd::version(), LAPD_VERSION) == 0);
#if __cplusplus >= 202002L
    static_assert(std::ranges::contiguous_range<lapd::span<int>> &&
                  std::ranges::view<lapd::span<int>>);
    static_assert(std::is_convertible_v<lapd::span<int>, std::span<const int>>);
#endif
}

// Intensities and probabilities, from memory and from files.
void values() {
    lapd::context context;
    const std::vector<float> intensities = block<float>();
    const std::vector<std::int32_t> swapped{9, 5};
    const lapd::image gray =
        lapd::image::create_gray(context, intensities.data(), cube(), {4.5, 8.5}, {5, 9});
    CHECK(gray.voxels() == block<std::int32_t>());
    CHECK(lapd::image::create_gray(context, intensities.data(), cube(), {4.5}).labels()[0] == 1);
    CHECK(status_of([&] {
              lapd::image::create_gray(context, intensities.data(), cube(), {4.5}, swapped);
          }) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(status_of([&] { lapd::image::read_gray(context, "none.nrrd", {1}); }) == LAPD_ERROR_IO);
    CHECK(status_of([&] {
              lapd::image::read_gray(context, "none.nrrd", {1}, {}, LAPD_WORLD_RAS);
          }) == LAPD_ERROR_IO);

    std::vector<float> inner(intensities.size()), outer(intensities.size());
    for (std::size_t i = 0; i < inner.size(); i++) {
        inner[i] = intensities[i] > 8 ? 0.9F : 0;
        outer[i] = intensities[i] > 4 ? 0.8F : 0;
    }
    const std::vector<const float *> maps{inner.data(), outer.data()};
    CHECK(lapd::image::create_probabilities(context, maps, swapped, cube()).voxels() ==
          block<std::int32_t>());
    CHECK(status_of([&] { lapd::image::create_probabilities(context, maps, {1}, cube()); }) ==
          LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(status_of([&] { lapd::image::read_probabilities(context, {"none.nrrd"}); }) ==
          LAPD_ERROR_IO);
    CHECK(status_of([&] { lapd::image::read_level_sets(context, {"none.nrrd"}); }) ==
          LAPD_ERROR_IO);
    CHECK(status_of([&] {
              lapd::image::read_probabilities(context, {"none.nrrd"}, {}, LAPD_WORLD_LPS);
          }) == LAPD_ERROR_IO);
    CHECK(lapd::params().set_sigma(1.5).sigma() == 1.5);
}

void images() {
    lapd::context context;
    const std::vector<std::int32_t> expected = block<std::int32_t>();
    // Every integer type, whatever its name.
    CHECK(lapd::image::create(context, block<char>().data(), cube()).voxels() == expected);
    CHECK(lapd::image::create(context, block<signed char>().data(), cube()).voxels() == expected);
    CHECK(lapd::image::create(context, block<unsigned char>().data(), cube()).voxels() == expected);
    CHECK(lapd::image::create(context, block<short>().data(), cube()).voxels() == expected);
    CHECK(lapd::image::create(context, block<unsigned short>().data(), cube()).voxels() ==
          expected);
    CHECK(lapd::image::create(context, block<int>().data(), cube()).voxels() == expected);
    CHECK(lapd::image::create(context, block<unsigned>().data(), cube()).voxels() == expected);
    CHECK(lapd::image::create(context, block<long>().data(), cube()).voxels() == expected);
    CHECK(lapd::image::create(context, block<unsigned long>().data(), cube()).voxels() == expected);
    CHECK(lapd::image::create(context, block<long long>().data(), cube()).voxels() == expected);
    CHECK(lapd::image::create(context, block<unsigned long long>().data(), cube()).voxels() ==
          expected);

    // Read backwards along x, placed in the world with a reflection.
    lapd::grid grid = cube();
    grid.origin = {1, 2, 3};
    grid.spacing = {0.5, 1, 2};
    grid.direction = {0, 1, 0, 1, 0, 0, 0, 0, 1};
    grid.strides = {{-1, n, n * n}};
    const lapd::image image = lapd::image::create(context, expected.data() + (n - 1), grid);
    CHECK(image.dims() == grid.dims && image.origin() == grid.origin);
    CHECK(image.spacing() == grid.spacing && image.direction() == grid.direction);
    CHECK(image.voxels()[1] == expected[n - 2]);
    CHECK(image.world_axes() == LAPD_AXES_UNKNOWN);
    const lapd::span<std::int32_t> labels = image.labels();
    CHECK(labels.size() == 2 && !labels.empty() && labels[0] == 5 &&
          *std::next(labels.begin()) == 9);
    CHECK(image.warning_count() == 0);

    // One voxel of label 7 in a frame of its own, read in the same and in another one.
    const char *const name = "test_cpp_frame.nrrd";
    std::ofstream(name)
        << "NRRD0004\ntype: uchar\ndimension: 3\nspace: left-posterior-superior\nsizes: 1 1 1\n"
           "space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (10,20,30)\nencoding: "
           "text\n\n7\n";
    const lapd::image stored = lapd::image::read(context, name);
    CHECK(stored.world_axes() == LAPD_AXES_LPS && stored.origin()[0] == 10 &&
          stored.labels()[0] == 7);
    const lapd::image turned = lapd::image::read(context, name, LAPD_WORLD_RAS);
    CHECK(turned.world_axes() == LAPD_AXES_RAS && turned.origin()[0] == -10 &&
          turned.origin()[2] == 30);
    CHECK(stored.label_name(1) == nullptr);
    lapd::image named = lapd::image::read(context, name);
    named.set_label_name(context, 7, "liver");
    CHECK(named.label_name(7) == std::string("liver"));
    CHECK(status_of([&] { named.read_label_names(context, "no_such_table.txt"); }) ==
          LAPD_ERROR_IO);
    const auto in_order = [&](const std::vector<std::size_t> &order) {
        return status_of([&] {
            lapd::image::read_labels(context, name, LAPD_WORLD_AS_STORED, LAPD_LABELS_WHOLE, order);
        });
    };
    CHECK(in_order({}) == LAPD_OK);
    CHECK(in_order({0}) == LAPD_ERROR_INVALID_ARGUMENT);
    std::remove(name);
    CHECK(status_of([&] { image.warning(0); }) == LAPD_ERROR_INVALID_ARGUMENT);
}

void errors() {
    lapd::context context;
    CHECK(std::strcmp(context.last_error(), "") == 0);
    CHECK(status_of([&] { lapd::image::read(context, "no/such/file.nrrd"); }) == LAPD_ERROR_IO);
    CHECK(std::strstr(context.last_error(), "no/such/file.nrrd") != nullptr);
    CHECK(status_of([&] { lapd::image::create(context, block<int>().data(), lapd::grid{}); }) ==
          LAPD_ERROR_INVALID_ARGUMENT);
    try {
        lapd::params().set_delta(-1);
        CHECK(!"set_delta threw");
    } catch (const lapd::error &error) {
        CHECK(std::strstr(error.what(), "delta") != nullptr);
    }

    // What was moved from holds nothing, and says so.
    const lapd::image image = block_image(context);
    lapd::params params;
    lapd::context other = std::move(context);
    CHECK(context.get() == nullptr && other.get() != nullptr);
    CHECK(status_of([&] { lapd::mesh::make(context, image, params); }) ==
          LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(status_of([&] { context.set_log(nullptr); }) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(status_of([&] { context.reset_cancel(); }) == LAPD_ERROR_INVALID_ARGUMENT);
    context.cancel();
    lapd::mesh mesh = lapd::mesh::make(other, image, params);
    const lapd::mesh moved = std::move(mesh);
    CHECK(status_of([&] { mesh.points(); }) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(status_of([&] { mesh.counts(); }) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(moved.points().size() > 0);
    const lapd::params moved_params = std::move(params);
    CHECK(status_of([&] { params.set_delta(1); }) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(status_of([&] { params.delta(); }) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(moved_params.delta() > 0);
}

void parameters() {
    lapd::params params;
    params.set_delta(0.5).set_size(1.5).set_radius_edge(2.5).set_facet_angle(25).set_surface(
        LAPD_SURFACE_VOXEL);
    params.set_border(LAPD_BORDER_SMOOTH);
    params.set_keep({5, -9}).set_background(true).set_threads(2).set_max_vertices(100000);
    params.set_algorithm(LAPD_ALGORITHM_LAPD)
        .set_contention(LAPD_CONTENTION_RANDOM)
        .set_improve(LAPD_IMPROVE_INTERIOR)
        .set_target_dihedral(12);
    params.set_begging(LAPD_BEGGING_FLAT)
        .set_topology("")
        .set_bind(true)
        .set_count_accesses(true)
        .set_timeline(true);
    params.set_time_limit(2.5).set_max_memory(std::uint64_t{1} << 40).set_partial(true);
    params.set_order(2).set_curved(true);
    CHECK(params.order() == 2 && params.curved());
    params.set_adaptive(LAPD_ADAPTIVE_OFF).set_spacing_floor(0.25).set_min_voxels(27);
    CHECK(params.adaptive() == LAPD_ADAPTIVE_OFF && params.spacing_floor() == 0.25 &&
          params.min_voxels() == 27);
    params.set_target_tets(5000);
    CHECK(params.target_tets() == 5000);
    params.set_target_tets(0);
    params.set_coarsen(12);
    CHECK(params.coarsen() == 12);
    params.set_coarsen(0);
    params.set_across(3).set_least_size(0.25).set_gradation(0.3);
    CHECK(params.across() == 3 && params.least_size() == 0.25 && params.gradation() == 0.3);
    params.set_across(0).set_least_size(0);
    params.set_label_size(5, 1.25);
    CHECK(params.delta() == 0.5 && params.size() == 1.5 && params.radius_edge() == 2.5 &&
          params.facet_angle() == 25);
    CHECK(params.border() == LAPD_BORDER_SMOOTH);
    CHECK(params.surface() == LAPD_SURFACE_VOXEL && params.background() && params.threads() == 2);
    CHECK(params.max_vertices() == 100000 && params.algorithm() == LAPD_ALGORITHM_LAPD);
    CHECK(params.contention() == LAPD_CONTENTION_RANDOM &&
          params.improve() == LAPD_IMPROVE_INTERIOR && params.target_dihedral() == 12);
    CHECK(params.begging() == LAPD_BEGGING_FLAT && params.timeline());
    CHECK(params.topology().empty() && params.bind() && params.count_accesses());
    CHECK(params.time_limit() == 2.5 && params.max_memory() == std::uint64_t{1} << 40 &&
          params.partial());
    CHECK(params.label_size(5) == 1.25 && params.clear_label_sizes().label_size(5) == 1.5);
    CHECK(params.keep().size() == 2 && params.keep()[1] == -9 &&
          params.set_keep({}).keep().empty());
}

/// A mesh of the arrays of another one, with a certificate of its own.
void certify_again(const lapd::mesh &mesh) {
    lapd::context context;
    const lapd::span<double> points = mesh.points().values();
    const lapd::span<std::uint32_t> tets = mesh.tets().values();
    const lapd::span<std::int32_t> labels = mesh.labels();
    const std::vector<double> coordinates(points.begin(), points.end());
    const std::vector<std::uint32_t> corners(tets.begin(), tets.end());
    const std::vector<std::int32_t> names(labels.begin(), labels.end());
    lapd::mesh again = lapd::mesh::from_arrays(context, coordinates, corners, names);
    CHECK(status_of([&] { again.certificate(); }) == LAPD_ERROR_NOT_MEASURED);
    again.certify(context, block_image(context), lapd::params());
    CHECK(again.certificate().inverted_tets == 0 &&
          again.certificate().unmet[0] == LAPD_NOT_COUNTED);
    CHECK(again.quality().min_dihedral == mesh.quality().min_dihedral);
    CHECK(status_of([&] { lapd::mesh::from_arrays(context, coordinates, corners, {}); }) ==
          LAPD_ERROR_INVALID_ARGUMENT);
}

void meshes() {
    lapd::context context;
    std::vector<std::string> lines;
    double last = 0;
    context.set_log([&](lapd_log_level, const char *line) { lines.emplace_back(line); });
    context.set_progress([&](const lapd_progress &progress) {
        CHECK(progress.fraction >= last);
        last = progress.fraction;
        return lapd::answer::go_on;
    });
    // The callbacks move with the context.
    lapd::context moved = std::move(context);
    const lapd::mesh mesh = lapd::mesh::make(moved, block_image(moved), lapd::params());
    CHECK(mesh.limit_reached() == LAPD_OK);
    CHECK(last > 0 && !lines.empty());

    const lapd_counts counts = mesh.counts();
    const lapd::rows<double, 3> points = mesh.points();
    const lapd::rows<std::uint32_t, 4> tets = mesh.tets();
    CHECK(points.size() == counts.vertices && points.values().size() == 3 * counts.vertices);
    CHECK(tets.size() == counts.tets && mesh.labels().size() == counts.tets &&
          mesh.neighbors().size() == counts.tets);
    CHECK(mesh.facets().size() == counts.interface_facets &&
          mesh.facet_tets().size() == counts.interface_facets);
    CHECK(mesh.facet_labels().size() == counts.interface_facets && !tets.empty());
    for (std::size_t t = 0; t < tets.size(); t++) {
        for (std::size_t k = 0; k < 4; k++) {
            CHECK(tets[t][k] < points.size());
        }
    }
    for (std::int32_t label : mesh.labels()) {
        CHECK(label == 5 || label == 9);
    }
    // No copy: the same array each time.
    CHECK(mesh.points().data() == points.data());

    double volume = 0;
    for (std::size_t i = 0; i < mesh.label_row_count(); i++) {
        volume += mesh.label_row(i).mesh_volume;
    }
    CHECK(volume > 100 && volume < 216);
    CHECK(status_of([&] { mesh.label_row(2); }) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(mesh.certificate().inverted_tets == 0 && mesh.quality().min_dihedral >= 10);
    certify_again(mesh);
    CHECK(mesh.timings().refine >= 0 && mesh.operations().insertions > 0);
    CHECK(mesh.thread_count() == 1 &&
          mesh.thread_report(0).insertions == mesh.operations().insertions);
    CHECK(mesh.thread_report(LAPD_ALL_THREADS).removals == mesh.operations().removals);
    CHECK(status_of([&] { mesh.thread_report(1); }) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(status_of([&] { mesh.write_timeline(moved, "timeline.json"); }) ==
          LAPD_ERROR_INVALID_ARGUMENT);
    mesh.write_report(moved, "cpp_report.json", "{\"program\": \"test_cpp\"}");
    CHECK(status_of([&] { mesh.write_report(moved, "cpp_report.json", "{"); }) ==
          LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(mesh.label_name(1) == nullptr && !mesh.label_color(1).second);
    CHECK(mesh.facet_walls().size() == mesh.facets().size());
    CHECK(mesh.node_pairs().empty());
    lapd::context splitting;
    lapd::mesh split = lapd::mesh::make(splitting, block_image(splitting), lapd::params());
    CHECK(status_of([&] {
              split.split_interfaces(splitting, {{{1, 9}}});
          }) == LAPD_ERROR_INVALID_ARGUMENT);
    lapd::write_options chosen;
    mesh.write(moved, "chosen.vtu", chosen.set_measures(true).set_boundary_parts(true));
    CHECK(status_of([&] { mesh.write(moved, "mesh.nonsense"); }) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(status_of([&] { lapd::mesh::check_path(moved, "mesh.nonsense"); }) ==
          LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(status_of([&] { lapd::mesh::check_path(moved, "no/such/folder/mesh.vtu"); }) == LAPD_OK);

    // A limit throws, or gives the partial mesh that was asked for.
    lapd::context other;
    lapd::params limited;
    limited.set_max_vertices(static_cast<std::size_t>(counts.all_vertices / 2));
    CHECK(status_of([&] { lapd::mesh::make(other, block_image(other), limited); }) ==
          LAPD_ERROR_LIMIT_REACHED);
    const lapd::mesh partial =
        lapd::mesh::make(other, block_image(other), limited.set_partial(true));
    CHECK(partial.limit_reached() == LAPD_ERROR_LIMIT_REACHED && partial.counts().tets > 0);
#if __cplusplus >= 202002L
    const std::span<const std::int32_t> labels = mesh.labels();
    CHECK(labels.data() == mesh.labels().data() && std::ranges::count(mesh.labels(), 9) > 0);
#endif
}

void callbacks_that_throw() {
    lapd::context context;
    const lapd::image image = block_image(context);
    const lapd::params params;
    const auto run = [&] { lapd::mesh::make(context, image, params); };

    int calls = 0;
    context.set_progress([&](const lapd_progress &) -> lapd::answer {
        calls++;
        throw std::runtime_error("from progress");
    });
    CHECK(throws(run, "from progress") && calls == 1);

    // Nobody is called after an exception.
    int logs = 0;
    calls = 0;
    context.set_progress([&](const lapd_progress &) {
        calls += logs;
        return lapd::answer::go_on;
    });
    context.set_log([&](lapd_log_level, const char *) {
        logs++;
        throw std::runtime_error("from log");
    });
    CHECK(throws(run, "from log") && logs == 1 && calls == 0);

    // Neither leaves anything behind: the next run goes well.
    context.set_log(nullptr);
    context.set_progress([](const lapd_progress &) { return lapd::answer::cancel; });
    CHECK(status_of(run) == LAPD_ERROR_CANCELLED);
    context.set_progress(nullptr);
    CHECK(status_of(run) == LAPD_OK);

    // A slow one only takes its time.
    calls = 0;
    context.set_progress([&](const lapd_progress &) {
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
        calls++;
        return lapd::answer::go_on;
    });
    CHECK(status_of(run) == LAPD_OK && calls > 0);

    // An error of a call inside of a callback leaves the outer call as it is.
    context.set_progress([&](const lapd_progress &) {
        run();
        return lapd::answer::go_on;
    });
    CHECK(status_of(run) == LAPD_ERROR_BUSY);
    context.set_progress(nullptr);

    context.cancel();
    CHECK(status_of(run) == LAPD_ERROR_CANCELLED);
    context.reset_cancel();
    CHECK(status_of(run) == LAPD_OK);
}

} // namespace

int main() {
    types();
    images();
    values();
    errors();
    parameters();
    meshes();
    callbacks_that_throw();
    return RESULT;
}
