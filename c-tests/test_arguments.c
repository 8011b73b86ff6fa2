/* Unknown enum values, values out of range, wrong sizes, every argument NULL: refused, and nothing
 * is written. (test_null.c has the NULLs of all functions.) */
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "phantom.h"

#define INVALID(call) CHECK((call) == LAPD_ERROR_INVALID_ARGUMENT)

static lapd_context *context;
static lapd_image *image;
static lapd_params *params;
static lapd_mesh *mesh;

/* Whether the last message has this text in it. */
static bool said(const char *text) {
    const char *message = lapd_context_last_error(context);
    bool found = strstr(message, text) != NULL && strchr(message, '\n') == NULL;
    if (!found) {
        fprintf(stderr, "message: %s\n", message);
    }
    return found;
}

static void statuses(void) {
    CHECK(strcmp(lapd_version(), LAPD_VERSION) == 0);
    /* Words that the header lists. */
    char features[64] = "";
    strncat(features, lapd_features(), sizeof features - 1);
    for (char *word = strtok(features, " "); word != NULL; word = strtok(NULL, " ")) {
        CHECK(strcmp(word, "hwloc") == 0 || strcmp(word, "hdf5") == 0 || strcmp(word, "tiff") == 0);
    }
    CHECK(strcmp(lapd_status_name(0), "LAPD_OK") == 0);
    CHECK(strcmp(lapd_status_name(LAPD_ERROR_CANCELLED), "LAPD_ERROR_CANCELLED") == 0);
    for (int i = -2; i < 40; i++) {
        CHECK(strlen(lapd_status_name(i)) > 0 && strlen(lapd_status_message(i)) > 0);
    }
    CHECK(strcmp(lapd_status_name(-1), "LAPD_UNKNOWN_STATUS") == 0);
    CHECK(strcmp(lapd_status_message(INT_MAX), "unknown status") == 0);
}

static void contexts(void) {
    INVALID(lapd_context_create(NULL));
    INVALID(lapd_context_cancel(NULL));
    INVALID(lapd_context_reset_cancel(NULL));
    INVALID(lapd_context_set_progress(NULL, NULL, NULL));
    INVALID(lapd_context_set_log(NULL, NULL, NULL));
    CHECK(strlen(lapd_context_last_error(NULL)) > 0);
    lapd_context_free(NULL);

    lapd_context *fresh = NULL;
    CHECK(lapd_context_create(&fresh) == LAPD_OK);
    CHECK(strcmp(lapd_context_last_error(fresh), "") == 0);
    CHECK(lapd_context_set_progress(fresh, NULL, NULL) == LAPD_OK);
    CHECK(lapd_context_set_log(fresh, NULL, NULL) == LAPD_OK);
    lapd_context_free(fresh);
}

