// From lapd to VTK: a mesh as a vtkUnstructuredGrid, with copies only where VTK's layout wants
// other numbers than lapd's.
//
//   points        shared: lapd's double[n][3] is VTK's
//   label         shared: int32_t is the int of vtkIntArray
//   connectivity  shared: since VTK 9, cell arrays may be of 32 bits, and lapd's numbers stay below
//                 2^28, so that their unsigned 32 bits read the same when signed
//   offsets       made, 4 bytes for each tet: VTK wants the place of every cell in the
//                 connectivity, lapd knows that it is 4 * i
//   cell types    made, 1 byte for each tet, by VTK
//
// VTK may read the shared arrays as long as it likes: the mesh lives until the last of their
// buffers is released. Nobody may write to them.
#ifndef LAPD_TO_VTK_HPP
#define LAPD_TO_VTK_HPP

#include <lapd.hpp>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkDoubleArray.h>
#include <vtkIntArray.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkSmartPointer.h>
#include <vtkTypeInt32Array.h>
#include <vtkUnstructuredGrid.h>

namespace lapd_to_vtk_detail {

// Which mesh a buffer belongs to that VTK holds. VTK says no more than the buffer's address when it
// lets go of it.
class lent_buffers {
  public:
    static void add(void *buffer, std::shared_ptr<const lapd::mesh> mesh) {
        std::lock_guard<std::mutex> lock(instance().mutex_);
        instance().owners_.emplace(buffer, std::move(mesh));
    }
    static void release(void *buffer) {
        std::shared_ptr<const lapd::mesh> last; // freed after the lock
        std::lock_guard<std::mutex> lock(instance().mutex_);
        const auto owner = instance().owners_.find(buffer);
        if (owner != instance().owners_.end()) {
            last = std::move(owner->second);
            instance().owners_.erase(owner);
        }
    }

  private:
    static lent_buffers &instance() {
        static lent_buffers buffers;
        return buffers;
    }
    std::mutex mutex_;
    std::multimap<void *, std::shared_ptr<const lapd::mesh>> owners_;
};

// Lets a VTK array read `count` values of the mesh.
template <class Array, class T>
void lend(Array *array, const std::shared_ptr<const lapd::mesh> &mesh, const T *values,
          std::size_t count) {
    static_assert(sizeof(typename Array::ValueType) == sizeof(T),
                  "the values would have to be copied");
    // VTK has no arrays of constants.
    auto *buffer = reinterpret_cast<typename Array::ValueType *>(const_cast<T *>(values));
    lent_buffers::add(buffer, mesh);
    array->SetArray(buffer, static_cast<vtkIdType>(count), 0, Array::VTK_DATA_ARRAY_USER_DEFINED);
    array->SetArrayFreeFunction(lent_buffers::release);
}

} // namespace lapd_to_vtk_detail

// Tets with positive volumes in VTK's sense, cell data "label".
inline vtkSmartPointer<vtkUnstructuredGrid> to_vtk(const std::shared_ptr<const lapd::mesh> &mesh) {
    using lapd_to_vtk_detail::lend;
    const auto points = mesh->points();
    const auto tets = mesh->tets();
    const auto labels = mesh->labels();
    if (tets.size() > VTK_TYPE_INT32_MAX / 4) {
        throw std::length_error("the mesh has too many tets for VTK's cell arrays of 32 bits");
    }

    vtkNew<vtkDoubleArray> coordinates;
    coordinates->SetNumberOfComponents(3);
    lend(coordinates.Get(), mesh, points.data(), 3 * points.size());
    vtkNew<vtkPoints> vtk_points;
    vtk_points->SetData(coordinates);

    vtkNew<vtkTypeInt32Array> connectivity, offsets;
    lend(connectivity.Get(), mesh, tets.data(), 4 * tets.size());
    offsets->SetNumberOfValues(static_cast<vtkIdType>(tets.size() + 1));
    for (std::size_t i = 0; i <= tets.size(); i++) {
        offsets->SetValue(static_cast<vtkIdType>(i), static_cast<vtkTypeInt32>(4 * i));
    }
    vtkNew<vtkCellArray> cells;
    cells->SetData(offsets, connectivity);

    vtkNew<vtkIntArray> label;
    label->SetName("label");
    lend(label.Get(), mesh, labels.data(), labels.size());

    auto grid = vtkSmartPointer<vtkUnstructuredGrid>::New();
    grid->SetPoints(vtk_points);
    grid->SetCells(VTK_TETRA, cells);
    grid->GetCellData()->SetScalars(label);
    return grid;
}

#endif
