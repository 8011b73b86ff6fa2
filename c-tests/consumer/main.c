/* The first program of a user: an image from memory, a mesh, its arrays. */
#include <lapd.h>
#include <stdio.h>
#include <string.h>

int main(void) {
    uint8_t voxels[6 * 6 * 6];
    const size_t dims[3] = {6, 6, 6};
    const double origin[3] = {0, 0, 0}, spacing[3] = {1, 1, 1};
    memset(voxels, 0, sizeof voxels);
    for (int i = 0; i < 6 * 6 * 6; i++) {
        int x = i % 6, y = i / 6 % 6, z = i / 36;
        voxels[i] = x > 0 && x < 5 && y > 0 && y < 5 && z > 0 && z < 5;
    }

    lapd_context *context = NULL;
    lapd_image *image = NULL;
    lapd_params *params = NULL;
    lapd_mesh *mesh = NULL;
    const uint32_t *tets = NULL;
    size_t count = 0;
    lapd_status status = lapd_context_create(&context);
    if (status == LAPD_OK)
        status = lapd_image_create(context, voxels, LAPD_VOXEL_U8, dims, NULL, origin, spacing,
                                   NULL, &image);
    if (status == LAPD_OK)
        status = lapd_params_create(&params);
    if (status == LAPD_OK)
        status = lapd_mesh_image(context, image, params, &mesh);
    if (status == LAPD_OK)
        status = lapd_mesh_get_tets(mesh, &tets, &count);
    if (status != LAPD_OK)
        fprintf(stderr, "%s\n", lapd_context_last_error(context));
    printf("lapd %s: %lu tets\n", lapd_version(), (unsigned long)count);

    lapd_mesh_free(mesh);
    lapd_params_free(params);
    lapd_image_free(image);
    lapd_context_free(context);
    return status == LAPD_OK && count > 0 && strcmp(lapd_version(), LAPD_VERSION) == 0 ? 0 : 1;
}
