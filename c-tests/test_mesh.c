/* Phantoms from buffers of all types, with strides, reflections and rotations; their meshes checked
 * by plain C. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "phantom.h"

enum { N = 24 };
static const double RADIUS = 9;
static const size_t DIMS[3] = {N, N, N};
static const double ORIGIN[3] = {-3, 5, 100};
static const double UNIT[3] = {1, 1, 1};

static lapd_context *context;

static bool near(double value, double wanted, double relative) {
    bool ok = fabs(value - wanted) <= relative * fabs(wanted);
    if (!ok) {
        fprintf(stderr, "got %g, wanted %g\n", value, wanted);
    }
    return ok;
}

static lapd_image *make_image(const void *voxels, int32_t type, const ptrdiff_t *strides,
                              const double *spacing, const double *direction) {
    lapd_image *image = NULL;
    lapd_status status =
        lapd_image_create(context, voxels, type, DIMS, strides, ORIGIN, spacing, direction, &image);
    if (status != LAPD_OK) {
        fprintf(stderr, "%s\n", lapd_context_last_error(context));
    }
    CHECK(status == LAPD_OK);
    return image;
}

static lapd_mesh *make_mesh(const lapd_image *image, const lapd_params *params) {
    lapd_mesh *mesh = NULL;
    lapd_status status = lapd_mesh_image(context, image, params, &mesh);
    if (status != LAPD_OK) {
        fprintf(stderr, "%s\n", lapd_context_last_error(context));
        exit(1);
    }
    return mesh;
}

static double voxel_volume_of(const int16_t *voxels, int16_t label) {
    double count = 0;
    for (size_t i = 0; i < (size_t)N * N * N; i++) {
        count += voxels[i] == label;
    }
    return count;
}

static void three_labels(void) {
    int16_t *voxels = three_label_voxels(N, RADIUS);
    lapd_params *params = params_with_delta(context, 1);
    lapd_image *image = make_image(voxels, LAPD_VOXEL_I16, NULL, UNIT, NULL);

    const int32_t *labels = NULL;
    size_t count = 0;
    CHECK(lapd_image_get_labels(image, &labels, &count) == LAPD_OK);
    CHECK(count == 3 && labels[0] == -5 && labels[1] == 3 && labels[2] == 300);

    lapd_mesh *mesh = make_mesh(image, params);
    check_mesh(mesh, false);
    for (size_t i = 0; i < count; i++) {
        CHECK(
            near(label_volume(mesh, labels[i]), voxel_volume_of(voxels, (int16_t)labels[i]), 0.05));
    }
    lapd_mesh *again = make_mesh(image, params);
    CHECK(same_mesh(mesh, again));
    lapd_mesh_free(again);
    lapd_mesh_free(mesh);

    CHECK(lapd_params_set_background(context, params, 1) == LAPD_OK);
    mesh = make_mesh(image, params);
    check_mesh(mesh, true);
    CHECK(label_volume(mesh, 0) > 0);
    lapd_mesh_free(mesh);

    lapd_image_free(image);
    lapd_params_free(params);
    free(voxels);
}

/* The same voxels stored backwards along x, and with other axes fastest, give the same bytes. */
static void strides(void) {
    int16_t *voxels = three_label_voxels(N, RADIUS);
    int16_t *stored = calloc((size_t)N * N * N, sizeof *stored);
    int32_t *copied = calloc((size_t)N * N * N, sizeof *copied);
    lapd_params *params = params_with_delta(context, 1.5);
    lapd_image *packed = make_image(voxels, LAPD_VOXEL_I16, NULL, UNIT, NULL);
    lapd_mesh *wanted = make_mesh(packed, params);
    static const ptrdiff_t layouts[3][3] = {
        {-1, N, (ptrdiff_t)N * N}, {(ptrdiff_t)N * N, N, 1}, {-N, (ptrdiff_t)-N * N, -1}};
    for (int l = 0; l < 3; l++) {
        const ptrdiff_t *s = layouts[l];
        ptrdiff_t first = 0;
        for (int axis = 0; axis < 3; axis++) {
            first -= s[axis] < 0 ? (N - 1) * s[axis] : 0;
        }
        for (ptrdiff_t i = 0; i < (ptrdiff_t)N * N * N; i++) {
            stored[first + i % N * s[0] + i / N % N * s[1] + i / N / N * s[2]] = voxels[i];
        }
        lapd_image *image = make_image(stored + first, LAPD_VOXEL_I16, s, UNIT, NULL);
        CHECK(lapd_image_copy_voxels(image, copied, (size_t)N * N * N) == LAPD_OK);
        for (size_t i = 0; i < (size_t)N * N * N; i++) {
            CHECK(copied[i] == voxels[i]);
        }
        lapd_mesh *mesh = make_mesh(image, params);
        CHECK(same_mesh(mesh, wanted));
        lapd_mesh_free(mesh);
        lapd_image_free(image);
    }
    lapd_mesh_free(wanted);
    lapd_image_free(packed);
    lapd_params_free(params);
    free(copied);
    free(stored);
    free(voxels);
}

/* A reflected and a rotated frame with unequal spacing: volumes stay positive, and the mesh lies
 * where the image does.
 */