static void image_creation(void) {
    const uint8_t data[8] = {1, 1, 1, 1, 2, 2, 2, 2};
    const size_t dims[3] = {2, 2, 2}, flat[3] = {2, 0, 2}, huge[3] = {SIZE_MAX / 2, 3, 5};
    const ptrdiff_t far[3] = {PTRDIFF_MAX, PTRDIFF_MIN, 1};
    const double origin[3] = {0, 0, 0}, spacing[3] = {1, 1, 1}, zero[3] = {1, 0, 1},
                 nan[3] = {0, NAN, 0};
    const double sheared[9] = {1, 0.2, 0, 0, 1, 0, 0, 0, 1},
                 scaled[9] = {2, 0, 0, 0, 1, 0, 0, 0, 1};
    lapd_image *const untouched = (lapd_image *)&data;
    lapd_image *out = untouched;

    INVALID(lapd_image_create(NULL, data, LAPD_VOXEL_U8, dims, NULL, origin, spacing, NULL, &out));
    INVALID(
        lapd_image_create(context, NULL, LAPD_VOXEL_U8, dims, NULL, origin, spacing, NULL, &out));
    CHECK(said("data"));
    INVALID(
        lapd_image_create(context, data, LAPD_VOXEL_U8, NULL, NULL, origin, spacing, NULL, &out));
    CHECK(said("dims"));
    INVALID(lapd_image_create(context, data, LAPD_VOXEL_U8, dims, NULL, NULL, spacing, NULL, &out));
    CHECK(said("origin"));
    INVALID(lapd_image_create(context, data, LAPD_VOXEL_U8, dims, NULL, origin, NULL, NULL, &out));
    CHECK(said("spacing"));
    INVALID(
        lapd_image_create(context, data, LAPD_VOXEL_U8, dims, NULL, origin, spacing, NULL, NULL));
    CHECK(said("image"));
    INVALID(lapd_image_create(context, data, -1, dims, NULL, origin, spacing, NULL, &out));
    INVALID(lapd_image_create(context, data, 8, dims, NULL, origin, spacing, NULL, &out));
    CHECK(said("got 8"));
    INVALID(
        lapd_image_create(context, data, LAPD_VOXEL_U8, flat, NULL, origin, spacing, NULL, &out));
    CHECK(said("dims[1]"));
    INVALID(
        lapd_image_create(context, data, LAPD_VOXEL_U8, huge, NULL, origin, spacing, NULL, &out));
    /* One voxel too many to be numbered; refused before a number is read or room is made. */
    const size_t many[3] = {1 << 16, 1 << 16, 1};
    const float intensity = 1;
    const ptrdiff_t still[3] = {0, 0, 0};
    INVALID(
        lapd_image_create(context, data, LAPD_VOXEL_U8, many, still, origin, spacing, NULL, &out));
    CHECK(said("at most 2^32 - 1 voxels"));
    INVALID(lapd_image_create_gray(context, &intensity, many, still, origin, spacing, NULL, spacing,
                                   1, NULL, &out));
    CHECK(said("at most 2^32 - 1 voxels"));
    INVALID(
        lapd_image_create(context, data, LAPD_VOXEL_U8, dims, far, origin, spacing, NULL, &out));
    INVALID(lapd_image_create(context, data + 1, LAPD_VOXEL_I32, dims, NULL, origin, spacing, NULL,
                              &out));
    CHECK(said("aligned"));
    INVALID(lapd_image_create(context, data, LAPD_VOXEL_U8, dims, NULL, origin, zero, NULL, &out));
    INVALID(lapd_image_create(context, data, LAPD_VOXEL_U8, dims, NULL, nan, spacing, NULL, &out));
    INVALID(lapd_image_create(context, data, LAPD_VOXEL_U8, dims, NULL, origin, spacing, sheared,
                              &out));
    INVALID(
        lapd_image_create(context, data, LAPD_VOXEL_U8, dims, NULL, origin, spacing, scaled, &out));
    const int64_t large[1] = {INT64_C(1) << 40};
    const size_t one[3] = {1, 1, 1};
    INVALID(
        lapd_image_create(context, large, LAPD_VOXEL_I64, one, NULL, origin, spacing, NULL, &out));
    CHECK(out == untouched);

    INVALID(lapd_image_read(NULL, "a.nrrd", LAPD_WORLD_LPS, &out));
    INVALID(lapd_image_read(context, NULL, LAPD_WORLD_LPS, &out));
    INVALID(lapd_image_read(context, "a.nrrd", LAPD_WORLD_LPS, NULL));
    INVALID(lapd_image_read_labels(context, "a.nrrd", LAPD_WORLD_LPS, 3, NULL, 0, &out));
    INVALID(lapd_image_read_labels(context, "a.nrrd", LAPD_WORLD_LPS, -1, NULL, 0, &out));
    CHECK(lapd_image_read(context, "no/such/file.nrrd", LAPD_WORLD_LPS, &out) == LAPD_ERROR_IO);
    CHECK(said("no/such/file.nrrd"));
    INVALID(lapd_image_read(context, "a.png", LAPD_WORLD_LPS, &out));
    CHECK(said("a.png: no reader for this name ending"));
    static const char *const paths[1] = {"a.nrrd"};
    const int32_t unknown[2] = {-1, 3};
    for (int i = 0; i < 2; i++) {
        const char *number = i == 0 ? "world must be a lapd_world_frame, got -1" : "got 3";
        INVALID(lapd_image_read(context, "a.nrrd", unknown[i], &out));
        CHECK(said(number));
        INVALID(lapd_image_read_gray(context, "a.nrrd", unknown[i], spacing, 1, NULL, &out));
        CHECK(said(number));
        INVALID(lapd_image_read_probabilities(context, paths, 1, unknown[i], NULL, 0, &out));
        CHECK(said(number));
    }
    CHECK(out == untouched);
    lapd_image_free(NULL);
}

