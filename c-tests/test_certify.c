/* Meshes that are certified after they were made, and meshes of arrays that no run made: here the
 * voxels of an image, each cut into six tets. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "phantom.h"

enum { N = 6, POINTS = (N + 1) * (N + 1) * (N + 1), TETS = 6 * N * N * N };

static lapd_context *context;
static double points[3 * POINTS];
static uint32_t tets[4 * TETS];
static int32_t labels[TETS];
static uint8_t voxels[N * N * N];

/* Whether the last message has this text in it. */
static bool said(const char *text) {
    const bool found = strstr(lapd_context_last_error(context), text) != NULL;
    if (!found) {
        fprintf(stderr, "message: %s\n", lapd_context_last_error(context));
    }
    return found;
}

/* A block of label 7 around a core of label 2; each voxel is cut along its paths from the first
 * corner to the last one. */
static void make_arrays(void) {
    static const int paths[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1},
                                    {0, 2, 1}, {1, 0, 2}, {2, 1, 0}};
    for (size_t v = 0; v < POINTS; v++) {
        points[3 * v] = (double)(v % (N + 1)) - 0.5;
        points[3 * v + 1] = (double)(v / (N + 1) % (N + 1)) - 0.5;
        points[3 * v + 2] = (double)(v / ((N + 1) * (N + 1))) - 0.5;
    }
    const uint32_t steps[3] = {1, N + 1, (N + 1) * (N + 1)};
    for (size_t n = 0; n < sizeof voxels; n++) {
        const size_t at[3] = {n % N, n / N % N, n / (N * N)};
        bool inside = true;
        for (int axis = 0; axis < 3; axis++) {
            inside = inside && at[axis] >= 2 && at[axis] < 4;
        }
        voxels[n] = inside ? 2 : 7;
        for (size_t path = 0; path < 6; path++) {
            uint32_t *tet = tets + 4 * (6 * n + path);
            tet[0] = (uint32_t)(at[0] + (N + 1) * (at[1] + (N + 1) * at[2]));
            for (int i = 0; i < 3; i++) {
                tet[i + 1] = tet[i] + steps[paths[path][i]];
            }
            if (path >= 3) {
                const uint32_t third = tet[2];
                tet[2] = tet[3];
                tet[3] = third;
            }
            labels[6 * n + path] = voxels[n];
        }
    }
}

static lapd_status from_arrays(lapd_mesh **mesh) {
    return lapd_mesh_from_arrays(context, points, POINTS, tets, TETS, labels, mesh);
}

static lapd_certificate certificate_of(const lapd_mesh *mesh) {
    lapd_certificate certificate = {.struct_size = sizeof certificate};
    CHECK(lapd_mesh_get_certificate(mesh, &certificate) == LAPD_OK);
    return certificate;
}

