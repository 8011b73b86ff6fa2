// The meshes that the cross-validation looks at, and how its programs report. Uses the C interface
// only, nothing of CGAL or TetGen.
#ifndef CROSSVAL_CASES_HPP
#define CROSSVAL_CASES_HPP

#include <lapd.h>

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>

namespace crossval {

using Tet = std::array<std::uint32_t, 4>;
using Facet = std::array<std::uint32_t, 3>;

// Thrown where something that a check needs is not on this machine.
struct Skipped : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// Counts and prints what does not hold; true when it held.
bool check(bool condition, const std::string &what);

// Checks that |value - wanted| <= relative * |wanted|.
bool near(double value, double wanted, double relative, const std::string &what);

// Runs a program's checks on its arguments; the exit status is 0 when everything held or was
// skipped.
int run(int argc, char **argv, const std::function<void(int, char **)> &checks);

// The path of an image: "aal", "brain", "abdomen", or a path. Throws Skipped when there is no such
// file.
std::string image_path(const std::string &name);

// An image, and its whole triangulation as lapd meshes it with background kept. The arrays live as
// long as this.
class Meshing {
  public:
    // `name` is a phantom ("ball", "three", "turned", "cube") or what image_path takes. As
    // refinement leaves it, or `improved`. Prints one line about the mesh.
    Meshing(const std::string &name, double delta, double size, bool improved = false);

    std::size_t vertices() const {
        return point_count_;
    }
    std::size_t tets() const {
        return tet_count_;
    }
    std::size_t facets() const {
        return facet_count_;
    }
    const double *point(std::size_t v) const {
        return points_ + 3 * v;
    }
    Tet tet(std::size_t t) const {
        return {tets_[4 * t], tets_[4 * t + 1], tets_[4 * t + 2], tets_[4 * t + 3]};
    }
    std::int32_t label(std::size_t t) const {
        return labels_[t];
    }
    // The tet across facet i of tet t, the one opposite to its vertex i; LAPD_NO_TET on the box.
    std::uint32_t neighbor(std::size_t t, int i) const {
        return neighbors_[4 * t + i];
    }
    Facet facet(std::size_t f) const {
        return {facets_[3 * f], facets_[3 * f + 1], facets_[3 * f + 2]};
    }
    // The labels on the side that the normal of the facet comes from, and on the one it points to.
    std::array<std::int32_t, 2> facet_labels(std::size_t f) const {
        return {facet_labels_[2 * f], facet_labels_[2 * f + 1]};
    }
    const lapd_mesh *mesh() const {
        return mesh_.get();
    }
    // Writes the mesh in the format that the path's ending names.
    void write(const std::string &path) const;

  private:
    struct Free {
        void operator()(lapd_context *p) const {
            lapd_context_free(p);
        }
        void operator()(lapd_image *p) const {
            lapd_image_free(p);
        }
        void operator()(lapd_params *p) const {
            lapd_params_free(p);
        }
        void operator()(lapd_mesh *p) const {
            lapd_mesh_free(p);
        }
    };
    void require(lapd_status status) const;
    lapd_image *make_image(const std::string &name) const;

    std::unique_ptr<lapd_context, Free> context_;
    std::unique_ptr<lapd_mesh, Free> mesh_;
    const double *points_ = nullptr;
    const std::uint32_t *tets_ = nullptr, *neighbors_ = nullptr, *facets_ = nullptr;
    const std::int32_t *labels_ = nullptr, *facet_labels_ = nullptr;
    std::size_t point_count_ = 0, tet_count_ = 0, facet_count_ = 0;
};

} // namespace crossval

#endif