static void image_getters(void) {
    size_t dims[3], count = 99;
    double values[9];
    const int32_t *labels = NULL;
    const char *warning = NULL;
    INVALID(lapd_image_get_dims(NULL, dims));
    INVALID(lapd_image_get_dims(image, NULL));
    INVALID(lapd_image_get_origin(NULL, values));
    INVALID(lapd_image_get_origin(image, NULL));
    INVALID(lapd_image_get_spacing(NULL, values));
    INVALID(lapd_image_get_spacing(image, NULL));
    INVALID(lapd_image_get_direction(NULL, values));
    INVALID(lapd_image_get_direction(image, NULL));
    int32_t axes = -7;
    INVALID(lapd_image_get_world_axes(NULL, &axes));
    INVALID(lapd_image_get_world_axes(image, NULL));
    CHECK(axes == -7 && lapd_image_get_world_axes(image, &axes) == LAPD_OK &&
          axes == LAPD_AXES_UNKNOWN);
    INVALID(lapd_image_get_labels(NULL, &labels, &count));
    INVALID(lapd_image_get_labels(image, NULL, &count));
    INVALID(lapd_image_get_labels(image, &labels, NULL));
    static int32_t voxels[1000] = {9};
    INVALID(lapd_image_copy_voxels(NULL, voxels, 1000));
    INVALID(lapd_image_copy_voxels(image, NULL, 1000));
    CHECK(lapd_image_copy_voxels(image, voxels, 999) == LAPD_ERROR_BUFFER_TOO_SMALL &&
          voxels[0] == 9);
    CHECK(lapd_image_copy_voxels(image, voxels, 1000) == LAPD_OK && voxels[0] == 0);
    INVALID(lapd_image_get_warning_count(NULL, &count));
    INVALID(lapd_image_get_warning_count(image, NULL));
    INVALID(lapd_image_get_warning(NULL, 0, &warning));
    INVALID(lapd_image_get_warning(image, 0, NULL));
    INVALID(lapd_image_get_warning(image, 0, &warning));
    CHECK(count == 99 && labels == NULL && warning == NULL);
}

/* The setters that take a double, with a value that each must refuse and the getter that must not
 * change. */
static void double_parameters(void) {
    static const struct {
        lapd_status (*set)(lapd_context *, lapd_params *, double);
        lapd_status (*get)(const lapd_params *, double *);
        double good, bad;
    } table[] = {{lapd_params_set_delta, lapd_params_get_delta, 0.5, 0},
                 {lapd_params_set_size, lapd_params_get_size, 1.5, -1},
                 {lapd_params_set_radius_edge, lapd_params_get_radius_edge, 2.5, 1.9},
                 {lapd_params_set_spacing_floor, lapd_params_get_spacing_floor, 0.25, 0},
                 {lapd_params_set_facet_angle, lapd_params_get_facet_angle, 25, 31},
                 {lapd_params_set_coarsen, lapd_params_get_coarsen, 12, -1},
                 {lapd_params_set_across, lapd_params_get_across, 3, 0.5},
                 {lapd_params_set_least_size, lapd_params_get_least_size, 0.25, -1},
                 {lapd_params_set_gradation, lapd_params_get_gradation, 0.3, 0},
                 {lapd_params_set_target_dihedral, lapd_params_get_target_dihedral, 20, 40}};
    for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
        double value = 0;
        INVALID(table[i].set(NULL, params, table[i].good));
        INVALID(table[i].set(context, NULL, table[i].good));
        CHECK(table[i].set(context, params, table[i].good) == LAPD_OK);
        INVALID(table[i].set(context, params, table[i].bad));
        INVALID(table[i].set(context, params, NAN));
        INVALID(table[i].set(context, params, INFINITY));
        INVALID(table[i].get(NULL, &value));
        INVALID(table[i].get(params, NULL));
        CHECK(table[i].get(params, &value) == LAPD_OK && value == table[i].good);
    }
    /* It goes with full improvement only. */
    CHECK(lapd_params_set_coarsen(context, params, 0) == LAPD_OK);
    CHECK(lapd_params_set_across(context, params, 0) == LAPD_OK);
}

/* The setters that take an enum or a flag: how many values exist, and how many of them in this
 * version. */
static void choice_parameters(void) {
    static const struct {
        lapd_status (*set)(lapd_context *, lapd_params *, int32_t);
        lapd_status (*get)(const lapd_params *, int32_t *);
        int32_t known, supported;
    } table[] = {{lapd_params_set_surface, lapd_params_get_surface, 2, 2},
                 {lapd_params_set_border, lapd_params_get_border, 2, 2},
                 {lapd_params_set_background, lapd_params_get_background, 2, 2},
                 {lapd_params_set_algorithm, lapd_params_get_algorithm, 2, 2},
                 {lapd_params_set_adaptive, lapd_params_get_adaptive, 3, 3},
                 {lapd_params_set_count_accesses, lapd_params_get_count_accesses, 2, 2},
                 {lapd_params_set_contention, lapd_params_get_contention, 4, 4},
                 {lapd_params_set_begging, lapd_params_get_begging, 2, 2},
                 {lapd_params_set_bind, lapd_params_get_bind, 2, 2},
                 {lapd_params_set_timeline, lapd_params_get_timeline, 2, 2},
                 {lapd_params_set_curved, lapd_params_get_curved, 2, 2},
                 {lapd_params_set_improve, lapd_params_get_improve, 3, 3},
                 {lapd_params_set_certificate, lapd_params_get_certificate, 3, 3}};
    for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
        int32_t value = -7;
        INVALID(table[i].set(NULL, params, 0));
        INVALID(table[i].set(context, NULL, 0));
        INVALID(table[i].get(NULL, &value));
        INVALID(table[i].get(params, NULL));
        CHECK(value == -7);
        for (int32_t choice = table[i].known - 1; choice >= 0; choice--) {
            lapd_status wanted = choice < table[i].supported ? LAPD_OK : LAPD_ERROR_UNSUPPORTED;
            CHECK(table[i].set(context, params, choice) == wanted);
            CHECK(table[i].get(params, &value) == LAPD_OK &&
                  (wanted != LAPD_OK || value == choice));
        }
        INVALID(table[i].set(context, params, -1));
        INVALID(table[i].set(context, params, table[i].known));
        INVALID(table[i].set(context, params, INT32_MIN));
        CHECK(table[i].get(params, &value) == LAPD_OK && value == 0);
    }
}

