// The way to VTK, examples/lapd_to_vtk.hpp: what is promised to be shared is shared, cells and
// labels are the mesh's, and the mesh lives as long as VTK holds any of its arrays, and no longer.
#include "lapd_to_vtk.hpp"

#include <cmath>
#include <cstdint>
#include <vector>
#include <vtkTetra.h>

#include "check.h"

namespace {

std::shared_ptr<const lapd::mesh> ball() {
    constexpr std::size_t n = 16;
    std::vector<std::uint8_t> voxels(n * n * n);
    for (std::size_t i = 0; i < voxels.size(); i++) {
        const double x = double(i % n) - 7.5, y = double(i / n % n) - 7.5,
                     z = double(i / n / n) - 7.5;
        voxels[i] = x * x + y * y + z * z < 36 ? (x < 0 ? 2 : 9) : 0;
    }
    lapd::grid grid;
    grid.dims = {n, n, n};
    lapd::context context;
    return std::make_shared<const lapd::mesh>(lapd::mesh::make(
        context, lapd::image::create(context, voxels.data(), grid), lapd::params()));
}

double volume(vtkUnstructuredGrid *grid) {
    double sum = 0, p[4][3];
    for (vtkIdType c = 0; c < grid->GetNumberOfCells(); c++) {
        vtkIdType size;
        const vtkIdType *ids;
        grid->GetCellPoints(c, size, ids);
        CHECK(size == 4 && grid->GetCellType(c) == VTK_TETRA);
        for (int i = 0; i < 4; i++) {
            grid->GetPoint(ids[i], p[i]);
        }
        const double part = vtkTetra::ComputeVolume(p[0], p[1], p[2], p[3]);
        CHECK(part > 0);
        sum += part;
    }
    return sum;
}

} // namespace

int main() {
    auto mesh = ball();
    const std::weak_ptr<const lapd::mesh> alive = mesh;
    double expected = 0;
    for (std::size_t i = 0; i < mesh->label_row_count(); i++) {
        expected += mesh->label_row(i).mesh_volume;
    }

    auto grid = to_vtk(mesh);
    CHECK(static_cast<std::size_t>(grid->GetNumberOfCells()) == mesh->tets().size());
    CHECK(grid->GetPoints()->GetVoidPointer(0) == mesh->points().data());
    CHECK(grid->GetCells()->GetConnectivityArray32()->GetPointer(0) ==
          reinterpret_cast<const std::int32_t *>(mesh->tets().data()));
    auto *labels = vtkIntArray::SafeDownCast(grid->GetCellData()->GetArray("label"));
    CHECK(labels != nullptr && labels->GetPointer(0) == mesh->labels().data());

    // VTK alone holds the mesh now.
    mesh.reset();
    CHECK(alive.use_count() > 0);
    CHECK(std::fabs(volume(grid) - expected) < 1e-9 * expected);

    // A copy is VTK's own; what shares buffers keeps the mesh, and so does a single array.
    vtkNew<vtkUnstructuredGrid> deep;
    deep->DeepCopy(grid);
    CHECK(deep->GetPoints()->GetVoidPointer(0) != grid->GetPoints()->GetVoidPointer(0));
    vtkNew<vtkDoubleArray> points;
    points->ShallowCopy(grid->GetPoints()->GetData());
    grid = nullptr;
    CHECK(alive.use_count() == 1 && points->GetNumberOfTuples() > 0 &&
          std::isfinite(points->GetValue(0)));
    points->Initialize();
    CHECK(alive.expired());
    CHECK(std::fabs(volume(deep) - expected) < 1e-9 * expected);
    return RESULT;
}
