/*
 * minimal: the shortest program that meshes an image.
 *
 *   minimal                 a ball from memory, written to ball.vtu
 *   minimal IMAGE OUT.vtu   an image file
 *
 * Every function returns 0 for success, so a chain of || stops at the first failure; the context
 * then has the message. Handles begin as NULL, which the free functions take, so the end is the
 * same wherever the chain stopped.
 */
#include <lapd.h>
#include <stdio.h>

enum { N = 20 };

/* A ball of label 1 in the background 0. The library copies the voxels. */
static lapd_status make_ball(lapd_context *context, lapd_image **image) {
    static uint8_t voxels[N][N][N]; /* z, y, x: x is fastest */
    const size_t dims[3] = {N, N, N};
    const double origin[3] = {0, 0, 0}, spacing[3] = {1, 1, 1};
    for (int z = 0; z < N; z++)
        for (int y = 0; y < N; y++)
            for (int x = 0; x < N; x++)
                voxels[z][y][x] =
                    (x - 10) * (x - 10) + (y - 10) * (y - 10) + (z - 10) * (z - 10) < 64;
    return lapd_image_create(context, voxels, LAPD_VOXEL_U8, dims, NULL, origin, spacing, NULL,
                             image);
}

int main(int argc, char **argv) {
    if (argc != 1 && argc != 3) {
        fprintf(stderr, "usage: minimal [IMAGE OUT.vtu]\n");
        return 2;
    }
    const char *out = argc == 3 ? argv[2] : "ball.vtu";
    lapd_context *context = NULL;
    lapd_image *image = NULL;
    lapd_params *params = NULL;
    lapd_mesh *mesh = NULL;
    lapd_counts counts = {.struct_size = sizeof counts};
    int failed = lapd_context_create(&context) || lapd_params_create(&params) ||
                 lapd_params_set_delta(context, params, 1.5) ||
                 lapd_params_set_size(context, params, 3) ||
                 (argc == 3 ? lapd_image_read(context, argv[1], LAPD_WORLD_AS_STORED, &image)
                            : make_ball(context, &image)) ||
                 lapd_mesh_image(context, image, params, &mesh) ||
                 lapd_mesh_write(context, mesh, out) || lapd_mesh_get_counts(mesh, &counts);
    if (failed)
        fprintf(stderr, "minimal: %s\n", lapd_context_last_error(context));
    else
        printf("%s: %llu vertices, %llu tets\n", out, (unsigned long long)counts.vertices,
               (unsigned long long)counts.tets);
    lapd_mesh_free(mesh);
    lapd_params_free(params);
    lapd_image_free(image);
    lapd_context_free(context);
    return failed;
}
