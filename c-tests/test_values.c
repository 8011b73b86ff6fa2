/* Images made of intensities and of probabilities, and smoothed labels: the meshes of balls, what
 * is refused, files. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "phantom.h"

enum { N = 22, VOXELS = N * N * N };

static const size_t dims[3] = {N, N, N};
static const double origin[3] = {0, 0, 0}, spacing[3] = {1, 1, 1}, radius = 8.2;

static lapd_context *context;
static lapd_params *params;

/* Whether the last message has this text in it. */
static bool said(const char *text) {
    const bool found = strstr(lapd_context_last_error(context), text) != NULL;
    if (!found) {
        fprintf(stderr, "message: %s\n", lapd_context_last_error(context));
    }
    return found;
}

/* How far voxel n lies within the ball. */
static double depth(size_t n) {
    const double x = (double)(n % N) - 10.4, y = (double)(n / N % N) - 10.7,
                 z = (double)(n / N / N) - 10.5;
    return radius - sqrt(x * x + y * y + z * z);
}

/* The volume of a ball as interpolation sees it: its surface is 1 / (6 r) further inside. */
static double ball(double r) {
    return 4.0 / 3 * 3.14159265358979 * pow(r - 1 / (6 * r), 3);
}

static lapd_mesh *mesh_of(const lapd_image *image) {
    lapd_mesh *mesh = NULL;
    CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
    if (mesh == NULL) {
        fprintf(stderr, "no mesh: %s\n", lapd_context_last_error(context));
        exit(1);
    }
    check_mesh(mesh, false);
    return mesh;
}

/* Meshes an image, which is freed, and compares a label's volume. */
static void expect_volume(lapd_image *image, int32_t label, double volume) {
    lapd_mesh *mesh = mesh_of(image);
    const double error = label_volume(mesh, label) / volume - 1;
    if (fabs(error) > 0.01) {
        fprintf(stderr, "volume of label %d is off by %g\n", (int)label, error);
        check_failures++;
    }
    lapd_mesh_free(mesh);
    lapd_image_free(image);
}

