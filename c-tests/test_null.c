/* Every pointer of every function of the header NULL, one at a time: refused where the header does
 * not allow it, and never a crash. null_arguments.awk writes the calls from the header itself, so
 * none is forgotten. */
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "phantom.h"

static lapd_context *context;
static lapd_image *image;
static lapd_params *params;
static lapd_mesh *mesh;
static lapd_write_options *write_options;

/* Where calls put what they make: nothing, when they refuse. */
static lapd_context *made_context;
static lapd_image *made_image;
static lapd_params *made_params;
static lapd_mesh *made_mesh;
static lapd_write_options *made_write_options;

/* A call that a NULL makes fail. With a context its message names the argument. */
#define REFUSES(name, call)                                                                        \
    do {                                                                                           \
        lapd_status status = (call);                                                               \
        refused(#call, name, status);                                                              \
    } while (0)

/* A call that takes NULL; whatever it comes to, but it comes back. */
#define SURVIVES(call) ((void)(call), survived())

static int refusals, survivals;

static void refused(const char *call, const char *name, lapd_status status) {
    refusals++;
    CHECK(made_context == NULL && made_image == NULL && made_params == NULL && made_mesh == NULL &&
          made_write_options == NULL);
    if (status != LAPD_ERROR_INVALID_ARGUMENT) {
        fprintf(stderr, "%s gave %s\n", call, lapd_status_name(status));
        check_failures++;
    } else if (name != NULL && strstr(lapd_context_last_error(context), name) == NULL) {
        fprintf(stderr, "%s said: %s\n", call, lapd_context_last_error(context));
        check_failures++;
    }
}

static void survived(void) {
    survivals++;
    lapd_mesh_free(made_mesh);
    lapd_write_options_free(made_write_options);
    lapd_params_free(made_params);
    lapd_image_free(made_image);
    lapd_context_free(made_context);
    made_mesh = NULL;
    made_write_options = NULL;
    made_params = NULL;
    made_image = NULL;
    made_context = NULL;
}

int main(void) {
    static const double ones[16] = {1};
    uint8_t *voxels = ball_voxels(8, 3);
    CHECK(lapd_context_create(&context) == LAPD_OK);
    image = unit_image(context, voxels, 8);
    params = params_with_delta(context, 1);
    CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
    CHECK(lapd_write_options_create(&write_options) == LAPD_OK);

#include "null_arguments.inc"

    printf("%d functions: %d NULLs refused, %d allowed\n", FUNCTIONS, refusals, survivals);
    CHECK(FUNCTIONS > 70 && refusals > 100);
    lapd_write_options_free(write_options);
    lapd_mesh_free(mesh);
    lapd_params_free(params);
    lapd_image_free(image);
    lapd_context_free(context);
    free(voxels);
    return RESULT;
}