static void order(void) {
    int32_t value = 0;
    CHECK(lapd_params_get_order(params, &value) == LAPD_OK && value == 1);
    INVALID(lapd_params_set_order(context, params, 3));
    CHECK(said("order must be 1 or 2, got 3"));
    INVALID(lapd_params_set_order(context, params, 0));
    INVALID(lapd_params_set_order(context, params, -2));
    CHECK(said("order must be 1 or 2, got -2"));
    CHECK(lapd_params_get_order(params, &value) == LAPD_OK && value == 1);
    CHECK(lapd_params_set_order(context, params, 2) == LAPD_OK);
    CHECK(lapd_params_get_order(params, &value) == LAPD_OK && value == 2);
    CHECK(lapd_params_set_order(context, params, 1) == LAPD_OK);
}

static void other_parameters(void) {
    INVALID(lapd_params_create(NULL));
    lapd_params_free(NULL);
    size_t count = 0;
    INVALID(lapd_params_set_threads(NULL, params, 1));
    INVALID(lapd_params_set_threads(context, NULL, 1));
    CHECK(lapd_params_get_threads(params, &count) == LAPD_OK && count == 1);
    CHECK(lapd_params_set_threads(context, params, LAPD_MAX_THREADS) == LAPD_OK);
    INVALID(lapd_params_set_threads(context, params, 0));
    CHECK(said("threads must lie in 1 to 254, got 0"));
    INVALID(lapd_params_set_threads(context, params, LAPD_MAX_THREADS + 1));
    CHECK(said("threads must lie in 1 to 254, got 255"));
    INVALID(lapd_params_set_threads(context, params, SIZE_MAX));
    INVALID(lapd_params_get_threads(NULL, &count));
    INVALID(lapd_params_get_threads(params, NULL));
    CHECK(lapd_params_get_threads(params, &count) == LAPD_OK && count == LAPD_MAX_THREADS);
    CHECK(lapd_params_set_threads(context, params, 1) == LAPD_OK);

    INVALID(lapd_params_set_max_vertices(NULL, params, 1));
    INVALID(lapd_params_set_max_vertices(context, NULL, 1));
    CHECK(lapd_params_set_max_vertices(context, params, 12) == LAPD_OK);
    INVALID(lapd_params_get_max_vertices(NULL, &count));
    INVALID(lapd_params_get_max_vertices(params, NULL));
    CHECK(lapd_params_get_max_vertices(params, &count) == LAPD_OK && count == 12);

    /* Descriptions are hwloc's; without it they are unsupported, whatever they say. */
    const char *topology = NULL;
    lapd_status synthetic = lapd_params_set_topology(context, params, "numa:4 core:4 pu:1");
    CHECK(synthetic == LAPD_OK || synthetic == LAPD_ERROR_UNSUPPORTED);
    CHECK((synthetic == LAPD_OK) == (strstr(lapd_features(), "hwloc") != NULL));
    CHECK(lapd_params_get_topology(params, &topology) == LAPD_OK);
    CHECK(strcmp(topology, synthetic == LAPD_OK ? "numa:4 core:4 pu:1" : "") == 0);
    CHECK(lapd_params_set_topology(context, params, "nonsense") != LAPD_OK &&
          said("topology 'nonsense'"));
    INVALID(lapd_params_set_topology(context, params, "numa:9999999 core:4 pu:1"));
    INVALID(lapd_params_set_topology(NULL, params, ""));
    INVALID(lapd_params_set_topology(context, NULL, ""));
    INVALID(lapd_params_set_topology(context, params, NULL));
    CHECK(lapd_params_set_topology(context, params, "") == LAPD_OK);
    INVALID(lapd_params_get_topology(NULL, &topology));
    INVALID(lapd_params_get_topology(params, NULL));
    CHECK(lapd_params_get_topology(params, &topology) == LAPD_OK && *topology == '\0');

    double size = 0;
    INVALID(lapd_params_set_label_size(NULL, params, 7, 1));
    INVALID(lapd_params_set_label_size(context, NULL, 7, 1));
    INVALID(lapd_params_set_label_size(context, params, 7, 0));
    CHECK(said("label 7"));
    CHECK(lapd_params_set_label_size(context, params, 7, 1) == LAPD_OK);
    CHECK(lapd_params_set_label_size(context, params, 7, 1.25) == LAPD_OK);
    INVALID(lapd_params_get_label_size(NULL, 7, &size));
    INVALID(lapd_params_get_label_size(params, 7, NULL));
    CHECK(lapd_params_get_label_size(params, 7, &size) == LAPD_OK && size == 1.25);
    CHECK(lapd_params_get_label_size(params, 8, &size) == LAPD_OK && size == 1.5);
    INVALID(lapd_params_clear_label_sizes(NULL, params));
    INVALID(lapd_params_clear_label_sizes(context, NULL));
    CHECK(lapd_params_clear_label_sizes(context, params) == LAPD_OK);
    CHECK(lapd_params_get_label_size(params, 7, &size) == LAPD_OK && size == 1.5);

    const int32_t two[2] = {7, -9};
    const int32_t *keep = NULL;
    INVALID(lapd_params_set_keep(NULL, params, two, 2));
    INVALID(lapd_params_set_keep(context, NULL, two, 2));
    INVALID(lapd_params_set_keep(context, params, NULL, 2));
    INVALID(lapd_params_set_keep(context, params, two, SIZE_MAX));
    CHECK(lapd_params_set_keep(context, params, two, 2) == LAPD_OK);
    INVALID(lapd_params_get_keep(NULL, &keep, &count));
    INVALID(lapd_params_get_keep(params, NULL, &count));
    INVALID(lapd_params_get_keep(params, &keep, NULL));
    CHECK(lapd_params_get_keep(params, &keep, &count) == LAPD_OK && count == 2 && keep[1] == -9);
    CHECK(lapd_params_set_keep(context, params, NULL, 0) == LAPD_OK);
    CHECK(lapd_params_get_keep(params, &keep, &count) == LAPD_OK && count == 0);

    int32_t label = 0;
    INVALID(lapd_params_set_merge(context, params, two, 0, 1));
    INVALID(lapd_params_set_merge(context, params, two, SIZE_MAX, 1));
    CHECK(lapd_params_set_merge(context, params, two, 2, 1) == LAPD_OK);
    CHECK(lapd_params_set_merge(context, params, two, 1, INT32_MIN) == LAPD_OK);
    CHECK(lapd_params_get_merge(params, 7, &label) == LAPD_OK && label == INT32_MIN);
    CHECK(lapd_params_get_merge(params, -9, &label) == LAPD_OK && label == 1);
    CHECK(lapd_params_clear_merge(context, params) == LAPD_OK);
    CHECK(lapd_params_get_merge(params, 7, &label) == LAPD_OK && label == 7);
    CHECK(lapd_params_get_background_label(params, &label) == LAPD_OK && label == 0);
    CHECK(lapd_params_set_background_label(context, params, 5) == LAPD_OK);
    CHECK(lapd_params_get_background_label(params, &label) == LAPD_OK && label == 5);
    lapd_mesh *none = NULL;
    CHECK(lapd_mesh_image(context, image, params, &none) == LAPD_ERROR_INVALID_ARGUMENT &&
          none == NULL);
    CHECK(lapd_params_set_background_label(context, params, 0) == LAPD_OK);
}

