/* Split interfaces: regions have nodes of their own there, and files two boundaries. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "phantom.h"

enum { N = 16, LABELS = 4 };

static lapd_context *context;

/* A ball of three sectors around an axis; labels 1 to 3. */
static lapd_image *sectors(void) {
    static uint8_t voxels[N * N * N];
    for (int k = 0; k < N; k++) {
        for (int j = 0; j < N; j++) {
            for (int i = 0; i < N; i++) {
                const double x = i - 7.3, y = j - 7.6, z = k - 7.5;
                const int sector = y < 0 ? 1 : x < 0 ? 2 : 3;
                voxels[i + N * (j + N * k)] = x * x + y * y + z * z < 36 ? (uint8_t)sector : 0;
            }
        }
    }
    return unit_image(context, voxels, N);
}

/* Which labels the tets of each vertex have, a bit each; the caller frees it. */
static unsigned char *labels_of_vertices(const lapd_mesh *mesh, size_t *count) {
    const double *points;
    const uint32_t *tets;
    const int32_t *labels;
    size_t n;
    CHECK(lapd_mesh_get_points(mesh, &points, count) == LAPD_OK);
    CHECK(lapd_mesh_get_tets(mesh, &tets, &n) == LAPD_OK);
    CHECK(lapd_mesh_get_labels(mesh, &labels, &n) == LAPD_OK);
    unsigned char *of_vertices = calloc(*count, 1);
    for (size_t i = 0; i < 4 * n; i++) {
        of_vertices[tets[i]] |= (unsigned char)(1 << labels[i / 4]);
    }
    return of_vertices;
}

static double volume(const lapd_mesh *mesh) {
    lapd_label_row row = {.struct_size = sizeof row};
    double sum = 0;
    for (size_t i = 0; i < 3; i++) {
        CHECK(lapd_mesh_get_label_row(mesh, i, &row) == LAPD_OK);
        sum += row.mesh_volume;
    }
    return sum;
}

static lapd_mesh *make(const lapd_image *image, const lapd_params *params) {
    lapd_mesh *mesh = NULL;
    CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
    return mesh;
}

static void split_all(lapd_mesh *mesh) {
    size_t before, after, pair_count;
    unsigned char *of_vertices = labels_of_vertices(mesh, &before);
    size_t copies = 0;
    for (size_t v = 0; v < before; v++) {
        for (int label = 1, seen = 0; label < LABELS; label++) {
            const int has = of_vertices[v] >> label & 1;
            copies += (size_t)(has && seen);
            seen |= has;
        }
    }
    free(of_vertices);
    const double volume_before = volume(mesh);
    CHECK(lapd_mesh_split_interfaces(context, mesh, NULL, 0) == LAPD_OK);
    CHECK(volume(mesh) == volume_before);
    of_vertices = labels_of_vertices(mesh, &after);
    CHECK(after == before + copies && copies > 50);
    for (size_t v = 0; v < after; v++) {
        CHECK(of_vertices[v] == 2 || of_vertices[v] == 4 || of_vertices[v] == 8);
    }
    free(of_vertices);
    const uint32_t *pairs;
    const double *points;
    CHECK(lapd_mesh_get_node_pairs(mesh, &pairs, &pair_count) == LAPD_OK && pair_count == copies);
    CHECK(lapd_mesh_get_points(mesh, &points, &after) == LAPD_OK);
    for (size_t i = 0; i < pair_count; i++) {
        CHECK(pairs[2 * i] < before && pairs[2 * i + 1] == before + i);
        CHECK(memcmp(points + 3 * pairs[2 * i], points + 3 * pairs[2 * i + 1],
                     3 * sizeof *points) == 0);
    }
    CHECK(lapd_mesh_split_interfaces(context, mesh, NULL, 0) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(strstr(lapd_context_last_error(context), "split before") != NULL);
}

int main(void) {
    CHECK(lapd_context_create(&context) == LAPD_OK);
    lapd_image *image = sectors();
    lapd_params *params = params_with_delta(context, 1.5);
    lapd_mesh *mesh = make(image, params);
    const uint32_t *pairs;
    size_t count, before, after;
    CHECK(lapd_mesh_get_node_pairs(mesh, &pairs, &count) == LAPD_OK && count == 0);
    split_all(mesh);
    CHECK(lapd_mesh_certify(context, mesh, image, params) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_mesh_write(context, mesh, "split.inp") == LAPD_OK);
    CHECK(lapd_mesh_write(context, mesh, "split.foam") == LAPD_OK);
    lapd_mesh_free(mesh);

    /* Between two of them, up to the axis, where the third one holds both. */
    mesh = make(image, params);
    unsigned char *of_vertices = labels_of_vertices(mesh, &before);
    size_t expected = 0;
    for (size_t v = 0; v < before; v++) {
        expected += of_vertices[v] == 12;
    }
    free(of_vertices);
    const int32_t two[] = {3, 2}, same[] = {2, 2}, strange[] = {2, 9};
    CHECK(lapd_mesh_split_interfaces(context, mesh, same, 1) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_mesh_split_interfaces(context, mesh, strange, 1) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(strstr(lapd_context_last_error(context), "2 and 9") != NULL);
    CHECK(lapd_mesh_split_interfaces(context, mesh, two, 1) == LAPD_OK);
    CHECK(lapd_mesh_get_node_pairs(mesh, &pairs, &count) == LAPD_OK);
    of_vertices = labels_of_vertices(mesh, &after);
    CHECK(after == before + count && count == expected && count > 10);
    free(of_vertices);

    lapd_mesh_free(mesh);
    lapd_params_free(params);
    lapd_image_free(image);
    lapd_context_free(context);
    return RESULT;
}
