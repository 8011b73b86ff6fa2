// The first program of a user, in C++17.
#include <lapd.hpp>

#include <cstring>
#include <iostream>
#include <vector>

int main() try {
    std::vector<short> voxels(6 * 6 * 6);
    for (std::size_t i = 0; i < voxels.size(); i++) {
        const std::size_t x = i % 6, y = i / 6 % 6, z = i / 36;
        voxels[i] = x > 0 && x < 5 && y > 0 && y < 5 && z > 0 && z < 5;
    }
    lapd::grid grid;
    grid.dims = {6, 6, 6};

    lapd::context context;
    const lapd::image image = lapd::image::create(context, voxels.data(), grid);
    const lapd::mesh mesh = lapd::mesh::make(context, image, lapd::params());
    std::cout << "lapd " << lapd::version() << ": " << mesh.tets().size() << " tets\n";
    return !mesh.tets().empty() && std::strcmp(lapd::version(), LAPD_VERSION) == 0 ? 0 : 1;
} catch (const std::exception &error) {
    std::cerr << error.what() << '\n';
    return 1;
}