static void meshing(void) {
    lapd_mesh *out = mesh;
    INVALID(lapd_mesh_image(NULL, image, params, &out));
    INVALID(lapd_mesh_image(context, NULL, params, &out));
    INVALID(lapd_mesh_image(context, image, NULL, &out));
    INVALID(lapd_mesh_image(context, image, params, NULL));
    CHECK(lapd_params_set_max_vertices(context, params, 12) == LAPD_OK);
    CHECK(lapd_mesh_image(context, image, params, &out) == LAPD_ERROR_LIMIT_REACHED);
    CHECK(lapd_params_set_max_vertices(context, params, 0) == LAPD_OK);

    uint8_t *nothing = ball_voxels(4, 0);
    lapd_image *empty = unit_image(context, nothing, 4);
    CHECK(lapd_mesh_image(context, empty, params, &out) == LAPD_ERROR_EMPTY_IMAGE);
    lapd_image_free(empty);
    free(nothing);
    CHECK(out == mesh);

    INVALID(lapd_mesh_write(NULL, mesh, "mesh.vtu"));
    INVALID(lapd_mesh_write(context, NULL, "mesh.vtu"));
    INVALID(lapd_mesh_write(context, mesh, NULL));
    INVALID(lapd_mesh_write(context, mesh, "mesh.nonsense"));
    CHECK(said("mesh.nonsense"));
    CHECK(lapd_mesh_write(context, mesh, "no/such/folder/mesh.vtu") == LAPD_ERROR_IO);
    INVALID(lapd_mesh_check_path(NULL, "mesh.vtu"));
    INVALID(lapd_mesh_check_path(context, NULL));
    INVALID(lapd_mesh_check_path(context, "mesh.nonsense"));
    CHECK(said("mesh.nonsense: unknown ending for a mesh, known are .vtu "));
    INVALID(lapd_mesh_check_path(context, ""));
    INVALID(lapd_mesh_check_path(context, "vtu"));
    CHECK(lapd_mesh_check_path(context, "no/such/folder/mesh.VTU") == LAPD_OK);
    CHECK(lapd_mesh_check_path(context, "mesh.tmp.msh22") == LAPD_OK);
    INVALID(lapd_mesh_write_timeline(NULL, mesh, "timeline.json"));
    INVALID(lapd_mesh_write_timeline(context, NULL, "timeline.json"));
    INVALID(lapd_mesh_write_timeline(context, mesh, NULL));
    INVALID(lapd_mesh_write_timeline(context, mesh, "timeline.json"));
    CHECK(said("timeline.json: there is no timeline"));
    INVALID(lapd_mesh_write_report(NULL, mesh, "report.json", NULL));
    INVALID(lapd_mesh_write_report(context, NULL, "report.json", NULL));
    INVALID(lapd_mesh_write_report(context, mesh, NULL, NULL));
    INVALID(lapd_mesh_write_report(context, mesh, "report.json", "[1]"));
    CHECK(said("extra is no JSON object: "));
    INVALID(lapd_mesh_write_report(context, mesh, "report.json", "{\"tets\": 1}"));
    CHECK(said("the member 'tets' beside a report is one of the report's own"));
    INVALID(lapd_mesh_write_report(context, mesh, "report.json", "{\"seconds\": 1}"));
    CHECK(said("must be an object, got 1"));
    CHECK(lapd_mesh_write_report(context, mesh, "no/such/folder/report.json", NULL) ==
          LAPD_ERROR_IO);
    CHECK(lapd_mesh_write_report(context, mesh, "report.json", "{\"mine\": [1]}") == LAPD_OK);
    lapd_mesh_free(NULL);
}

