/* Two meshers at once in one process share image and parameters and give the bytes of a lone one; no thread is left
 * behind. */
#define _GNU_SOURCE

#include <dirent.h>
#include <pthread.h>
#include <sched.h>
#include <stdlib.h>
#include <time.h>

#include "check.h"
#include "phantom.h"

static lapd_image *image;
static lapd_params *params;

static void *mesh_alone(void *out) {
    lapd_context *context = NULL;
    CHECK(lapd_context_create(&context) == LAPD_OK);
    CHECK(lapd_mesh_image(context, image, params, out) == LAPD_OK);
    lapd_context_free(context);
    return NULL;
}

static int thread_count(void) {
    DIR *folder = opendir("/proc/self/task");
    int count = 0;
    if (folder != NULL) {
        for (struct dirent *entry = readdir(folder); entry != NULL; entry = readdir(folder)) {
            count += entry->d_name[0] != '.';
        }
        closedir(folder);
    }
    return count;
}

/* The system may list a joined thread for a moment. */
static bool is_only_thread(void) {
    const struct timespec pause = {0, 1000000};
    for (int i = 0; i < 1000 && thread_count() != 1; i++) {
        nanosleep(&pause, NULL);
    }
    return thread_count() == 1;
}

int main(void) {
    lapd_context *context = NULL;
    CHECK(lapd_context_create(&context) == LAPD_OK);
    uint8_t *voxels = ball_voxels(32, 13);
    image = unit_image(context, voxels, 32);
    params = params_with_delta(context, 1);

    cpu_set_t before, after;
    CHECK(sched_getaffinity(0, sizeof before, &before) == 0);
    lapd_mesh *lone = NULL, *pair[2] = {NULL, NULL};
    mesh_alone(&lone);
    CHECK(is_only_thread());
    CHECK(lapd_mesh_write(context, lone, "threads.vtu") == LAPD_OK);
    CHECK(is_only_thread());
    CHECK(sched_getaffinity(0, sizeof after, &after) == 0 && CPU_EQUAL(&before, &after));

    pthread_t threads[2];
    for (int i = 0; i < 2; i++) {
        CHECK(pthread_create(&threads[i], NULL, mesh_alone, &pair[i]) == 0);
    }
    for (int i = 0; i < 2; i++) {
        CHECK(pthread_join(threads[i], NULL) == 0);
        CHECK(pair[i] != NULL && same_mesh(pair[i], lone));
        lapd_mesh_free(pair[i]);
    }

    lapd_mesh_free(lone);
    lapd_params_free(params);
    lapd_image_free(image);
    lapd_context_free(context);
    free(voxels);
    return RESULT;
}