static void scans(const float *depths) {
    const double isovalues[2] = {0, 3};
    const int32_t window[2] = {-6, 0}, *labels = NULL;
    const double shell = ball(radius) - ball(radius - 3);
    lapd_image *image = NULL;
    size_t count = 0;
    CHECK(lapd_image_create_gray(context, depths, dims, NULL, origin, spacing, NULL, isovalues, 2,
                                 NULL, &image) == LAPD_OK);
    CHECK(lapd_image_get_labels(image, &labels, &count) == LAPD_OK && count == 2 &&
          labels[0] == 1 && labels[1] == 2);
    expect_volume(image, 1, shell);

    /* The same upside down, from its last voxel on. */
    const ptrdiff_t backwards[3] = {1, N, -N * N};
    image = NULL;
    CHECK(lapd_image_create_gray(context, depths + N * N * (N - 1), dims, backwards, origin,
                                 spacing, NULL, isovalues, 2, window, &image) == LAPD_OK);
    expect_volume(image, -6, shell);

    image = NULL;
    const double unsorted[2] = {3, 0}, high[1] = {50};
    CHECK(lapd_image_create_gray(context, depths, dims, NULL, origin, spacing, NULL, unsorted, 2,
                                 NULL, &image) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(said("isovalues must increase, got 0 after 3"));
    CHECK(lapd_image_create_gray(context, depths, dims, NULL, origin, spacing, NULL, high, 1, NULL,
                                 &image) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(said("no voxel has an intensity of 50 or more"));
    CHECK(lapd_image_create_gray(context, depths, dims, NULL, origin, spacing, NULL, isovalues, 0,
                                 NULL, &image) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(said("isovalues are needed, got 0"));
    const float nan[2] = {1, NAN};
    const size_t two[3] = {2, 1, 1}, none[3] = {0, 1, 1};
    CHECK(lapd_image_create_gray(context, nan, two, NULL, origin, spacing, NULL, isovalues, 1, NULL,
                                 &image) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(said("intensity of voxel [1, 0, 0] is NaN"));
    CHECK(lapd_image_create_gray(context, nan, none, NULL, origin, spacing, NULL, isovalues, 1,
                                 NULL, &image) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(said("dims[0]"));
    CHECK(image == NULL);
}

/* Counts the warnings about label 7. */
static void on_log(void *user, int32_t level, const char *message) {
    *(int *)user += level == LAPD_LOG_WARNING && strstr(message, "label 7 ") != NULL;
}

static void probabilities(const float *depths) {
    /* Ball and surroundings side by side, and a map that wins nowhere. */
    float *pairs = malloc(2 * VOXELS * sizeof *pairs),
          *nothing = calloc(2 * VOXELS, sizeof *nothing);
    for (size_t n = 0; n < VOXELS; n++) {
        pairs[2 * n] = 1 / (1 + expf(-depths[n]));
        pairs[2 * n + 1] = 1 - pairs[2 * n];
    }
    const ptrdiff_t strides[3] = {2, 2 * N, 2 * N * N};
    const float *maps[3] = {pairs, pairs + 1, nothing};
    const int32_t labels[3] = {40, 0, 7}, twice[2] = {1, 1};
    const char *warning = NULL;
    size_t count = 0;
    int logged = 0;
    lapd_image *image = NULL;
    CHECK(lapd_context_set_log(context, on_log, &logged) == LAPD_OK);
    CHECK(lapd_image_create_probabilities(context, maps, labels, 3, dims, strides, origin, spacing,
                                          NULL, &image) == LAPD_OK);
    CHECK(lapd_context_set_log(context, NULL, NULL) == LAPD_OK);
    CHECK(logged == 1);
    CHECK(lapd_image_get_warning_count(image, &count) == LAPD_OK && count == 1);
    CHECK(lapd_image_get_warning(image, 0, &warning) == LAPD_OK &&
          strstr(warning, "label 7 ") != NULL);
    expect_volume(image, 40, ball(radius));
    /* A signed distance; the background has the level 0. */
    image = NULL;
    CHECK(lapd_image_create_level_sets(context, &depths, labels, 1, dims, NULL, origin, spacing,
                                       NULL, &image) == LAPD_OK);
    expect_volume(image, 40, ball(radius));
    /* The surroundings have the rest. */
    image = NULL;
    CHECK(lapd_image_create_probabilities(context, maps, labels, 1, dims, strides, origin, spacing,
                                          NULL, &image) == LAPD_OK);
    expect_volume(image, 40, ball(radius));

    image = NULL;
    CHECK(lapd_image_create_probabilities(context, maps, twice, 2, dims, strides, origin, spacing,
                                          NULL, &image) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(said("two probability maps are given for label 1"));
    maps[1] = NULL;
    CHECK(lapd_image_create_probabilities(context, maps, labels, 2, dims, strides, origin, spacing,
                                          NULL, &image) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(said("maps[1] is NULL"));
    CHECK(lapd_image_create_probabilities(context, maps, labels, 0, dims, strides, origin, spacing,
                                          NULL, &image) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(image == NULL);
    free(nothing);
    free(pairs);
}

static void save(const char *name, const char *sizes, const float *values, size_t count) {
    FILE *file = fopen(name, "wb");
    CHECK(file != NULL);
    if (file != NULL) {
        fprintf(file, "NRRD0004\ntype: float\n%s\nencoding: raw\nendian: little\n\n", sizes);
        CHECK(fwrite(values, sizeof *values, count, file) == count);
        CHECK(fclose(file) == 0);
    }
}

static void files(const float *depths) {
    static const char *const names[2] = {"test_values_a.nrrd", "test_values_b.nrrd"};
    const double zero = 0;
    const int32_t label = 12;
    lapd_image *image = NULL;
    save(names[0], "dimension: 3\nsizes: 22 22 22\nspacings: 1 1 1", depths, VOXELS);
    CHECK(lapd_image_read_gray(context, names[0], LAPD_WORLD_AS_STORED, &zero, 1, &label, &image) ==
          LAPD_OK);
    expect_volume(image, 12, ball(radius));

    float *maps = malloc(2 * VOXELS * sizeof *maps);
    for (size_t n = 0; n < VOXELS; n++) {
        maps[n] = 1 / (1 + expf(-depths[n]));
        maps[n + VOXELS] = 0.9F * (1 - maps[n]);
    }
    image = NULL;
    save(names[0], "dimension: 4\nsizes: 22 22 22 2\nspacings: 1 1 1 1", maps, 2 * VOXELS);
    const int32_t both[2] = {3, 0}, twice[2] = {3, 3};
    CHECK(lapd_image_read_probabilities(context, names, 1, LAPD_WORLD_AS_STORED, both, 2, &image) ==
          LAPD_OK);
    lapd_image_free(image);
    image = NULL;
    /* Wrong labels are no fault of the file's, be it one or several. */
    CHECK(lapd_image_read_probabilities(context, names, 1, LAPD_WORLD_AS_STORED, both, 1, &image) ==
          LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(said("as many probability maps as labels are needed, at least one: got 2 and 1"));
    CHECK(lapd_image_read_probabilities(context, names, 1, LAPD_WORLD_AS_STORED, twice, 2,
                                        &image) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(said("two probability maps are given for label 3"));
    save(names[0], "dimension: 3\nsizes: 22 22 22\nspacings: 1 1 1", maps, VOXELS);
    save(names[1], "dimension: 3\nsizes: 22 22 22\nspacings: 1 1 1", maps + VOXELS, VOXELS);
    CHECK(lapd_image_read_probabilities(context, names, 2, LAPD_WORLD_AS_STORED, both, 1, &image) ==
          LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_image_read_probabilities(context, names, 2, LAPD_WORLD_AS_STORED, NULL, 0, &image) ==
          LAPD_OK);
    /* Where both have 0.9 : 1 the ball is a little larger. */
    expect_volume(image, 1, ball(radius + log(1 / 0.9)));
    image = NULL;
    save(names[1], "dimension: 3\nsizes: 11 22 22\nspacings: 1 1 1", maps, VOXELS / 2);
    CHECK(lapd_image_read_probabilities(context, names, 2, LAPD_WORLD_AS_STORED, NULL, 0, &image) ==
          LAPD_ERROR_FORMAT);
    CHECK(said("test_values_b.nrrd: a grid of [11, 22, 22] voxels"));
    maps[2 * VOXELS - 1] = 2;
    save(names[1], "dimension: 3\nsizes: 22 22 22\nspacings: 1 1 1", maps + VOXELS, VOXELS);
    CHECK(lapd_image_read_probabilities(context, names, 2, LAPD_WORLD_AS_STORED, NULL, 0, &image) ==
          LAPD_ERROR_FORMAT);
    CHECK(said("test_values_b.nrrd: the probability of label 2 of voxel [21, 21, 21] is 2"));
    CHECK(lapd_image_read_gray(context, "no such file.nrrd", LAPD_WORLD_AS_STORED, &zero, 1, NULL,
                               &image) == LAPD_ERROR_IO);
    CHECK(lapd_image_read_gray(context, "scan.jpeg", LAPD_WORLD_AS_STORED, &zero, 1, NULL,
                               &image) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(image == NULL);
    free(maps);
    remove(names[0]);
    remove(names[1]);
}

/* Checks the place of an image, which is freed: x and y of its origin and of its axes have this
 * sign. */
static void expect_frame(lapd_image *image, int32_t axes, double sign, size_t warnings) {
    int32_t found = -1;
    double at[3] = {0, 0, 0}, direction[9] = {0};
    size_t count = SIZE_MAX;
    CHECK(lapd_image_get_world_axes(image, &found) == LAPD_OK && found == axes);
    CHECK(lapd_image_get_origin(image, at) == LAPD_OK);
    CHECK(at[0] == 10 * sign && at[1] == 20 * sign && at[2] == 30);
    CHECK(lapd_image_get_direction(image, direction) == LAPD_OK);
    CHECK(direction[0] == sign && direction[4] == sign && direction[8] == 1);
    CHECK(lapd_image_get_warning_count(image, &count) == LAPD_OK && count == warnings);
    lapd_image_free(image);
}

static void frames(void) {
    static const char *const name = "test_values_frame.nrrd";
    static const struct {
        const char *space;
        int32_t world, axes;
        double sign;
        size_t warnings;
    } cases[] = {{"space: left-posterior-superior", LAPD_WORLD_AS_STORED, LAPD_AXES_LPS, 1, 0},
                 {"space: left-posterior-superior", LAPD_WORLD_LPS, LAPD_AXES_LPS, 1, 0},
                 {"space: left-posterior-superior", LAPD_WORLD_RAS, LAPD_AXES_RAS, -1, 0},
                 {"space: right-anterior-superior", LAPD_WORLD_AS_STORED, LAPD_AXES_RAS, 1, 0},
                 {"space: right-anterior-superior", LAPD_WORLD_LPS, LAPD_AXES_LPS, -1, 0},
                 {"space: left-anterior-superior", LAPD_WORLD_AS_STORED, LAPD_AXES_LAS, 1, 0},
                 {"space dimension: 3", LAPD_WORLD_AS_STORED, LAPD_AXES_UNKNOWN, 1, 0},
                 {"space dimension: 3", LAPD_WORLD_RAS, LAPD_AXES_UNKNOWN, 1, 1}};
    const float values[2] = {0, 1};
    const double half = 0.5;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char header[256];
        snprintf(header, sizeof header,
                 "dimension: 3\n%s\nsizes: 2 1 1\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n"
                 "space origin: (10,20,30)",
                 cases[i].space);
        save(name, header, values, 2);
        lapd_image *labels = NULL, *scan = NULL, *map = NULL;
        CHECK(lapd_image_read(context, name, cases[i].world, &labels) == LAPD_OK);
        CHECK(lapd_image_read_gray(context, name, cases[i].world, &half, 1, NULL, &scan) ==
              LAPD_OK);
        CHECK(lapd_image_read_probabilities(context, &name, 1, cases[i].world, NULL, 0, &map) ==
              LAPD_OK);
        expect_frame(labels, cases[i].axes, cases[i].sign, cases[i].warnings);
        expect_frame(scan, cases[i].axes, cases[i].sign, cases[i].warnings);
        expect_frame(map, cases[i].axes, cases[i].sign, cases[i].warnings);
    }
    remove(name);
}

static void smoothing(void) {
    double sigma = -1;
    CHECK(lapd_params_get_sigma(params, &sigma) == LAPD_OK && sigma == 0);
    CHECK(lapd_params_set_sigma(context, params, 5.5) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(said("sigma must lie in 0 to 5 voxels, got 5.5"));
    CHECK(lapd_params_set_sigma(context, params, 1) == LAPD_OK);
    CHECK(lapd_params_set_surface(context, params, LAPD_SURFACE_VOXEL) ==
          LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(said("sigma 1 smooths interfaces"));
    uint8_t *voxels = ball_voxels(N, radius);
    lapd_image *image = unit_image(context, voxels, N);
    lapd_mesh *mesh = mesh_of(image);
    const double ratio = label_volume(mesh, 7) / ball(radius);
    CHECK(ratio > 0.93 && ratio < 1.01);
    lapd_mesh_free(mesh);
    lapd_image_free(image);
    free(voxels);
}

int main(void) {
    float *depths = malloc(VOXELS * sizeof *depths);
    for (size_t n = 0; n < VOXELS; n++) {
        depths[n] = (float)depth(n);
    }
    CHECK(lapd_context_create(&context) == LAPD_OK);
    params = params_with_delta(context, 0.9);
    scans(depths);
    probabilities(depths);
    files(depths);
    frames();
    smoothing();
    lapd_params_free(params);
    lapd_context_free(context);
    free(depths);
    return RESULT;
}
