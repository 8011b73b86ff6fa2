/* Names of labels from a table and by hand, through merging, to the mesh and its files; and the
 * walls that facets lie on. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "phantom.h"

enum { N = 12 };

static lapd_context *context;

/* Two bars side by side through the whole image along x; labels 1 and 2. */
static lapd_image *two_bars(void) {
    static uint8_t voxels[N * N * N];
    for (int k = 0; k < N; k++) {
        for (int j = 3; j < N - 3; j++) {
            for (int i = 0; i < N; i++) {
                if (k >= 3 && k < N - 3) {
                    voxels[i + N * (j + N * k)] = j < N / 2 ? 1 : 2;
                }
            }
        }
    }
    return unit_image(context, voxels, N);
}

static const char *image_name(const lapd_image *image, int32_t label) {
    const char *name = NULL;
    CHECK(lapd_image_get_label_name(image, label, &name) == LAPD_OK);
    return name != NULL ? name : "";
}

static const char *mesh_name(const lapd_mesh *mesh, int32_t label) {
    const char *name = NULL;
    CHECK(lapd_mesh_get_label_name(mesh, label, &name) == LAPD_OK);
    return name != NULL ? name : "";
}

static void write_text(const char *path, const char *text) {
    FILE *file = fopen(path, "wb");
    CHECK(file != NULL && fputs(text, file) >= 0 && fclose(file) == 0);
}

static bool file_has(const char *path, const char *text) {
    FILE *file = fopen(path, "rb");
    static char bytes[1 << 22];
    size_t length = file != NULL ? fread(bytes, 1, sizeof bytes - 1, file) : 0;
    bytes[length] = '\0';
    if (file != NULL) {
        fclose(file);
    }
    return strstr(bytes, text) != NULL;
}

static void naming(lapd_image *image) {
    CHECK(strcmp(image_name(image, 1), "") == 0);
    write_text("names.ctbl",
               "# a table\n0 Background 0 0 0 0\n1 Left-lung 10 20 30 255\n2 other\n");
    CHECK(lapd_image_read_label_names(context, image, "names.ctbl") == LAPD_OK);
    CHECK(strcmp(image_name(image, 1), "Left-lung") == 0);
    CHECK(lapd_image_set_label_name(context, image, 2, "right lung") == LAPD_OK);
    CHECK(strcmp(image_name(image, 2), "right lung") == 0);

    static const char *const refused[] = {"", " ", "two\nlines", "\xff"};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        CHECK(lapd_image_set_label_name(context, image, 2, refused[i]) ==
              LAPD_ERROR_INVALID_ARGUMENT);
        CHECK(strstr(lapd_context_last_error(context), "label 2") != NULL);
    }
    write_text("no_names.txt", "1 lung\nnonsense\n");
    CHECK(lapd_image_read_label_names(context, image, "no_names.txt") == LAPD_ERROR_FORMAT);
    CHECK(strstr(lapd_context_last_error(context), "line 2") != NULL);
    CHECK(lapd_image_read_label_names(context, image, "no_such_file.txt") == LAPD_ERROR_IO);
    CHECK(strcmp(image_name(image, 1), "Left-lung") == 0);
}

static void walls(const lapd_mesh *mesh) {
    const uint8_t *wall;
    const uint32_t *facets, *tets;
    const double *points;
    size_t count, n;
    CHECK(lapd_mesh_get_facet_walls(mesh, &wall, &count) == LAPD_OK);
    CHECK(lapd_mesh_get_facets(mesh, &facets, &n) == LAPD_OK && n == count);
    CHECK(lapd_mesh_get_facet_tets(mesh, &tets, &n) == LAPD_OK);
    CHECK(lapd_mesh_get_points(mesh, &points, &n) == LAPD_OK);
    size_t on[2] = {0, 0}, wrong = 0;
    for (size_t f = 0; f < count; f++) {
        /* Voxel centres are at 0 to N - 1. */
        int at[2] = {0, 0};
        for (int i = 0; i < 3; i++) {
            const double x = points[3 * facets[3 * f + i]];
            at[0] += x == -0.5;
            at[1] += x == N - 0.5;
        }
        const int expected = at[0] == 3   ? LAPD_WALL_X_MIN
                             : at[1] == 3 ? LAPD_WALL_X_MAX
                                          : LAPD_WALL_NONE;
        wrong += wall[f] != expected;
        on[0] += wall[f] == LAPD_WALL_X_MIN;
        on[1] += wall[f] == LAPD_WALL_X_MAX;
    }
    CHECK(wrong == 0 && on[0] > 10 && on[1] > 10);
}

