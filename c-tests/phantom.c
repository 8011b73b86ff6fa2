#define _POSIX_C_SOURCE 200809L

#include "phantom.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "check.h"

static void *allocate(size_t count, size_t size) {
    void *memory = calloc(count + 1, size);
    if (memory == NULL) {
        fputs("out of memory\n", stderr);
        exit(1);
    }
    return memory;
}

static void require(lapd_status status, lapd_context *context) {
    if (status != LAPD_OK) {
        fprintf(stderr, "cannot go on: %s: %s\n", lapd_status_name(status),
                lapd_context_last_error(context));
        exit(1);
    }
}

uint8_t *ball_voxels(size_t n, double radius) {
    uint8_t *voxels = allocate(n * n * n, sizeof *voxels);
    double c = ((double)n - 1) / 2;
    for (size_t i = 0; i < n * n * n; i++) {
        double x = (double)(i % n) - c, y = (double)(i / n % n) - c, z = (double)(i / n / n) - c;
        voxels[i] = x * x + y * y + z * z < radius * radius ? 7 : 0;
    }
    return voxels;
}

int16_t *three_label_voxels(size_t n, double radius) {
    int16_t *voxels = allocate(n * n * n, sizeof *voxels);
    uint8_t *ball = ball_voxels(n, radius);
    for (size_t i = 0; i < n * n * n; i++) {
        int16_t label = i % n < n / 2 ? 3 : i / n % n < n / 2 ? 300 : -5;
        voxels[i] = ball[i] != 0 ? label : 0;
    }
    free(ball);
    return voxels;
}

lapd_image *unit_image(lapd_context *context, const uint8_t *voxels, size_t n) {
    const size_t dims[3] = {n, n, n};
    const double origin[3] = {0, 0, 0}, spacing[3] = {1, 1, 1};
    lapd_image *image = NULL;
    require(lapd_image_create(context, voxels, LAPD_VOXEL_U8, dims, NULL, origin, spacing, NULL,
                              &image),
            context);
    return image;
}

lapd_params *params_with_delta(lapd_context *context, double delta) {
    lapd_params *params = NULL;
    require(lapd_params_create(&params), context);
    require(lapd_params_set_delta(context, params, delta), context);
    require(lapd_params_set_size(context, params, 2 * delta), context);
    return params;
}

typedef struct {
    const double *points;
    const uint32_t *tets, *neighbors, *facets, *facet_tets;
    const int32_t *labels, *facet_labels;
    size_t point_count, tet_count, facet_count;
} arrays;

static arrays get_arrays(const lapd_mesh *mesh) {
    arrays a;
    size_t n[4];
    memset(&a, 0, sizeof a);
    CHECK(lapd_mesh_get_points(mesh, &a.points, &a.point_count) == LAPD_OK);
    CHECK(lapd_mesh_get_tets(mesh, &a.tets, &a.tet_count) == LAPD_OK);
    CHECK(lapd_mesh_get_labels(mesh, &a.labels, &n[0]) == LAPD_OK);
    CHECK(lapd_mesh_get_neighbors(mesh, &a.neighbors, &n[1]) == LAPD_OK);
    CHECK(lapd_mesh_get_facets(mesh, &a.facets, &a.facet_count) == LAPD_OK);
    CHECK(lapd_mesh_get_facet_labels(mesh, &a.facet_labels, &n[2]) == LAPD_OK);
    CHECK(lapd_mesh_get_facet_tets(mesh, &a.facet_tets, &n[3]) == LAPD_OK);
    CHECK(n[0] == a.tet_count && n[1] == a.tet_count && n[2] == a.facet_count &&
          n[3] == a.facet_count);
    return a;
}

/* (b - a) x (c - a) . (d - a) */
static double signed_volume_6(const double *p, uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
    double u[3], v[3], w[3];
    for (int i = 0; i < 3; i++) {
        u[i] = p[3 * b + i] - p[3 * a + i];
        v[i] = p[3 * c + i] - p[3 * a + i];
        w[i] = p[3 * d + i] - p[3 * a + i];
    }
    return (u[1] * v[2] - u[2] * v[1]) * w[0] + (u[2] * v[0] - u[0] * v[2]) * w[1] +
           (u[0] * v[1] - u[1] * v[0]) * w[2];
}

static double tet_volume(const arrays *a, size_t t) {
    const uint32_t *v = a->tets + 4 * t;
    return signed_volume_6(a->points, v[0], v[1], v[2], v[3]) / 6;
}

/* Which vertex of tet `t` is not in this facet; 4 if the facet is not one of the tet's. */
static int opposite_vertex(const arrays *a, size_t t, const uint32_t *facet) {
    int opposite = 4, outside = 0;
    for (int i = 0; i < 4; i++) {
        uint32_t v = a->tets[4 * t + i];
        if (v != facet[0] && v != facet[1] && v != facet[2]) {
            opposite = i;
            outside++;
        }
    }
    return outside == 1 ? opposite : 4;
}

/* Counts what is wrong instead of printing every case. Returns the number of facets where the label
 * changes. */