static void frames(void) {
    static const double directions[2][9] = {{-1, 0, 0, 0, 1, 0, 0, 0, 1},
                                            {0, -1, 0, 0.6, 0, -0.8, 0.8, 0, 0.6}};
    static const double spacing[3] = {1, 0.5, 2};
    int16_t *voxels = three_label_voxels(N, RADIUS);
    lapd_params *params = params_with_delta(context, 1);
    for (int d = 0; d < 2; d++) {
        const double *m = directions[d];
        lapd_image *image = make_image(voxels, LAPD_VOXEL_I16, NULL, spacing, m);
        double values[9];
        size_t dims[3];
        CHECK(lapd_image_get_direction(image, values) == LAPD_OK);
        for (int i = 0; i < 9; i++) {
            CHECK(fabs(values[i] - m[i]) < 1e-12);
        }
        CHECK(lapd_image_get_origin(image, values) == LAPD_OK && values[2] == ORIGIN[2]);
        CHECK(lapd_image_get_spacing(image, values) == LAPD_OK && values[2] == spacing[2]);
        CHECK(lapd_image_get_dims(image, dims) == LAPD_OK && dims[0] == N);

        lapd_mesh *mesh = make_mesh(image, params);
        check_mesh(mesh, false);
        double volume = label_volume(mesh, 3) + label_volume(mesh, 300) + label_volume(mesh, -5);
        double wanted =
            voxel_volume_of(voxels, 3) + voxel_volume_of(voxels, 300) + voxel_volume_of(voxels, -5);
        CHECK(near(volume, wanted, 0.05));

        /* The middle of the mesh's vertices is about the middle of the image. */
        const double *points = NULL;
        size_t count = 0;
        CHECK(lapd_mesh_get_points(mesh, &points, &count) == LAPD_OK);
        for (int axis = 0; axis < 3; axis++) {
            double mean = 0, middle = ORIGIN[axis];
            for (size_t i = 0; i < count; i++) {
                mean += points[3 * i + axis] / (double)count;
            }
            for (int k = 0; k < 3; k++) {
                middle += m[3 * axis + k] * spacing[k] * (N - 1) / 2;
            }
            CHECK(fabs(mean - middle) < 1);
        }
        lapd_mesh_free(mesh);
        lapd_image_free(image);
    }
    lapd_params_free(params);
    free(voxels);
}

/* The same ball in every voxel type gives the same bytes. */
#define CHECK_TYPE(type, number)                                                                   \
    do {                                                                                           \
        type *typed = calloc((size_t)N * N * N, sizeof *typed);                                    \
        for (size_t i = 0; i < (size_t)N * N * N; i++) {                                           \
            typed[i] = (type)voxels[i];                                                            \
        }                                                                                          \
        lapd_image *image = make_image(typed, number, NULL, UNIT, NULL);                           \
        free(typed); /* the image has its own copy */                                              \
        lapd_mesh *mesh = make_mesh(image, params);                                                \
        CHECK(same_mesh(mesh, wanted));                                                            \
        lapd_mesh_free(mesh);                                                                      \
        lapd_image_free(image);                                                                    \
    } while (0)

static void voxel_types(void) {
    uint8_t *voxels = ball_voxels(N, RADIUS);
    lapd_params *params = params_with_delta(context, 2);
    lapd_image *first = make_image(voxels, LAPD_VOXEL_U8, NULL, UNIT, NULL);
    lapd_mesh *wanted = make_mesh(first, params);
    check_mesh(wanted, false);
    CHECK_TYPE(int8_t, LAPD_VOXEL_I8);
    CHECK_TYPE(uint16_t, LAPD_VOXEL_U16);
    CHECK_TYPE(int16_t, LAPD_VOXEL_I16);
    CHECK_TYPE(uint32_t, LAPD_VOXEL_U32);
    CHECK_TYPE(int32_t, LAPD_VOXEL_I32);
    CHECK_TYPE(uint64_t, LAPD_VOXEL_U64);
    CHECK_TYPE(int64_t, LAPD_VOXEL_I64);
    lapd_mesh_free(wanted);
    lapd_image_free(first);
    lapd_params_free(params);
    free(voxels);
}

/* A path in UTF-8. */
static void files(void) {
    static const char *const path = "b\xc3\xa4ll.vtu";
    uint8_t *voxels = ball_voxels(N, RADIUS);
    lapd_params *params = params_with_delta(context, 2);
    lapd_image *image = make_image(voxels, LAPD_VOXEL_U8, NULL, UNIT, NULL);
    lapd_mesh *mesh = make_mesh(image, params);
    CHECK(lapd_mesh_write(context, mesh, path) == LAPD_OK);
    FILE *file = fopen(path, "rb");
    CHECK(file != NULL && fgetc(file) != EOF);
    if (file != NULL) {
        fclose(file);
    }
    remove(path);
    lapd_mesh_free(mesh);
    lapd_image_free(image);
    lapd_params_free(params);
    free(voxels);
}

int main(void) {
    CHECK(lapd_context_create(&context) == LAPD_OK);
    three_labels();
    strides();
    frames();
    voxel_types();
    files();
    lapd_context_free(context);
    return RESULT;
}
