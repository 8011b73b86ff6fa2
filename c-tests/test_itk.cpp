// The way from ITK, examples/itk_to_lapd.hpp: meshes lie where ITK's TransformIndexToPhysicalPoint
// says, for an oblique and anisotropic image, for a reflected one, and for one whose region does
// not begin at 0; and where lapd reads a file that ITK wrote, it puts it in the same place.
#include "itk_to_lapd.hpp"

#include <cmath>
#include <cstdint>
#include <itkImageFileWriter.h>
#include <itkImageRegionIteratorWithIndex.h>
#include <map>
#include <string>

#include "check.h"

namespace {

using Image = itk::Image<std::int16_t, 3>;
using Point = Image::PointType;

// Three blocks that no rotation or reflection maps onto themselves.
std::int16_t label_at(const Image::IndexType &index, const Image::IndexType &first) {
    const auto x = index[0] - first[0], y = index[1] - first[1], z = index[2] - first[2];
    if (x >= 2 && x < 16 && y >= 2 && y < 8 && z >= 2 && z < 7) {
        return 1;
    }
    if (x >= 2 && x < 7 && y >= 8 && y < 14 && z >= 2 && z < 7) {
        return 40;
    }
    if (x >= 2 && x < 6 && y >= 2 && y < 5 && z >= 7 && z < 11) {
        return -3;
    }
    return 0;
}

Image::Pointer make_image(long first, const Image::DirectionType &direction) {
    auto image = Image::New();
    Image::RegionType region;
    region.SetIndex({first, -first, 2 * first});
    region.SetSize({18, 16, 13});
    image->SetRegions(region);
    const double spacing[3] = {0.8, 1.1, 1.7}, origin[3] = {-31.5, 12.25, 100};
    image->SetSpacing(spacing);
    image->SetOrigin(origin);
    image->SetDirection(direction);
    image->Allocate();
    for (itk::ImageRegionIteratorWithIndex<Image> at(image, region); !at.IsAtEnd(); ++at) {
        at.Set(label_at(at.GetIndex(), region.GetIndex()));
    }
    return image;
}

// About an oblique axis, by Rodrigues' formula; then one axis turned round.
Image::DirectionType oblique(bool reflected) {
    const double axis[3] = {2.0 / 7, 3.0 / 7, 6.0 / 7}, c = std::cos(0.7), s = std::sin(0.7);
    Image::DirectionType direction;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            direction(i, k) = (1 - c) * axis[i] * axis[k] + (i == k ? c : 0);
        }
    }
    for (int i = 0; i < 3; i++) {
        direction((i + 2) % 3, (i + 1) % 3) += s * axis[i];
        direction((i + 1) % 3, (i + 2) % 3) -= s * axis[i];
    }
    for (int i = 0; reflected && i < 3; i++) {
        direction(i, 1) *= -1;
    }
    return direction;
}

struct moment {
    double volume = 0;
    Point::VectorType sum;
    moment() {
        sum.Fill(0);
    }
    void add(double part, const Point &place) {
        volume += part;
        sum += place.GetVectorFromOrigin() * part;
    }
};

void check_place(const lapd::image &image, const Image *itk_image) {
    // The corners of the grid, by lapd's formula and by ITK.
    const auto region = itk_image->GetBufferedRegion();
    const auto origin = image.origin(), spacing = image.spacing();
    const auto direction = image.direction();
    for (int corner = 0; corner < 8; corner++) {
        Image::IndexType index = region.GetIndex();
        double at[3];
        for (unsigned i = 0; i < 3; i++) {
            const long steps =
                (corner >> i & 1) != 0 ? static_cast<long>(region.GetSize(i)) - 1 : 0;
            index[i] += steps;
            at[i] = static_cast<double>(steps) * spacing[i];
        }
        Point expected;
        itk_image->TransformIndexToPhysicalPoint(index, expected);
        for (unsigned i = 0; i < 3; i++) {
            const double got = origin[i] + direction[3 * i] * at[0] + direction[3 * i + 1] * at[1] +
                               direction[3 * i + 2] * at[2];
            CHECK(std::fabs(got - expected[i]) < 1e-6);
        }
    }
}