/* The mesh of the voxels is all that a mesh can be. */
static void arrays_of_voxels(const lapd_image *image, lapd_params *params) {
    lapd_mesh *mesh = NULL;
    CHECK(from_arrays(&mesh) == LAPD_OK);
    if (mesh == NULL) {
        return;
    }
    const uint32_t *copied = NULL;
    size_t count = 0;
    CHECK(lapd_mesh_get_tets(mesh, &copied, &count) == LAPD_OK && count == TETS);
    CHECK(memcmp(copied, tets, sizeof tets) == 0);

    /* No run made it, and nothing was measured yet. */
    lapd_certificate certificate = {.struct_size = sizeof certificate};
    lapd_operations operations = {.struct_size = sizeof operations};
    lapd_improvement improvement = {.struct_size = sizeof improvement};
    CHECK(lapd_mesh_get_certificate(mesh, &certificate) == LAPD_ERROR_NOT_MEASURED);
    CHECK(lapd_mesh_get_operations(mesh, &operations) == LAPD_ERROR_NOT_MEASURED);
    CHECK(lapd_mesh_get_improvement(mesh, &improvement) == LAPD_ERROR_NOT_MEASURED);

    CHECK(lapd_params_set_certificate(context, params, LAPD_CERTIFICATE_FULL) == LAPD_OK);
    CHECK(lapd_mesh_certify(context, mesh, image, params) == LAPD_OK);
    certificate = certificate_of(mesh);
    CHECK(certificate.level == LAPD_CERTIFICATE_FULL);
    CHECK(certificate.non_delaunay_facets == 0 && certificate.inverted_tets == 0 &&
          certificate.orphan_vertices == 0 && certificate.open_edges == 0);
    CHECK(certificate.unmet[0] == LAPD_NOT_COUNTED && certificate.unmet[5] == LAPD_NOT_COUNTED);
    CHECK(certificate.mesh_to_image_max < 0.01 && certificate.image_to_mesh_max < 0.01);
    size_t rows = 0;
    CHECK(lapd_mesh_get_label_row_count(mesh, &rows) == LAPD_OK && rows == 2);
    for (size_t i = 0; i < rows; i++) {
        lapd_label_row row = {.struct_size = sizeof row};
        CHECK(lapd_mesh_get_label_row(mesh, i, &row) == LAPD_OK);
        CHECK(fabs(row.mesh_volume - row.image_volume) < 1e-9 && row.euler_mesh == row.euler_image);
    }
    CHECK(lapd_mesh_write(context, mesh, "test_certify.mesh") == LAPD_OK);
    CHECK(lapd_mesh_write_report(context, mesh, "test_certify.json", NULL) == LAPD_OK);
    lapd_mesh_free(mesh);
}

/* What a run left out is what it would have measured. */
static void a_run_without_certificate(const lapd_image *image, lapd_params *params) {
    lapd_mesh *mesh = NULL, *whole = NULL;
    CHECK(lapd_params_set_certificate(context, params, LAPD_CERTIFICATE_NONE) == LAPD_OK);
    CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
    CHECK(lapd_mesh_certify(context, mesh, image, params) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(said("nothing to measure"));
    CHECK(lapd_params_set_certificate(context, params, LAPD_CERTIFICATE_FULL) == LAPD_OK);
    CHECK(lapd_mesh_image(context, image, params, &whole) == LAPD_OK);
    CHECK(lapd_mesh_certify(context, mesh, image, params) == LAPD_OK);
    const lapd_certificate later = certificate_of(mesh), once = certificate_of(whole);
    CHECK(later.mesh_to_surface_max == once.mesh_to_surface_max &&
          later.image_to_mesh_mean == once.image_to_mesh_mean);
    CHECK(once.unmet[2] == 0 && later.unmet[2] == LAPD_NOT_COUNTED);
    lapd_mesh_free(mesh);
    lapd_mesh_free(whole);
}

static void faults(void) {
    lapd_mesh *mesh = NULL;
    tets[4 * 100 + 1] = POINTS;
    CHECK(from_arrays(&mesh) == LAPD_ERROR_INVALID_ARGUMENT && said("tet 100 has vertex 343"));
    make_arrays();
    points[7] = NAN;
    CHECK(from_arrays(&mesh) == LAPD_ERROR_INVALID_ARGUMENT && said("vertex 2"));
    make_arrays();
    memcpy(tets + 4 * 200, tets, 4 * sizeof *tets);
    CHECK(from_arrays(&mesh) == LAPD_ERROR_INVALID_ARGUMENT);
    make_arrays();
    CHECK(lapd_mesh_from_arrays(context, points, SIZE_MAX / 2, tets, TETS, labels, &mesh) ==
              LAPD_ERROR_INVALID_ARGUMENT &&
          said("points"));
    CHECK(mesh == NULL);
}

int main(void) {
    CHECK(lapd_context_create(&context) == LAPD_OK);
    make_arrays();
    lapd_image *image = unit_image(context, voxels, N);
    lapd_params *params = params_with_delta(context, 1);
    arrays_of_voxels(image, params);
    a_run_without_certificate(image, params);
    faults();
    lapd_params_free(params);
    lapd_image_free(image);
    lapd_context_free(context);
    return RESULT;
}
