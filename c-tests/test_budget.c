/* A number of tets that is asked for, what a run will need, and what files do not say. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "phantom.h"

enum { N = 24 };

static lapd_context *context;

static void target(const lapd_image *image) {
    const uint64_t wanted = 12000;
    uint64_t got = 0;
    double delta = 0, size = 0;
    size_t count = 0;
    const int32_t *labels;
    lapd_mesh *mesh = NULL, *again = NULL;
    lapd_params *params = params_with_delta(context, 1.5);
    CHECK(lapd_params_get_target_tets(params, &got) == LAPD_OK && got == 0);
    CHECK(lapd_params_set_target_tets(context, params, UINT64_MAX) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_params_set_target_tets(context, params, wanted) == LAPD_OK);
    CHECK(lapd_params_get_target_tets(params, &got) == LAPD_OK && got == wanted);
    CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
    check_mesh(mesh, false);
    CHECK(lapd_mesh_get_labels(mesh, &labels, &count) == LAPD_OK);
    CHECK(count >= wanted * 9 / 10 && count <= wanted * 11 / 10);

    /* The bounds make the same mesh. */
    CHECK(lapd_mesh_get_bounds(mesh, &delta, &size) == LAPD_OK);
    CHECK(delta > 0 && size / delta > 1.99 && size / delta < 2.01);
    CHECK(lapd_params_set_target_tets(context, params, 0) == LAPD_OK);
    CHECK(lapd_params_set_delta(context, params, delta) == LAPD_OK);
    CHECK(lapd_params_set_size(context, params, size) == LAPD_OK);
    CHECK(lapd_mesh_image(context, image, params, &again) == LAPD_OK);
    CHECK(same_mesh(mesh, again));
    lapd_mesh_free(again);

    uint64_t tets = 0, peak = 0;
    double seconds = 0;
    CHECK(lapd_image_estimate(context, image, params, &tets, &peak, &seconds) == LAPD_OK);
    CHECK(tets > count / 2 && tets < 2 * count && peak > 1 << 20 && seconds > 0 && seconds < 60);
    lapd_params_free(params);
    lapd_mesh_free(mesh);
}

/* A mesh of arrays has no bounds. */
static void no_bounds(void) {
    const double points[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
    const uint32_t tet[] = {0, 1, 2, 3};
    const int32_t label = 1;
    double delta = 7, size = 7;
    lapd_mesh *mesh = NULL;
    CHECK(lapd_mesh_from_arrays(context, points, 4, tet, 1, &label, &mesh) == LAPD_OK);
    CHECK(lapd_mesh_get_bounds(mesh, &delta, &size) == LAPD_ERROR_UNSUPPORTED && delta == 7);
    lapd_mesh_free(mesh);
}

static void spacing(lapd_image *image) {
    const double sides[] = {0.5, 2, 3}, bad[] = {1, 0, 1};
    double got[3] = {0, 0, 0};
    CHECK(lapd_image_set_spacing(context, image, bad) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_image_get_spacing(image, got) == LAPD_OK && got[1] == 1);
    CHECK(lapd_image_set_spacing(context, image, sides) == LAPD_OK);
    CHECK(lapd_image_get_spacing(image, got) == LAPD_OK && memcmp(got, sides, sizeof got) == 0);
}

/* A NumPy array, which says no spacing and has one volume. */
static void files(void) {
    static const char header[] =
        "\x93NUMPY\x01\0\x76\0{'descr': '|u1', 'fortran_order': True, 'shape': (2, 2, 1), }";
    unsigned char bytes[132];
    memset(bytes, ' ', sizeof bytes);
    memcpy(bytes, header, sizeof header - 1);
    bytes[127] = '\n';
    memcpy(bytes + 128, "\0\1\2\3", 4);
    FILE *file = fopen("budget.npy", "wb");
    CHECK(file != NULL && fwrite(bytes, 1, sizeof bytes, file) == sizeof bytes);
    CHECK(fclose(file) == 0);
    lapd_image *image = NULL;
    CHECK(lapd_context_set_volume(context, -2) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_context_set_volume(context, 1) == LAPD_OK);
    CHECK(lapd_image_read(context, "budget.npy", LAPD_WORLD_AS_STORED, &image) ==
          LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(strstr(lapd_context_last_error(context), "volume 1 is asked for") != NULL);
    for (int64_t volume = -1; volume <= 0; volume++) {
        int32_t labels[4] = {0, 0, 0, 0};
        CHECK(lapd_context_set_volume(context, volume) == LAPD_OK);
        CHECK(lapd_image_read(context, "budget.npy", LAPD_WORLD_AS_STORED, &image) == LAPD_OK);
        CHECK(lapd_image_copy_voxels(image, labels, 4) == LAPD_OK && labels[3] == 3);
        lapd_image_free(image);
    }
    CHECK(lapd_context_set_volume(context, -1) == LAPD_OK);
    remove("budget.npy");
}

int main(void) {
    CHECK(lapd_context_create(&context) == LAPD_OK);
    uint8_t *voxels = ball_voxels(N, 9);
    lapd_image *image = unit_image(context, voxels, N);
    target(image);
    no_bounds();
    spacing(image);
    files();
    lapd_image_free(image);
    free(voxels);
    lapd_context_free(context);
    return 0;
}
