#include "cases.hpp"

extern "C" {
#include "../phantom.h"
}

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <vector>

namespace crossval {
namespace {

int failures = 0;

// Voxels along each axis of a phantom, and the radius of its ball.
constexpr std::size_t N = 24;
constexpr double RADIUS = 9;

template <class T> std::unique_ptr<T[], decltype(&std::free)> owned(T *memory) {
    return {memory, &std::free};
}

} // namespace

bool check(bool condition, const std::string &what) {
    if (!condition) {
        std::fprintf(stderr, "FAILED: %s\n", what.c_str());
        ++failures;
    }
    return condition;
}

bool near(double value, double wanted, double relative, const std::string &what) {
    char text[128];
    std::snprintf(text, sizeof text, ": got %.17g, wanted %.17g", value, wanted);
    return check(std::abs(value - wanted) <= relative * std::abs(wanted), what + text);
}

int run(int argc, char **argv, const std::function<void(int, char **)> &checks) {
    try {
        checks(argc, argv);
    } catch (const Skipped &skipped) {
        std::printf("SKIPPED: %s\n", skipped.what());
    } catch (const std::exception &error) {
        check(false, error.what());
    }
    return failures == 0 ? 0 : 1;
}

std::string image_path(const std::string &name) {
    const char *set = std::getenv("LAPD_IMAGES");
    const std::string images = set != nullptr && *set != '\0' ? set : CROSSVAL_IMAGES;
    const std::string path = name == "aal"       ? "/usr/share/mricron/templates/aal.nii.gz"
                             : name == "brain"   ? images + "/spl/brain.nrrd"
                             : name == "abdomen" ? images + "/spl/abdomen.nrrd"
                                                 : name;
    if (!std::ifstream(path)) {
        throw Skipped("cross-validation on " + name + ", no file " + path);
    }
    return path;
}

void Meshing::require(lapd_status status) const {
    if (status != LAPD_OK) {
        throw std::runtime_error(std::string(lapd_status_name(status)) + ": " +
                                 lapd_context_last_error(context_.get()));
    }
}

lapd_image *Meshing::make_image(const std::string &name) const {
    const std::array<std::size_t, 3> dims{N, N, N};
    std::array<double, 3> origin{0, 0, 0}, spacing{1, 1, 1};
    lapd_image *image = nullptr;
    if (name == "ball") {
        return unit_image(context_.get(), owned(ball_voxels(N, RADIUS)).get(), N);
    }
    if (name == "cube") {
        // A cube whose interfaces are the faces of its voxels: flat, with edges and corners.
        std::vector<std::uint8_t> voxels(N * N * N);
        for (std::size_t i = 0; i < voxels.size(); ++i) {
            const auto inside = [](std::size_t x) { return x >= 4 && x < 20; };
            voxels[i] = inside(i % N) && inside(i / N % N) && inside(i / N / N);
        }
        return unit_image(context_.get(), voxels.data(), N);
    }
    if (name == "three" || name == "turned") {
        // Turned about z by the angle of a 3-4-5 triangle, with unequal spacing: a mesh whose
        // coordinates are round numbers no more.
        const double turn[9] = {0.6, -0.8, 0, 0.8, 0.6, 0, 0, 0, 1};
        const auto voxels = owned(three_label_voxels(N, RADIUS));
        if (name == "turned") {
            origin = {-3, 5, 100};
            spacing = {1, 0.7, 1.3};
        }
        require(lapd_image_create(context_.get(), voxels.get(), LAPD_VOXEL_I16, dims.data(),
                                  nullptr, origin.data(), spacing.data(),
                                  name == "turned" ? turn : nullptr, &image));
        return image;
    }
    require(
        lapd_image_read(context_.get(), image_path(name).c_str(), LAPD_WORLD_AS_STORED, &image));
    return image;
}

Meshing::Meshing(const std::string &name, double delta, double size, bool improved) {
    lapd_context *context = nullptr;
    if (lapd_context_create(&context) != LAPD_OK) {
        throw std::runtime_error("no context");
    }
    context_.reset(context);
    const std::unique_ptr<lapd_image, Free> image(make_image(name));
    lapd_params *made = nullptr;
    require(lapd_params_create(&made));
    const std::unique_ptr<lapd_params, Free> params(made);
    require(lapd_params_set_delta(context, made, delta));
    require(lapd_params_set_size(context, made, size));
    require(lapd_params_set_background(context, made, 1));
    require(
        lapd_params_set_improve(context, made, improved ? LAPD_IMPROVE_FULL : LAPD_IMPROVE_NONE));
    // One spacing: what is thin in an atlas would make millions of tets whatever delta is, and take
    // minutes of the others' time.
    require(lapd_params_set_adaptive(context, made, LAPD_ADAPTIVE_OFF));
    if (name == "cube") {
        require(lapd_params_set_surface(context, made, LAPD_SURFACE_VOXEL));
    }
    lapd_mesh *mesh = nullptr;
    require(lapd_mesh_image(context, image.get(), made, &mesh));
    mesh_.reset(mesh);

    std::array<std::size_t, 4> counts{};
    require(lapd_mesh_get_points(mesh, &points_, &point_count_));
    require(lapd_mesh_get_tets(mesh, &tets_, &tet_count_));
    require(lapd_mesh_get_labels(mesh, &labels_, &counts[0]));
    require(lapd_mesh_get_neighbors(mesh, &neighbors_, &counts[1]));
    require(lapd_mesh_get_facets(mesh, &facets_, &facet_count_));
    require(lapd_mesh_get_facet_labels(mesh, &facet_labels_, &counts[2]));
    lapd_counts reported{};
    reported.struct_size = sizeof reported;
    require(lapd_mesh_get_counts(mesh, &reported));
    check(improved || (reported.all_vertices == point_count_ && reported.all_tets == tet_count_),
          "the whole triangulation is kept");
    std::printf("%s, delta %g, size %g: %zu vertices, %zu tets (%llu of them tissue), %zu "
                "interface facets\n",
                name.c_str(), delta, size, point_count_, tet_count_,
                static_cast<unsigned long long>(reported.tissue_tets), facet_count_);
}

void Meshing::write(const std::string &path) const {
    require(lapd_mesh_write(context_.get(), mesh_.get(), path.c_str()));
}

} // namespace crossval