void check_mesh(lapd::context &context, const lapd::image &image, const Image *itk_image) {
    lapd::params params;
    params.set_delta(0.8).set_size(1.6).set_surface(LAPD_SURFACE_VOXEL);
    const lapd::mesh mesh = lapd::mesh::make(context, image, params);
    const auto points = mesh.points();
    const auto tets = mesh.tets();
    const auto labels = mesh.labels();

    // The voxel that ITK finds at the centroid of a tet has the tet's label, but for the few tets
    // that cut a corner off.
    std::map<std::int32_t, moment> meshed, voxels;
    std::size_t wrong = 0;
    for (std::size_t t = 0; t < tets.size(); t++) {
        Point corner[4], centroid;
        centroid.Fill(0);
        for (int i = 0; i < 4; i++) {
            for (unsigned k = 0; k < 3; k++) {
                corner[i][k] = points[tets[t][i]][k];
                centroid[k] += corner[i][k] / 4;
            }
        }
        const auto u = corner[1] - corner[0], v = corner[2] - corner[0], w = corner[3] - corner[0];
        const double volume = itk::CrossProduct(u, v) * w / 6;
        CHECK(volume > 0);
        meshed[labels[t]].add(volume, centroid);
        Image::IndexType index;
        wrong += !itk_image->TransformPhysicalPointToIndex(centroid, index) ||
                 itk_image->GetPixel(index) != labels[t];
    }
    CHECK(tets.size() > 1000);
    printf("%zu of %zu centroids in a voxel of another label\n", wrong, tets.size());
    CHECK(50 * wrong < tets.size());

    // Volume and centroid of every label.
    double voxel = 1;
    for (unsigned i = 0; i < 3; i++) {
        voxel *= itk_image->GetSpacing()[i];
    }
    for (itk::ImageRegionConstIteratorWithIndex<Image> at(itk_image,
                                                          itk_image->GetBufferedRegion());
         !at.IsAtEnd(); ++at) {
        Point place;
        itk_image->TransformIndexToPhysicalPoint(at.GetIndex(), place);
        if (at.Get() != 0) {
            voxels[at.Get()].add(voxel, place);
        }
    }
    CHECK(meshed.size() == 3 && voxels.size() == 3);
    for (const auto &[label, expected] : voxels) {
        const moment &got = meshed[label];
        const double shift = (got.sum / got.volume - expected.sum / expected.volume).GetNorm();
        printf("label %d: volume %.1f for %.1f, centroid off by %.3f\n", label, got.volume,
               expected.volume, shift);
        CHECK(std::fabs(got.volume - expected.volume) < 0.1 * expected.volume);
        CHECK(shift < 0.1);
    }
}

void check_file(lapd::context &context, const Image *itk_image, const std::string &path) {
    auto writer = itk::ImageFileWriter<Image>::New();
    writer->SetFileName(path);
    writer->SetInput(itk_image);
    writer->Update();
    const lapd::image image = lapd::image::read(context, path);
    check_place(image, itk_image);
    CHECK(image.voxels() == to_lapd(context, itk_image).voxels());
}

} // namespace

int main() try {
    lapd::context context;
    for (const bool reflected : {false, true}) {
        const auto itk_image = make_image(0, oblique(reflected));
        const lapd::image image = to_lapd<std::int16_t>(context, itk_image);
        check_place(image, itk_image);
        check_mesh(context, image, itk_image);
        // Both formats are LPS, as ITK is.
        check_file(context, itk_image, "itk.nrrd");
        check_file(context, itk_image, "itk.mha");
    }
    const auto shifted = make_image(5, oblique(false));
    check_place(to_lapd<std::int16_t>(context, shifted), shifted);
    return RESULT;
} catch (const std::exception &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
