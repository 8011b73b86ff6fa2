/*
 * Thousands of create and free, and hundreds of meshes: memory does not grow. With a number as
 * argument, only that many of each: for tools that find leaks by other means, and are slow.
 */
#define _POSIX_C_SOURCE 200809L

#include <stdlib.h>
#include <unistd.h>

#include "check.h"
#include "phantom.h"

/* Resident memory in MiB. */
static double resident(void) {
    long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    CHECK(file != NULL && fscanf(file, "%*d %ld", &pages) == 1);
    if (file != NULL) {
        fclose(file);
    }
    return (double)pages * (double)sysconf(_SC_PAGESIZE) / 1048576;
}

static void handles(const uint8_t *voxels, int cycles) {
    for (int i = 0; i < cycles; i++) {
        lapd_context *context = NULL;
        CHECK(lapd_context_create(&context) == LAPD_OK);
        lapd_params *params = params_with_delta(context, 1);
        lapd_image *image = unit_image(context, voxels, 8);
        lapd_image *none = NULL;
        CHECK(lapd_params_set_delta(context, params, -1) == LAPD_ERROR_INVALID_ARGUMENT);
        CHECK(lapd_image_read(context, "no/such/file.nrrd", LAPD_WORLD_AS_STORED, &none) ==
              LAPD_ERROR_IO);
        lapd_image_free(image);
        lapd_params_free(params);
        lapd_context_free(context);
    }
}

static void meshes(const uint8_t *voxels, int cycles) {
    lapd_context *context = NULL;
    CHECK(lapd_context_create(&context) == LAPD_OK);
    lapd_params *params = params_with_delta(context, 1);
    lapd_image *image = unit_image(context, voxels, 8);
    for (int i = 0; i < cycles; i++) {
        lapd_mesh *mesh = NULL;
        CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
        lapd_mesh_free(mesh);
    }
    lapd_image_free(image);
    lapd_params_free(params);
    lapd_context_free(context);
}

int main(int argc, char **argv) {
    uint8_t *voxels = ball_voxels(8, 3);
    if (argc > 1) {
        handles(voxels, atoi(argv[1]));
        meshes(voxels, atoi(argv[1]));
        free(voxels);
        return RESULT;
    }
    handles(voxels, 100);
    meshes(voxels, 50);
    double before = resident();
    handles(voxels, 10000);
    meshes(voxels, 300);
    double growth = resident() - before;
    printf("grew by %.2f MiB\n", growth);
    CHECK(growth < 4);
    free(voxels);
    return RESULT;
}
