// itk_to_lapd: meshes a label image of any format that ITK reads.
//
//   itk_to_lapd IMAGE OUT.vtu [DELTA [SIZE]]
//
// Coordinates of the mesh are ITK's: LPS, in millimetres. Exit status: 0 only if a mesh was
// written; 2 for bad usage.
#include "itk_to_lapd.hpp"

#include <cstdint>
#include <cstdlib>
#include <iostream>
#include <itkImageFileReader.h>
#include <itkImageIOFactory.h>
#include <string>

namespace {

template <class Pixel> lapd::image read_as(lapd::context &context, const std::string &path) {
    auto reader = itk::ImageFileReader<itk::Image<Pixel, 3>>::New();
    reader->SetFileName(path);
    reader->Update();
    return to_lapd<Pixel>(context, reader->GetOutput());
}

// Reads the pixels as the type that they have in the file: nothing is rounded on the way.
lapd::image read(lapd::context &context, const std::string &path) {
    auto io =
        itk::ImageIOFactory::CreateImageIO(path.c_str(), itk::CommonEnums::IOFileMode::ReadMode);
    if (io == nullptr) {
        throw std::runtime_error(path + ": ITK finds no image there that it can read");
    }
    io->SetFileName(path);
    io->ReadImageInformation();
    if (io->GetNumberOfComponents() != 1) {
        throw std::runtime_error(path + ": has " + std::to_string(io->GetNumberOfComponents()) +
                                 " components for each voxel, not one label");
    }
    switch (io->GetComponentType()) {
    case itk::IOComponentEnum::UCHAR:
        return read_as<unsigned char>(context, path);
    case itk::IOComponentEnum::CHAR:
        return read_as<signed char>(context, path);
    case itk::IOComponentEnum::USHORT:
        return read_as<unsigned short>(context, path);
    case itk::IOComponentEnum::SHORT:
        return read_as<short>(context, path);
    case itk::IOComponentEnum::UINT:
        return read_as<unsigned int>(context, path);
    case itk::IOComponentEnum::INT:
        return read_as<int>(context, path);
    case itk::IOComponentEnum::ULONG:
    case itk::IOComponentEnum::ULONGLONG:
        return read_as<std::uint64_t>(context, path);
    case itk::IOComponentEnum::LONG:
    case itk::IOComponentEnum::LONGLONG:
        return read_as<std::int64_t>(context, path);
    default:
        throw std::runtime_error(
            path + ": voxels are of type " +
            itk::ImageIOBase::GetComponentTypeAsString(io->GetComponentType()) +
            ", labels are integers");
    }
}

} // namespace

int main(int argc, char **argv) try {
    if (argc < 3 || argc > 5) {
        std::cerr << "usage: itk_to_lapd IMAGE OUT.vtu [DELTA [SIZE]]\n";
        return 2;
    }
    lapd::context context;
    context.set_log([](lapd_log_level level, const char *line) {
        if (level == LAPD_LOG_WARNING) {
            std::cerr << "itk_to_lapd: warning: " << line << '\n';
        }
    });
    lapd::params params;
    const double delta = argc > 3 ? std::atof(argv[3]) : 1;
    params.set_delta(delta).set_size(argc > 4 ? std::atof(argv[4]) : 2 * delta);

    const lapd::mesh mesh = lapd::mesh::make(context, read(context, argv[1]), params);
    mesh.write(context, argv[2]);
    std::cout << argv[2] << ": " << mesh.points().size() << " vertices, " << mesh.tets().size()
              << " tets\n";
    return 0;
} catch (const std::exception &error) {
    // lapd::error, and what ITK throws.
    std::cerr << "itk_to_lapd: " << error.what() << '\n';
    return 1;
}