#define CHECK_ARRAY(name, type, width)                                                             \
    do {                                                                                           \
        const type *array = NULL;                                                                  \
        size_t count = SIZE_MAX;                                                                   \
        INVALID(lapd_mesh_get_##name(NULL, &array, &count));                                       \
        INVALID(lapd_mesh_get_##name(mesh, NULL, &count));                                         \
        INVALID(lapd_mesh_get_##name(mesh, &array, NULL));                                         \
        CHECK(array == NULL && count == SIZE_MAX);                                                 \
        CHECK(lapd_mesh_get_##name(mesh, &array, &count) == LAPD_OK);                              \
        size_t values = (width)*count;                                                             \
        type *buffer = calloc(values + 1, sizeof *buffer);                                         \
        INVALID(lapd_mesh_copy_##name(NULL, buffer, values));                                      \
        INVALID(lapd_mesh_copy_##name(mesh, NULL, values));                                        \
        buffer[0] = 123;                                                                           \
        CHECK(lapd_mesh_copy_##name(mesh, buffer, values - 1) == LAPD_ERROR_BUFFER_TOO_SMALL);     \
        CHECK(lapd_mesh_copy_##name(mesh, buffer, 0) == LAPD_ERROR_BUFFER_TOO_SMALL);              \
        CHECK(buffer[0] == 123);                                                                   \
        CHECK(lapd_mesh_copy_##name(mesh, buffer, values) == LAPD_OK);                             \
        CHECK(memcmp(buffer, array, values * sizeof *buffer) == 0);                                \
        CHECK(lapd_mesh_copy_##name(mesh, buffer, values + 1) == LAPD_OK);                         \
        free(buffer);                                                                              \
    } while (0)

/* `first` is the size that the struct had in version 0.1: programs of that version have no more
 * room. */
#define CHECK_STRUCT(name, first)                                                                  \
    do {                                                                                           \
        lapd_##name s[2];                                                                          \
        memset(s, 0x55, sizeof s);                                                                 \
        const lapd_##name untouched = s[1];                                                        \
        s[0].struct_size = sizeof s[0];                                                            \
        INVALID(lapd_mesh_get_##name(NULL, s));                                                    \
        INVALID(lapd_mesh_get_##name(mesh, NULL));                                                 \
        s[0].struct_size = 0;                                                                      \
        INVALID(lapd_mesh_get_##name(mesh, s));                                                    \
        s[0].struct_size = (first)-8;                                                              \
        INVALID(lapd_mesh_get_##name(mesh, s));                                                    \
        s[0].struct_size = (first);                                                                \
        CHECK(lapd_mesh_get_##name(mesh, s) == LAPD_OK);                                           \
        CHECK(s[0].struct_size == (first));                                                        \
        CHECK(memcmp((char *)s + (first), (const char *)&untouched + (first),                      \
                     sizeof s[0] - (first)) == 0);                                                 \
        s[0].struct_size = UINT64_MAX;                                                             \
        INVALID(lapd_mesh_get_##name(mesh, s));                                                    \
        s[0].struct_size = sizeof s[0];                                                            \
        CHECK(lapd_mesh_get_##name(mesh, s) == LAPD_OK);                                           \
        CHECK(s[0].struct_size == sizeof s[0]);                                                    \
        CHECK(memcmp(&s[1], &untouched, sizeof untouched) == 0);                                   \
        s[0].struct_size = sizeof s[0] + 8; /* as a program of a later version would */            \
        CHECK(lapd_mesh_get_##name(mesh, s) == LAPD_OK);                                           \
        CHECK(s[0].struct_size == sizeof s[0] + 8 && s[1].struct_size == 0);                       \
    } while (0)

static void mesh_getters(void) {
    CHECK_ARRAY(points, double, 3);
    CHECK_ARRAY(tets, uint32_t, 4);
    CHECK_ARRAY(labels, int32_t, 1);
    CHECK_ARRAY(neighbors, uint32_t, 4);
    CHECK_ARRAY(facets, uint32_t, 3);
    CHECK_ARRAY(facet_labels, int32_t, 2);
    CHECK_ARRAY(facet_tets, uint32_t, 2);
    CHECK_STRUCT(counts, 56);
    CHECK_STRUCT(timings, 40);
    CHECK_STRUCT(operations, 40);
    CHECK_STRUCT(quality, 184);
    CHECK_STRUCT(certificate, 120);

    size_t rows = 0;
    lapd_label_row row = {.struct_size = sizeof row};
    INVALID(lapd_mesh_get_label_row_count(NULL, &rows));
    INVALID(lapd_mesh_get_label_row_count(mesh, NULL));
    CHECK(lapd_mesh_get_label_row_count(mesh, &rows) == LAPD_OK && rows == 1);
    INVALID(lapd_mesh_get_label_row(NULL, 0, &row));
    INVALID(lapd_mesh_get_label_row(mesh, 0, NULL));
    INVALID(lapd_mesh_get_label_row(mesh, rows, &row));
    CHECK(lapd_mesh_get_label_row(mesh, 0, &row) == LAPD_OK && row.label == 7);
    row.struct_size = 4;
    INVALID(lapd_mesh_get_label_row(mesh, 0, &row));

    size_t components = 0, defects = 1;
    lapd_component_row component = {.struct_size = sizeof component};
    lapd_defect defect = {.struct_size = sizeof defect};
    CHECK(lapd_mesh_get_component_row_count(mesh, &components) == LAPD_OK && components == 1);
    CHECK(lapd_mesh_get_component_row(mesh, 0, &component) == LAPD_OK);
    CHECK(component.label == 7 && component.fate == LAPD_FATE_KEPT &&
          component.components_mesh == 1);
    CHECK(component.euler_image == component.euler_mesh &&
          component.image_voxels >= LAPD_MIN_COMPONENT_VOXELS);
    INVALID(lapd_mesh_get_component_row(mesh, components, &component));
    component.struct_size = 4;
    INVALID(lapd_mesh_get_component_row(mesh, 0, &component));
    CHECK(lapd_mesh_get_defect_count(mesh, &defects) == LAPD_OK && defects == 0);
    INVALID(lapd_mesh_get_defect(mesh, 0, &defect));

    CHECK_STRUCT(improvement, 120);
    CHECK_STRUCT(second_order, 64);
    size_t left_count = 1;
    lapd_improvement improvement = {.struct_size = sizeof improvement};
    lapd_left left = {.struct_size = sizeof left};
    CHECK(lapd_mesh_get_improvement(mesh, &improvement) == LAPD_OK);
    CHECK(improvement.target_dihedral == 15 && improvement.below_before > 0 &&
          improvement.edge_removals > 0);
    INVALID(lapd_mesh_get_left_count(mesh, NULL));
    CHECK(lapd_mesh_get_left_count(mesh, &left_count) == LAPD_OK && left_count == improvement.left);
    INVALID(lapd_mesh_get_left(mesh, left_count, &left));
    INVALID(lapd_mesh_get_left(NULL, 0, &left));

    size_t threads = 0;
    lapd_operations operations = {.struct_size = sizeof operations};
    lapd_thread_report report = {.struct_size = sizeof report};
    CHECK(lapd_mesh_get_operations(mesh, &operations) == LAPD_OK);
    INVALID(lapd_mesh_get_thread_count(NULL, &threads));
    INVALID(lapd_mesh_get_thread_count(mesh, NULL));
    CHECK(lapd_mesh_get_thread_count(mesh, &threads) == LAPD_OK && threads == 1);
    INVALID(lapd_mesh_get_thread_report(NULL, 0, &report));
    INVALID(lapd_mesh_get_thread_report(mesh, 0, NULL));
    INVALID(lapd_mesh_get_thread_report(mesh, threads, &report));
    INVALID(lapd_mesh_get_thread_report(mesh, LAPD_ALL_THREADS - 1, &report));
    CHECK(report.insertions == 0);
    for (int all = 0; all < 2; all++) {
        CHECK(lapd_mesh_get_thread_report(mesh, all ? LAPD_ALL_THREADS : 0, &report) == LAPD_OK);
        CHECK(report.insertions == operations.insertions && report.removals == operations.removals);
        CHECK(report.tets_created == operations.tets_created && report.insertions > 0);
        CHECK(report.rollbacks == 0 && report.stale == 0 && report.rollback_seconds == 0);
    }
    report.struct_size = 143;
    INVALID(lapd_mesh_get_thread_report(mesh, 0, &report));
}

/* What was not measured says so, and is never 0. */
static void levels(void) {
    lapd_certificate certificate = {.struct_size = sizeof certificate};
    lapd_quality quality = {.struct_size = sizeof quality};
    lapd_label_row row = {.struct_size = sizeof row};
    lapd_component_row component = {.struct_size = sizeof component};
    lapd_defect defect = {.struct_size = sizeof defect};
    size_t count = 77;
    lapd_params *fresh = params_with_delta(context, 1);
    /* Sound is the default. */
    for (int32_t level = LAPD_CERTIFICATE_SOUND; level <= LAPD_CERTIFICATE_FULL; level++) {
        lapd_mesh *measured = mesh;
        if (level > LAPD_CERTIFICATE_SOUND) {
            CHECK(lapd_params_set_certificate(context, fresh, level) == LAPD_OK);
            CHECK(lapd_mesh_image(context, image, fresh, &measured) == LAPD_OK);
        }
        const int full = level == LAPD_CERTIFICATE_FULL;
        CHECK(lapd_mesh_get_certificate(measured, &certificate) == LAPD_OK);
        CHECK(certificate.level == level);
        CHECK(isnan(certificate.mesh_to_image_mean) != full);
        CHECK(isnan(certificate.surface_to_mesh_max) != full);
        CHECK(lapd_mesh_get_label_row(measured, 0, &row) == LAPD_OK);
        CHECK(isnan(row.image_to_mesh_mean) != full && isnan(row.mesh_to_surface_max) != full);
        CHECK(lapd_mesh_get_component_row(measured, 0, &component) == LAPD_OK);
        CHECK(isnan(component.mesh_to_image_max) != full);
        if (measured != mesh) {
            lapd_mesh_free(measured);
        }
    }
    lapd_mesh *plain = NULL;
    CHECK(lapd_params_set_certificate(context, fresh, LAPD_CERTIFICATE_NONE) == LAPD_OK);
    CHECK(lapd_mesh_image(context, image, fresh, &plain) == LAPD_OK);
    CHECK(lapd_mesh_get_certificate(plain, &certificate) == LAPD_ERROR_NOT_MEASURED);
    CHECK(lapd_mesh_get_quality(plain, &quality) == LAPD_ERROR_NOT_MEASURED);
    CHECK(lapd_mesh_get_label_row_count(plain, &count) == LAPD_ERROR_NOT_MEASURED);
    CHECK(lapd_mesh_get_label_row(plain, 0, &row) == LAPD_ERROR_NOT_MEASURED);
    CHECK(lapd_mesh_get_component_row_count(plain, &count) == LAPD_ERROR_NOT_MEASURED);
    CHECK(lapd_mesh_get_component_row(plain, 0, &component) == LAPD_ERROR_NOT_MEASURED);
    CHECK(lapd_mesh_get_defect_count(plain, &count) == LAPD_ERROR_NOT_MEASURED);
    CHECK(lapd_mesh_get_defect(plain, 0, &defect) == LAPD_ERROR_NOT_MEASURED);
    CHECK(count == 77);
    lapd_counts counts = {.struct_size = sizeof counts}, expected = {.struct_size = sizeof counts};
    CHECK(lapd_mesh_get_counts(plain, &counts) == LAPD_OK);
    CHECK(lapd_mesh_get_counts(mesh, &expected) == LAPD_OK);
    CHECK(memcmp(&counts, &expected, sizeof counts) == 0);
    lapd_mesh_free(plain);
    lapd_params_free(fresh);
}

int main(void) {
    uint8_t *voxels = ball_voxels(10, 3.5);
    CHECK(lapd_context_create(&context) == LAPD_OK);
    image = unit_image(context, voxels, 10);
    params = params_with_delta(context, 1);
    CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
    free(voxels);

    statuses();
    contexts();
    image_creation();
    image_getters();
    double_parameters();
    choice_parameters();
    order();
    other_parameters();
    meshing();
    mesh_getters();
    levels();

    lapd_mesh_free(mesh);
    lapd_params_free(params);
    lapd_image_free(image);
    lapd_context_free(context);
    return RESULT;
}
