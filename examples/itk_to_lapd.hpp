// From ITK to lapd: a label image of ITK, with its place in the world.
//
// ITK's world is LPS, whatever the file said, and so is the mesh then: vertices are where
// TransformIndexToPhysicalPoint puts the voxels. Both libraries put the centre of a voxel at origin
// + direction * (index * spacing), so nothing is turned or flipped.
#ifndef ITK_TO_LAPD_HPP
#define ITK_TO_LAPD_HPP

#include <itkImage.h>
#include <lapd.hpp>

// lapd copies the voxels; the ITK image may go afterwards. Any integer type.
template <class Pixel>
lapd::image to_lapd(lapd::context &context, const itk::Image<Pixel, 3> *image) {
    const auto region = image->GetBufferedRegion();
    // ITK's origin belongs to index (0, 0, 0), with which a region need not begin.
    typename itk::Image<Pixel, 3>::PointType origin;
    image->TransformIndexToPhysicalPoint(region.GetIndex(), origin);

    lapd::grid grid;
    for (unsigned i = 0; i < 3; i++) {
        grid.dims[i] = region.GetSize(i);
        grid.origin[i] = origin[i];
        grid.spacing[i] = image->GetSpacing()[i];
        for (unsigned k = 0; k < 3; k++) {
            grid.direction[3 * i + k] = image->GetDirection()(i, k);
        }
    }
    return lapd::image::create(context, image->GetBufferPointer(), grid);
}

#endif
