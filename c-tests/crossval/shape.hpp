// Shape of tets and triangles, measured once more: by other formulas than the library's, in
// extended precision where the machine has it.
#ifndef CROSSVAL_SHAPE_HPP
#define CROSSVAL_SHAPE_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace crossval {

using Real = long double;
using Vector = std::array<Real, 3>;

inline Vector operator-(const Vector &a, const Vector &b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline Real dot(const Vector &a, const Vector &b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline Vector cross(const Vector &a, const Vector &b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline Real length(const Vector &a) {
    return std::sqrt(dot(a, a));
}
inline Vector vector(const double *p) {
    return {p[0], p[1], p[2]};
}

// The angle between two vectors, in degrees.
inline Real angle(const Vector &a, const Vector &b) {
    return std::atan2(length(cross(a, b)), dot(a, b)) * (180 / std::acos(Real(-1)));
}

// The planar angles of a triangle, in degrees.
inline std::array<Real, 3> triangle_angles(const Vector &a, const Vector &b, const Vector &c) {
    return {angle(b - a, c - a), angle(c - b, a - b), angle(a - c, b - c)};
}

struct TetShape {
    Real volume;                   // signed
    Real radius_edge;              // circumradius over shortest edge
    std::array<Real, 6> dihedrals; // degrees
};

// Dihedral angles between the outward normals of faces; the circumradius from the products of
// opposite edges (Crelle 1821): 24 R V = sqrt((p + q + r)(p + q - r)(p - q + r)(q + r - p)).
inline TetShape tet_shape(const std::array<Vector, 4> &p) {
    TetShape shape{};
    shape.volume = dot(cross(p[1] - p[0], p[2] - p[0]), p[3] - p[0]) / 6;
    static constexpr int FACES[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    std::array<Vector, 4> outward;
    for (int i = 0; i < 4; ++i) {
        const auto &f = FACES[i];
        outward[i] = cross(p[f[1]] - p[f[0]], p[f[2]] - p[f[0]]);
    }
    int n = 0;
    Real shortest = length(p[1] - p[0]);
    for (int i = 0; i < 4; ++i) {
        for (int j = i + 1; j < 4; ++j) {
            shape.dihedrals[n++] = 180 - angle(outward[i], outward[j]);
            shortest = std::min(shortest, length(p[j] - p[i]));
        }
    }
    const Real a = length(p[1] - p[0]) * length(p[3] - p[2]);
    const Real b = length(p[2] - p[0]) * length(p[3] - p[1]);
    const Real c = length(p[3] - p[0]) * length(p[2] - p[1]);
    const Real product = (a + b + c) * (a + b - c) * (a - b + c) * (b + c - a);
    shape.radius_edge =
        std::sqrt(std::max(product, Real(0))) / (24 * std::abs(shape.volume)) / shortest;
    return shape;
}

// Counts angles below thresholds, and says how far rounding may move a count: an angle closer to a
// threshold than this may fall on either side.
class Histogram {
  public:
    Histogram(std::vector<double> thresholds, Real tolerance)
        : thresholds_(std::move(thresholds)), tolerance_(tolerance), surely_(thresholds_.size()),
          perhaps_(thresholds_.size()) {
    }
    void add(Real value) {
        for (std::size_t i = 0; i < thresholds_.size(); ++i) {
            surely_[i] += value < thresholds_[i] - tolerance_;
            perhaps_[i] += value < thresholds_[i] + tolerance_;
        }
        ++count_;
    }
    // Whether bins, the first one from below the first threshold and the last one from the last
    // threshold on, count the same angles.
    template <class Bins> bool agrees(const Bins &bins) const {
        std::size_t below = 0;
        for (std::size_t i = 0; i < thresholds_.size(); ++i) {
            below += bins[i];
            if (below < surely_[i] || below > perhaps_[i]) {
                return false;
            }
        }
        return below + bins[thresholds_.size()] == count_;
    }

  private:
    std::vector<double> thresholds_;
    Real tolerance_;
    std::vector<std::size_t> surely_, perhaps_;
    std::size_t count_ = 0;
};

} // namespace crossval

#endif