int main(void) {
    CHECK(lapd_context_create(&context) == LAPD_OK);
    lapd_image *image = two_bars();
    naming(image);
    lapd_params *params = params_with_delta(context, 1.5);
    lapd_mesh *mesh = NULL;
    CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
    CHECK(strcmp(mesh_name(mesh, 1), "Left-lung") == 0 && strcmp(mesh_name(mesh, 3), "") == 0);
    uint8_t color[3] = {0};
    int32_t known = -1;
    CHECK(lapd_mesh_get_label_color(mesh, 1, color, &known) == LAPD_OK);
    CHECK(known == 1 && color[0] == 10 && color[1] == 20 && color[2] == 30);
    CHECK(lapd_mesh_get_label_color(mesh, 2, color, &known) == LAPD_OK && known == 0);
    CHECK(color[0] == 10);
    walls(mesh);

    CHECK(lapd_mesh_write(context, mesh, "names.inp") == LAPD_OK);
    static const char *const names[] = {"ELSET=Left-lung\n",
                                        "ELSET=right_lung\n",
                                        "NAME=Left-lung__right_lung\n",
                                        "NAME=Left-lung__background\n",
                                        "NAME=Left-lung__wall_x_min\n",
                                        "NAME=right_lung__wall_x_max\n"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        CHECK(file_has("names.inp", names[i]));
    }
    CHECK(!file_has("names.inp", "background_1") && !file_has("names.inp", "wall_y"));

    lapd_write_options *options = NULL;
    CHECK(lapd_write_options_create(&options) == LAPD_OK);
    CHECK(lapd_write_options_set_boundary_parts(context, options, 2) ==
          LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_write_options_set_boundary_parts(context, options, 1) == LAPD_OK);
    CHECK(lapd_mesh_write_with(context, mesh, "names.inp", options) == LAPD_OK);
    CHECK(file_has("names.inp", "NAME=Left-lung__background_1\n"));
    CHECK(!file_has("names.inp", "background_2"));
    CHECK(lapd_write_options_set_measures(context, options, 1) == LAPD_OK);
    CHECK(lapd_mesh_write_with(context, mesh, "names.inp", options) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_mesh_write_with(context, mesh, "names.vtu", options) == LAPD_OK);
    CHECK(file_has("names.vtu", "Name=\"right_lung\"") &&
          file_has("names.vtu", "Name=\"scaled_jacobian\""));
    lapd_write_options_free(options);
    lapd_mesh_free(mesh);

    /* The name of what labels become: their own names, unless it has one. */
    const int32_t both[] = {1, 2};
    CHECK(lapd_params_set_merge(context, params, both, 2, 9) == LAPD_OK);
    CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
    CHECK(strcmp(mesh_name(mesh, 9), "Left-lung+right lung") == 0);
    lapd_mesh_free(mesh);
    CHECK(lapd_image_set_label_name(context, image, 9, "lungs") == LAPD_OK);
    CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
    lapd_image_free(image);
    CHECK(strcmp(mesh_name(mesh, 9), "lungs") == 0);

    lapd_mesh_free(mesh);
    lapd_params_free(params);
    lapd_context_free(context);
    return RESULT;
}
