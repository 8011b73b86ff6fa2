// vtk_view: meshes an image, cuts the mesh in half, and writes a picture of the tissues, each label
// in a colour of its own.
//
//   vtk_view IMAGE OUT.png [DELTA [SIZE]]
//
// Nothing is shown on a screen, but VTK as Debian builds it wants an X server all the same: without
// one, run it by xvfb-run. Exit status: 0 only if a picture was written; 2 for bad usage.
#include "lapd_to_vtk.hpp"

#include <cmath>
#include <cstdlib>
#include <iostream>
#include <vtkActor.h>
#include <vtkAutoInit.h>
#include <vtkCamera.h>
#include <vtkDataSetMapper.h>
#include <vtkDataSetSurfaceFilter.h>
#include <vtkLookupTable.h>
#include <vtkPNGWriter.h>
#include <vtkPlane.h>
#include <vtkProperty.h>
#include <vtkRenderWindow.h>
#include <vtkRenderer.h>
#include <vtkTableBasedClipDataSet.h>
#include <vtkWindowToImageFilter.h>

VTK_MODULE_INIT(vtkRenderingOpenGL2);

namespace {

// Hues a golden section apart: neighbours in the list look different, however many there are.
vtkSmartPointer<vtkLookupTable> colours(lapd::span<std::int32_t> labels) {
    auto table = vtkSmartPointer<vtkLookupTable>::New();
    table->IndexedLookupOn();
    table->SetNumberOfTableValues(static_cast<vtkIdType>(labels.size()));
    for (std::size_t i = 0; i < labels.size(); i++) {
        double hsv[3] = {std::fmod(0.618034 * static_cast<double>(i), 1), i % 2 == 0 ? 0.55 : 0.8,
                         0.95},
               rgb[3];
        vtkMath::HSVToRGB(hsv, rgb);
        table->SetTableValue(static_cast<vtkIdType>(i), rgb[0], rgb[1], rgb[2], 1);
        table->SetAnnotation(vtkVariant(labels[i]), std::to_string(labels[i]));
    }
    return table;
}

void write_picture(vtkUnstructuredGrid *grid, lapd::span<std::int32_t> labels, const char *path) {
    // What lies behind the middle of y stays.
    vtkNew<vtkPlane> plane;
    plane->SetOrigin(grid->GetCenter());
    plane->SetNormal(0, 1, 0);
    vtkNew<vtkTableBasedClipDataSet> half;
    half->SetInputData(grid);
    half->SetClipFunction(plane);
    vtkNew<vtkDataSetSurfaceFilter> surface;
    surface->SetInputConnection(half->GetOutputPort());

    vtkNew<vtkDataSetMapper> mapper;
    mapper->SetInputConnection(surface->GetOutputPort());
    mapper->SetScalarModeToUseCellData();
    mapper->SetLookupTable(colours(labels));
    mapper->UseLookupTableScalarRangeOn();
    vtkNew<vtkActor> actor;
    actor->SetMapper(mapper);
    actor->GetProperty()->EdgeVisibilityOn();
    actor->GetProperty()->SetEdgeColor(0.2, 0.2, 0.2);
    actor->GetProperty()->SetLineWidth(0.5f);

    vtkNew<vtkRenderer> renderer;
    renderer->SetBackground(1, 1, 1);
    renderer->AddActor(actor);
    auto *camera = renderer->GetActiveCamera();
    camera->SetViewUp(0, 0, 1);
    camera->SetPosition(0.4, -2, 0.5);
    camera->SetFocalPoint(0, 0, 0);
    renderer->ResetCamera();
    camera->Zoom(1.15);

    vtkNew<vtkRenderWindow> window;
    if (window->IsA("vtkXOpenGLRenderWindow") && std::getenv("DISPLAY") == nullptr) {
        throw std::runtime_error("this VTK needs an X server; try xvfb-run");
    }
    window->SetOffScreenRendering(1);
    window->SetMultiSamples(0);
    window->SetSize(1000, 800);
    window->AddRenderer(renderer);
    window->Render();

    vtkNew<vtkWindowToImageFilter> pixels;
    pixels->SetInput(window);
    pixels->ReadFrontBufferOff();
    vtkNew<vtkPNGWriter> writer;
    writer->SetFileName(path);
    writer->SetInputConnection(pixels->GetOutputPort());
    writer->Write();
    if (writer->GetErrorCode() != 0) {
        throw std::runtime_error(std::string(path) + ": cannot be written");
    }
}

} // namespace

int main(int argc, char **argv) try {
    if (argc < 3 || argc > 5) {
        std::cerr << "usage: vtk_view IMAGE OUT.png [DELTA [SIZE]]\n";
        return 2;
    }
    lapd::context context;
    lapd::params params;
    const double delta = argc > 3 ? std::atof(argv[3]) : 1;
    params.set_delta(delta).set_size(argc > 4 ? std::atof(argv[4]) : 2 * delta);

    const lapd::image image = lapd::image::read(context, argv[1]);
    auto mesh = std::make_shared<const lapd::mesh>(lapd::mesh::make(context, image, params));
    const auto grid = to_vtk(mesh);
    std::cout << argv[2] << ": " << grid->GetNumberOfPoints() << " points, "
              << grid->GetNumberOfCells() << " cells\n";
    mesh.reset(); // VTK has what it needs, and keeps it
    write_picture(grid, image.labels(), argv[2]);
    return 0;
} catch (const std::exception &error) {
    std::cerr << "vtk_view: " << error.what() << '\n';
    return 1;
}
