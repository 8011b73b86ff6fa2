// measure IMAGE OURS.mesh THEIRS.mesh [REPORT.json]: two meshes of one label image side by side,
// both measured by the same code from MEDIT files.
//
// OURS lies in the world, as lapd writes it; THEIRS along the axes of the image with the first
// voxel's centre at the origin, as benches/peers/cgal_mesh_3 writes it. Interfaces are found anew:
// facets between two labels, or between a label and nothing.
//
// Surface distance, from samples of one side to the exact nearest point of the other:
// - mesh to image: facets are cut into triangles with edges of at most half a voxel; samples are
// their centroids, weighted by area;
// - image to mesh: samples are the centres of faces between voxels of different label, weighted by
// area. lapd's own certificate measures much the same; nothing of its code is used here. With
// REPORT.json, the report of mesh_image on ours, the two are compared.
//
// Exit status 0 when ours loses no more labels than theirs and its mean surface distances are no
// larger, 1 otherwise.

#include "cases.hpp"
#include "shape.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <set>
#include <vector>

namespace {

using namespace crossval;

using Vec = std::array<double, 3>;

Vec minus(const Vec &a, const Vec &b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
Vec along(const Vec &a, double t, const Vec &d) {
    return {a[0] + t * d[0], a[1] + t * d[1], a[2] + t * d[2]};
}
double inner(const Vec &a, const Vec &b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// ---- The image ----

struct Image {
    std::array<std::size_t, 3> dims{};
    Vec origin{}, spacing{};
    std::array<double, 9> direction{};
    std::vector<std::int32_t> voxels;

    explicit Image(const std::string &path) {
        lapd_context *context = nullptr;
        lapd_image *image = nullptr;
        bool good = lapd_context_create(&context) == LAPD_OK &&
                    lapd_image_read(context, path.c_str(), LAPD_WORLD_AS_STORED, &image) == LAPD_OK;
        good = good && lapd_image_get_dims(image, dims.data()) == LAPD_OK &&
               lapd_image_get_origin(image, origin.data()) == LAPD_OK;
        good = good && lapd_image_get_spacing(image, spacing.data()) == LAPD_OK;
        good = good && lapd_image_get_direction(image, direction.data()) == LAPD_OK;
        if (good) {
            voxels.resize(dims[0] * dims[1] * dims[2]);
            good = lapd_image_copy_voxels(image, voxels.data(), voxels.size()) == LAPD_OK;
        }
        const std::string error = good ? "" : lapd_context_last_error(context);
        lapd_image_free(image);
        lapd_context_free(context);
        if (!good) {
            throw std::runtime_error(path + ": " + error);
        }
    }
    // The label of a voxel; 0 outside of the grid. Indices below 0 wrap to large ones.
    std::int32_t at(std::size_t i, std::size_t j, std::size_t k) const {
        return i < dims[0] && j < dims[1] && k < dims[2] ? voxels[i + dims[0] * (j + dims[1] * k)]
                                                         : 0;
    }
    // From the world to the frame in which voxel (i, j, k) fills [i, i + 1] x [j, j + 1] x [k, k +
    // 1] times the spacing.
    Vec local(const Vec &world) const {
        const Vec d = minus(world, origin);
        Vec p;
        for (int axis = 0; axis < 3; ++axis) {
            p[axis] = direction[axis] * d[0] + direction[3 + axis] * d[1] +
                      direction[6 + axis] * d[2] + 0.5 * spacing[axis];
        }
        return p;
    }
};

// ---- A uniform grid, searched in growing shells ----

struct Grid {
    std::array<std::size_t, 3> dims{};
    Vec low{}, cell{};

    std::array<long, 3> cell_of(const Vec &p) const {
        std::array<long, 3> c;
        for (int axis = 0; axis < 3; ++axis) {
            c[axis] = std::clamp(static_cast<long>(std::floor((p[axis] - low[axis]) / cell[axis])),
                                 0L, static_cast<long>(dims[axis]) - 1);
        }
        return c;
    }
    std::size_t index(long i, long j, long k) const {
        return static_cast<std::size_t>(i) +
               dims[0] * (static_cast<std::size_t>(j) + dims[1] * static_cast<std::size_t>(k));
    }
    // Squared distance from p to the nearest thing; `nearest(cell, best)` lowers `best` by what is
    // in a cell. Whatever reaches into a block of cells must be found in one of them, except for
    // what only touches its upper sides.
    template <class Nearest> double search(const Vec &p, const Nearest &nearest) const {
        const auto c = cell_of(p);
        double best = std::numeric_limits<double>::infinity();
        for (long r = 0;; ++r) {
            bool inside = false;
            for (long k = c[2] - r; k <= c[2] + r; ++k) {
                for (long j = c[1] - r; j <= c[1] + r; ++j) {
                    const bool rim = std::abs(k - c[2]) == r || std::abs(j - c[1]) == r;
                    for (long i = c[0] - r; i <= c[0] + r; i += rim || r == 0 ? 1 : 2 * r) {
                        const bool valid =
                            i >= 0 && j >= 0 && k >= 0 && i < static_cast<long>(dims[0]) &&
                            j < static_cast<long>(dims[1]) && k < static_cast<long>(dims[2]);
                        if (valid) {
                            inside = true;
                            nearest(index(i, j, k), best);
                        }
                    }
                }
            }
            // Nothing outside of the block looked at is nearer than its sides.
            double side = std::numeric_limits<double>::infinity();
            for (int axis = 0; axis < 3; ++axis) {
                side = std::min(
                    side, p[axis] - (low[axis] + static_cast<double>(c[axis] - r) * cell[axis]));
                side = std::min(
                    side, low[axis] + static_cast<double>(c[axis] + r + 1) * cell[axis] - p[axis]);
            }
            if (!inside || (side > 0 && best <= side * side)) {
                return best;
            }
        }
    }
};

// ---- Faces between voxels ----

class VoxelFaces {
  public:
    explicit VoxelFaces(const Image &image) : image_(image) {
        grid_.dims = {image.dims[0] + 1, image.dims[1] + 1, image.dims[2] + 1};
        grid_.cell = image.spacing;
        masks_.resize(grid_.dims[0] * grid_.dims[1] * grid_.dims[2]);
        std::size_t n = 0;
        for (std::size_t k = 0; k < grid_.dims[2]; ++k) {
            for (std::size_t j = 0; j < grid_.dims[1]; ++j) {
                for (std::size_t i = 0; i < grid_.dims[0]; ++i) {
                    const std::int32_t label = image.at(i, j, k);
                    masks_[n++] = static_cast<std::uint8_t>((label != image.at(i - 1, j, k)) |
                                                            (label != image.at(i, j - 1, k)) << 1 |
                                                            (label != image.at(i, j, k - 1)) << 2);
                }
            }
        }
    }
    // Calls with the centre and the area of every face.
    template <class Call> void each(const Call &call) const {
        for (std::size_t n = 0; n < masks_.size(); ++n) {
            for (int axis = 0; axis < 3; ++axis) {
                if (masks_[n] >> axis & 1) {
                    const Vec low = corner(n);
                    Vec centre = along(low, 0.5, image_.spacing);
                    centre[axis] = low[axis];
                    call(centre, image_.spacing[(axis + 1) % 3] * image_.spacing[(axis + 2) % 3]);
                }
            }
        }
    }
    double squared_distance(const Vec &p) const {
        return grid_.search(p, [&](std::size_t n, double &best) {
            if (masks_[n] == 0) {
                return;
            }
            const Vec low = corner(n);
            for (int axis = 0; axis < 3; ++axis) {
                if (masks_[n] >> axis & 1) {
                    double sum = 0;
                    for (int a = 0; a < 3; ++a) {
                        const double high = low[a] + (a == axis ? 0 : image_.spacing[a]);
                        const double d = p[a] - std::clamp(p[a], low[a], high);
                        sum += d * d;
                    }
                    best = std::min(best, sum);
                }
            }
        });
    }

  private:
    Vec corner(std::size_t n) const {
        const auto &d = grid_.dims;
        const auto scaled = [&](std::size_t i, int axis) {
            return static_cast<double>(i) * image_.spacing[axis];
        };
        return {scaled(n % d[0], 0), scaled(n / d[0] % d[1], 1), scaled(n / d[0] / d[1], 2)};
    }
    const Image &image_;
    Grid grid_;
    std::vector<std::uint8_t>
        masks_; // bit `axis`: the lower face along the axis is one between two labels
};

// ---- Triangles ----

using Triangle = std::array<Vec, 3>;

double squared_distance_to_segment(const Vec &p, const Vec &a, const Vec &b) {
    const Vec d = minus(b, a);
    const double t = std::clamp(inner(minus(p, a), d) / inner(d, d), 0.0, 1.0);
    const Vec e = minus(p, along(a, t, d));
    return inner(e, e);
}

// The foot of the perpendicular if it lies inside, an edge otherwise.
double squared_distance_to_triangle(const Vec &p, const Triangle &t) {
    const Vec u = minus(t[1], t[0]), v = minus(t[2], t[0]), w = minus(p, t[0]);
    const double uu = inner(u, u), uv = inner(u, v), vv = inner(v, v), wu = inner(w, u),
                 wv = inner(w, v);
    const double det = uu * vv - uv * uv;
    const double s = wu * vv - wv * uv, r = wv * uu - wu * uv;
    if (det > 0 && s >= 0 && r >= 0 && s + r <= det) {
        const Vec e = minus(along(along(w, -s / det, u), -r / det, v), Vec{0, 0, 0});
        return inner(e, e);
    }
    return std::min({squared_distance_to_segment(p, t[0], t[1]),
                     squared_distance_to_segment(p, t[1], t[2]),
                     squared_distance_to_segment(p, t[2], t[0])});
}

class Triangles {
  public:
    explicit Triangles(const std::vector<Triangle> &triangles) : triangles_(triangles) {
        Vec low = triangles.at(0)[0], high = low;
        double extent = 0;
        for (const Triangle &t : triangles) {
            double longest = 0;
            for (int axis = 0; axis < 3; ++axis) {
                const auto [a, b] = std::minmax({t[0][axis], t[1][axis], t[2][axis]});
                low[axis] = std::min(low[axis], a);
                high[axis] = std::max(high[axis], b);
                longest = std::max(longest, b - a);
            }
            extent += longest;
        }
        // Cells as wide as a triangle is on average.
        const double width = extent / static_cast<double>(triangles.size());
        grid_.low = low;
        grid_.cell = {width, width, width};
        for (int axis = 0; axis < 3; ++axis) {
            grid_.dims[axis] = static_cast<std::size_t>((high[axis] - low[axis]) / width) + 1;
        }
        // Counted, then filled: the triangles of cell c are those from first_[c] to first_[c + 1].
        first_.assign(grid_.dims[0] * grid_.dims[1] * grid_.dims[2] + 1, 0);
        each_cell([&](std::size_t cell, std::size_t) { ++first_[cell + 1]; });
        for (std::size_t c = 1; c < first_.size(); ++c) {
            first_[c] += first_[c - 1];
        }
        members_.resize(first_.back());
        std::vector<std::size_t> next(first_.begin(), first_.end() - 1);
        each_cell([&](std::size_t cell, std::size_t t) {
            members_[next[cell]++] = static_cast<std::uint32_t>(t);
        });
    }
    double squared_distance(const Vec &p) const {
        return grid_.search(p, [&](std::size_t cell, double &best) {
            for (std::size_t i = first_[cell]; i < first_[cell + 1]; ++i) {
                best = std::min(best, squared_distance_to_triangle(p, triangles_[members_[i]]));
            }
        });
    }

  private:
    template <class Call> void each_cell(const Call &call) const {
        for (std::size_t t = 0; t < triangles_.size(); ++t) {
            Vec low = triangles_[t][0], high = low;
            for (const Vec &p : triangles_[t]) {
                for (int axis = 0; axis < 3; ++axis) {
                    low[axis] = std::min(low[axis], p[axis]);
                    high[axis] = std::max(high[axis], p[axis]);
                }
            }
            const auto a = grid_.cell_of(low), b = grid_.cell_of(high);
            for (long k = a[2]; k <= b[2]; ++k) {
                for (long j = a[1]; j <= b[1]; ++j) {
                    for (long i = a[0]; i <= b[0]; ++i) {
                        call(grid_.index(i, j, k), t);
                    }
                }
            }
        }
    }
    const std::vector<Triangle> &triangles_;
    Grid grid_;
    std::vector<std::size_t> first_;
    std::vector<std::uint32_t> members_;
};

// ---- Meshes ----

struct MeditMesh {
    std::vector<Vec> points;
    std::vector<Tet> tets;
    std::vector<std::int32_t> labels;

    explicit MeditMesh(const std::string &path) {
        std::ifstream file(path, std::ios::binary);
        const std::string text{std::istreambuf_iterator<char>(file),
                               std::istreambuf_iterator<char>()};
        const auto section = [&](const char *name) {
            const std::size_t at = text.find(std::string("\n") + name);
            if (at == std::string::npos) {
                throw std::runtime_error(path + " has no " + name);
            }
            return text.c_str() + at + 1 + std::strlen(name);
        };
        char *end = nullptr;
        const char *next = section("Vertices");
        points.resize(std::strtoull(next, &end, 10));
        for (Vec &p : points) {
            for (double &x : p) {
                x = std::strtod(end, &end);
            }
            std::strtol(end, &end, 10);
        }
        next = section("Tetrahedra");
        tets.resize(std::strtoull(next, &end, 10));
        labels.resize(tets.size());
        for (std::size_t t = 0; t < tets.size(); ++t) {
            for (std::uint32_t &v : tets[t]) {
                v = static_cast<std::uint32_t>(std::strtoul(end, &end, 10) - 1);
                if (v >= points.size()) {
                    throw std::runtime_error(path + ": tet " + std::to_string(t) +
                                             " has no vertex");
                }
            }
            labels[t] = static_cast<std::int32_t>(std::strtol(end, &end, 10));
        }
    }
    // The facets between two labels, or between a label and nothing.
    std::vector<Facet> interfaces() const {
        struct Side {
            Facet facet;
            std::int32_t label;
        };
        std::vector<Side> sides;
        sides.reserve(4 * tets.size());
        for (std::size_t t = 0; t < tets.size(); ++t) {
            Tet v = tets[t];
            std::sort(v.begin(), v.end());
            for (int i = 0; i < 4; ++i) {
                sides.push_back(
                    {{v[i < 1 ? 1 : 0], v[i < 2 ? 2 : 1], v[i < 3 ? 3 : 2]}, labels[t]});
            }
        }
        std::sort(sides.begin(), sides.end(),
                  [](const Side &a, const Side &b) { return a.facet < b.facet; });
        std::vector<Facet> found;
        for (std::size_t i = 0; i < sides.size();) {
            const bool two = i + 1 < sides.size() && sides[i + 1].facet == sides[i].facet;
            if (!two || sides[i].label != sides[i + 1].label) {
                found.push_back(sides[i].facet);
            }
            i += two ? 2 : 1;
        }
        return found;
    }
};

struct Distance {
    double mean = 0, max = 0;
};

struct Measured {
    std::size_t tets = 0, vertices = 0, interface_facets = 0, lost = 0, slivers = 0;
    Real min_dihedral = 180, max_dihedral = 0, max_radius_edge = 0, min_facet_angle = 180;
    double worst = 0, worst_large = 0, total_error = 0, sum_of_errors = 0; // of volumes, relative
    std::int32_t worst_label = 0, worst_large_label = 0;
    Distance to_image, to_mesh;
};

// A label of fewer voxels has no volume error worth the name.
constexpr std::size_t LARGE = 1000;

// Dihedral angles below this belong to slivers, and those above its supplement.
constexpr double SLIVER = 10;

class Mean {
  public:
    void add(double weight, double squared_distance) {
        const double distance = std::sqrt(squared_distance);
        weight_ += weight;
        sum_ += weight * distance;
        max_ = std::max(max_, distance);
    }
    Distance get() const {
        return {static_cast<double>(sum_ / weight_), max_};
    }

  private:
    Real weight_ = 0, sum_ = 0;
    double max_ = 0;
};

Distance mesh_to_image(const std::vector<Triangle> &triangles, const VoxelFaces &faces,
                       double edge) {
    Mean mean;
    for (const Triangle &t : triangles) {
        const Vec u = minus(t[1], t[0]), v = minus(t[2], t[0]), w = minus(t[2], t[1]);
        const double longest = std::sqrt(std::max({inner(u, u), inner(v, v), inner(w, w)}));
        const double area =
            std::sqrt(std::max(0.0, inner(u, u) * inner(v, v) - inner(u, v) * inner(u, v))) / 2;
        const int n = std::max(1, static_cast<int>(std::ceil(longest / edge)));
        // The centroids of the n * n triangles, in units of a third of their edges.
        for (int a = 0; a < n; ++a) {
            for (int b = 0; a + b < n; ++b) {
                for (int upside_down = 0; upside_down < 2 && a + b + upside_down < n;
                     ++upside_down) {
                    const double s = (3 * a + 1 + upside_down) / (3.0 * n),
                                 r = (3 * b + 1 + upside_down) / (3.0 * n);
                    mean.add(area / (static_cast<double>(n) * n),
                             faces.squared_distance(along(along(t[0], s, u), r, v)));
                }
            }
        }
    }
    return mean.get();
}

Measured measure(const MeditMesh &mesh, const Image &image, const VoxelFaces &faces) {
    Measured m;
    std::vector<char> used(mesh.points.size());
    std::map<std::int32_t, Real> volumes;
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
        std::array<Vector, 4> p;
        for (int i = 0; i < 4; ++i) {
            used[mesh.tets[t][i]] = 1;
            p[i] = vector(mesh.points[mesh.tets[t][i]].data());
        }
        const TetShape shape = tet_shape(p);
        volumes[mesh.labels[t]] += std::abs(shape.volume);
        m.max_radius_edge = std::max(m.max_radius_edge, shape.radius_edge);
        const auto [low, high] =
            std::minmax_element(shape.dihedrals.begin(), shape.dihedrals.end());
        m.min_dihedral = std::min(m.min_dihedral, *low);
        m.max_dihedral = std::max(m.max_dihedral, *high);
        m.slivers += *low < SLIVER || *high > 180 - SLIVER;
    }
    m.tets = mesh.tets.size();
    m.vertices = static_cast<std::size_t>(std::count(used.begin(), used.end(), 1));

    std::map<std::int32_t, std::size_t> voxels;
    for (const std::int32_t label : image.voxels) {
        voxels[label] += label != 0;
    }
    voxels.erase(0);
    const double voxel = image.spacing[0] * image.spacing[1] * image.spacing[2];
    double all = 0, meshed = 0;
    for (const auto &[label, count] : voxels) {
        const double wanted = static_cast<double>(count) * voxel,
                     volume = static_cast<double>(volumes[label]);
        m.lost += volume == 0;
        all += wanted;
        meshed += volume;
        m.sum_of_errors += std::abs(volume - wanted);
        const double relative = (volume - wanted) / wanted;
        if (std::abs(relative) > std::abs(m.worst)) {
            m.worst = relative;
            m.worst_label = label;
        }
        if (count >= LARGE && std::abs(relative) > std::abs(m.worst_large)) {
            m.worst_large = relative;
            m.worst_large_label = label;
        }
    }
    m.total_error = (meshed - all) / all;
    m.sum_of_errors /= all;

    std::vector<Triangle> triangles;
    for (const Facet &f : mesh.interfaces()) {
        triangles.push_back({mesh.points[f[0]], mesh.points[f[1]], mesh.points[f[2]]});
        const Triangle &t = triangles.back();
        for (const Real angle :
             triangle_angles(vector(t[0].data()), vector(t[1].data()), vector(t[2].data()))) {
            m.min_facet_angle = std::min(m.min_facet_angle, angle);
        }
    }
    m.interface_facets = triangles.size();
    m.to_image = mesh_to_image(triangles, faces,
                               0.5 * *std::min_element(image.spacing.begin(), image.spacing.end()));
    const Triangles tree(triangles);
    Mean mean;
    faces.each(
        [&](const Vec &centre, double area) { mean.add(area, tree.squared_distance(centre)); });
    m.to_mesh = mean.get();
    return m;
}

void print(const Measured &a, const Measured &b) {
    const auto row = [](const char *name, const char *format, auto ours, auto theirs) {
        char x[32], y[32];
        std::snprintf(x, sizeof x, format, ours);
        std::snprintf(y, sizeof y, format, theirs);
        std::printf("| %-52s | %15s | %15s |\n", name, x, y);
    };
    std::printf("| %-52s | %15s | %15s |\n|%s|%s:|%s:|\n", "", "lapd", "CGAL Mesh_3",
                std::string(54, '-').c_str(), std::string(16, '-').c_str(),
                std::string(16, '-').c_str());
    row("tets", "%zu", a.tets, b.tets);
    row("vertices", "%zu", a.vertices, b.vertices);
    row("interface facets", "%zu", a.interface_facets, b.interface_facets);
    row("smallest dihedral angle, degrees", "%.4f", double(a.min_dihedral), double(b.min_dihedral));
    row("largest dihedral angle, degrees", "%.4f", double(a.max_dihedral), double(b.max_dihedral));
    const auto percent = [](std::size_t part, std::size_t whole) {
        return 100 * static_cast<double>(part) / static_cast<double>(whole);
    };
    row("tets with an angle below 10 or above 170 degrees", "%.2f %%", percent(a.slivers, a.tets),
        percent(b.slivers, b.tets));
    row("largest radius-edge ratio", "%.4f", double(a.max_radius_edge), double(b.max_radius_edge));
    row("smallest angle of interface facets, degrees", "%.3f", double(a.min_facet_angle),
        double(b.min_facet_angle));
    row("labels lost", "%zu", a.lost, b.lost);
    row("volume error, all labels together", "%+.3f %%", 100 * a.total_error, 100 * b.total_error);
    row("volume error, sum of the labels' amounts", "%.3f %%", 100 * a.sum_of_errors,
        100 * b.sum_of_errors);
    row("volume error, worst label of 1000 voxels or more", "%+.2f %%", 100 * a.worst_large,
        100 * b.worst_large);
    row("  that label", "%d", a.worst_large_label, b.worst_large_label);
    row("volume error, worst label", "%+.2f %%", 100 * a.worst, 100 * b.worst);
    row("  that label", "%d", a.worst_label, b.worst_label);
    row("mesh to image, mean distance", "%.4f", a.to_image.mean, b.to_image.mean);
    row("mesh to image, largest", "%.3f", a.to_image.max, b.to_image.max);
    row("image to mesh, mean distance", "%.4f", a.to_mesh.mean, b.to_mesh.mean);
    row("image to mesh, largest", "%.3f", a.to_mesh.max, b.to_mesh.max);
}

// lapd's certificate against what was measured here. Samples of the image are the same; those of
// the mesh are not, so that its mean differs a little.
void check_certificate(const std::string &path, const Image &image, const Measured &ours) {
    std::ifstream file(path);
    const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
    const auto number = [&](const std::string &name) {
        const std::size_t at = text.find("\"" + name + "\": ");
        if (at == std::string::npos) {
            throw std::runtime_error(path + " has no " + name);
        }
        return std::strtod(text.c_str() + at + name.size() + 4, nullptr);
    };
    near(number("mean_image_to_mesh"), ours.to_mesh.mean, 1e-9,
         "certificate: mean distance from the image to the mesh");
    near(number("mean_mesh_to_image"), ours.to_image.mean, 0.05,
         "certificate: mean distance from the mesh to the image");
    // The first is promised to a hundredth of the smallest spacing. The second has more samples:
    // corners of voxel faces too.
    const double tolerance = 0.01 * *std::min_element(image.spacing.begin(), image.spacing.end());
    check(number("hausdorff_mesh_to_image") >= ours.to_image.max - tolerance,
          "certificate: largest distance from the mesh to the image");
    check(number("hausdorff_image_to_mesh") >= 0.999999 * ours.to_mesh.max,
          "certificate: largest distance from the image to the mesh");
}

void checks(int argc, char **argv) {
    if (argc != 4 && argc != 5) {
        throw std::runtime_error("usage: measure IMAGE OURS.mesh THEIRS.mesh [REPORT.json]");
    }
    const Image image(argv[1]);
    const VoxelFaces faces(image);
    std::array<Measured, 2> measured;
    for (int i = 0; i < 2; ++i) {
        MeditMesh mesh(argv[2 + i]);
        for (Vec &p : mesh.points) {
            p = i == 0 ? image.local(p) : along(p, 0.5, image.spacing);
        }
        measured[i] = measure(mesh, image, faces);
    }
    const Measured &ours = measured[0], &theirs = measured[1];
    print(ours, theirs);
    if (argc == 5) {
        check_certificate(argv[4], image, ours);
    }
    check(ours.lost <= theirs.lost, "ours loses no more labels");
    check(ours.to_image.mean <= theirs.to_image.mean,
          "ours has no larger mean distance from the mesh to the image");
    check(ours.to_mesh.mean <= theirs.to_mesh.mean,
          "ours has no larger mean distance from the image to the mesh");
}

} // namespace

int main(int argc, char **argv) {
    return run(argc, argv, checks);
}