static size_t check_tets(const arrays *a, bool background, size_t *wrong) {
    size_t changes = 0;
    for (size_t t = 0; t < a->tet_count; t++) {
        bool in_range = true;
        for (int i = 0; i < 4; i++) {
            uint32_t n = a->neighbors[4 * t + i];
            in_range = in_range && a->tets[4 * t + i] < a->point_count &&
                       (n < a->tet_count || n == LAPD_NO_TET);
        }
        if (!in_range) {
            ++*wrong;
            continue;
        }
        *wrong += !(tet_volume(a, t) > 0);
        *wrong += a->labels[t] == 0 && !background;
        for (int i = 0; i < 4; i++) {
            uint32_t n = a->neighbors[4 * t + i];
            if (n == LAPD_NO_TET) {
                changes += a->labels[t] != 0;
                continue;
            }
            uint32_t facet[3];
            for (int j = 0, k = 0; j < 4; j++) {
                if (j != i) {
                    facet[k++] = a->tets[4 * t + j];
                }
            }
            int back = opposite_vertex(a, n, facet);
            *wrong += back == 4 || a->neighbors[4 * n + back] != t;
            changes += a->labels[t] > a->labels[n];
        }
    }
    return changes;
}

static size_t check_facets(const arrays *a) {
    size_t wrong = 0;
    for (size_t f = 0; f < a->facet_count; f++) {
        const uint32_t *facet = a->facets + 3 * f;
        /* The smaller label first, the background last. */
        const int32_t first = a->facet_labels[2 * f], second = a->facet_labels[2 * f + 1];
        wrong += first == 0 || (second != 0 && first >= second);
        wrong += a->facet_tets[2 * f] == LAPD_NO_TET && a->facet_tets[2 * f + 1] == LAPD_NO_TET;
        for (int side = 0; side < 2; side++) {
            uint32_t t = a->facet_tets[2 * f + side];
            int32_t label = a->facet_labels[2 * f + side];
            if (t == LAPD_NO_TET) {
                wrong += label != 0;
                continue;
            }
            int opposite = t < a->tet_count ? opposite_vertex(a, t, facet) : 4;
            if (opposite == 4) {
                wrong++;
                continue;
            }
            double height = signed_volume_6(a->points, facet[0], facet[1], facet[2],
                                            a->tets[4 * (size_t)t + opposite]);
            wrong += a->labels[t] != label;
            /* The normal leads from the first side to the second. */
            wrong += side == 0 ? !(height < 0) : !(height > 0);
        }
    }
    return wrong;
}

static void check_report(const lapd_mesh *mesh, const arrays *a) {
    lapd_counts counts = {.struct_size = sizeof counts};
    CHECK(lapd_mesh_get_counts(mesh, &counts) == LAPD_OK);
    CHECK(counts.vertices == a->point_count && counts.tets == a->tet_count);
    CHECK(counts.interface_facets == a->facet_count);
    lapd_improvement improvement = {.struct_size = sizeof improvement};
    CHECK(lapd_mesh_get_improvement(mesh, &improvement) == LAPD_OK);
    CHECK(counts.all_tets >= counts.tets &&
          counts.all_vertices + improvement.splits >= counts.vertices);
    CHECK(counts.oracle_bytes > 0);

    size_t rows = 0, row_tets = 0;
    CHECK(lapd_mesh_get_label_row_count(mesh, &rows) == LAPD_OK);
    for (size_t i = 0; i < rows; i++) {
        lapd_label_row row = {.struct_size = sizeof row};
        CHECK(lapd_mesh_get_label_row(mesh, i, &row) == LAPD_OK);
        double volume = label_volume(mesh, (int32_t)row.label);
        CHECK(fabs(volume - row.mesh_volume) <= 1e-9 * volume);
        row_tets += row.tets;
    }
    CHECK(row_tets == counts.tissue_tets);

    lapd_certificate certificate = {.struct_size = sizeof certificate};
    CHECK(lapd_mesh_get_certificate(mesh, &certificate) == LAPD_OK);
    CHECK(certificate.non_delaunay_facets == 0 && certificate.inverted_tets == 0 &&
          certificate.orphan_vertices == 0);
}

void check_mesh(const lapd_mesh *mesh, bool background) {
    arrays a = get_arrays(mesh);
    size_t wrong = 0;
    CHECK(a.tet_count > 0 && a.facet_count > 0);
    size_t changes = check_tets(&a, background, &wrong);
    CHECK(wrong == 0);
    if (wrong == 0) {
        CHECK(changes == a.facet_count);
        CHECK(check_facets(&a) == 0);
        check_report(mesh, &a);
        uint8_t *used = allocate(a.point_count, 1);
        size_t unused = a.point_count;
        for (size_t i = 0; i < 4 * a.tet_count; i++) {
            unused -= !used[a.tets[i]];
            used[a.tets[i]] = 1;
        }
        CHECK(unused == 0);
        free(used);
    }
}

double label_volume(const lapd_mesh *mesh, int32_t label) {
    arrays a = get_arrays(mesh);
    double volume = 0;
    for (size_t t = 0; t < a.tet_count; t++) {
        volume += a.labels[t] == label ? tet_volume(&a, t) : 0;
    }
    return volume;
}

bool same_mesh(const lapd_mesh *first, const lapd_mesh *second) {
    arrays a = get_arrays(first), b = get_arrays(second);
    return a.point_count == b.point_count && a.tet_count == b.tet_count &&
           a.facet_count == b.facet_count &&
           memcmp(a.points, b.points, 3 * a.point_count * sizeof *a.points) == 0 &&
           memcmp(a.tets, b.tets, 4 * a.tet_count * sizeof *a.tets) == 0 &&
           memcmp(a.labels, b.labels, a.tet_count * sizeof *a.labels) == 0 &&
           memcmp(a.neighbors, b.neighbors, 4 * a.tet_count * sizeof *a.neighbors) == 0 &&
           memcmp(a.facets, b.facets, 3 * a.facet_count * sizeof *a.facets) == 0;
}

double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
