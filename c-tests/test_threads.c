/* Two meshers at once in one process share image and parameters and give the bytes of a lone one;
 * runs with several threads have a clean certificate, whatever the contention manager and whom
 * threads beg; no thread is left behind. */
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

/* One run with several threads: its certificate, and that the threads' reports sum up. */
static void mesh_with_threads(lapd_context *context, int32_t contention, int32_t begging) {
    const size_t several = 3;
    CHECK(lapd_params_set_threads(context, params, several) == LAPD_OK);
    CHECK(lapd_params_set_contention(context, params, contention) == LAPD_OK);
    CHECK(lapd_params_set_begging(context, params, begging) == LAPD_OK);
    CHECK(lapd_params_set_timeline(context, params, 1) == LAPD_OK);
    lapd_mesh *mesh = NULL;
    CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
    CHECK(is_only_thread());

    lapd_certificate certificate = {.struct_size = sizeof certificate};
    CHECK(lapd_mesh_get_certificate(mesh, &certificate) == LAPD_OK);
    CHECK(certificate.non_delaunay_facets == 0 && certificate.inverted_tets == 0);
    CHECK(certificate.orphan_vertices == 0 && certificate.open_edges == 0);

    size_t threads = 0;
    lapd_operations operations = {.struct_size = sizeof operations};
    lapd_thread_report all = {.struct_size = sizeof all}, sum = {0};
    CHECK(lapd_mesh_get_operations(mesh, &operations) == LAPD_OK);
    CHECK(lapd_mesh_get_thread_count(mesh, &threads) == LAPD_OK && threads == several);
    CHECK(lapd_mesh_get_thread_report(mesh, LAPD_ALL_THREADS, &all) == LAPD_OK);
    for (size_t i = 0; i < threads; i++) {
        lapd_thread_report one = {.struct_size = sizeof one};
        CHECK(lapd_mesh_get_thread_report(mesh, i, &one) == LAPD_OK);
        uint64_t by_rule = 0;
        for (int rule = 0; rule < 6; rule++) {
            by_rule += one.rollbacks_by_rule[rule];
        }
        CHECK(by_rule == one.rollbacks && one.waits <= one.rollbacks);
        CHECK(one.rollback_seconds >= 0 && one.contention_seconds >= 0 && one.idle_seconds >= 0);
        sum.insertions += one.insertions;
        sum.removals += one.removals;
        sum.tets_created += one.tets_created;
        sum.rollbacks += one.rollbacks;
        sum.stale += one.stale;
        sum.begs += one.begs;
        sum.gifts += one.gifts;
    }
    CHECK(sum.insertions == all.insertions && all.insertions == operations.insertions);
    CHECK(sum.removals == all.removals && all.removals == operations.removals);
    CHECK(sum.tets_created == all.tets_created && all.tets_created == operations.tets_created);
    CHECK(sum.rollbacks == all.rollbacks && all.rollbacks == operations.rollbacks);
    CHECK(sum.stale == all.stale && sum.begs == all.begs && sum.gifts == all.gifts);
    CHECK(lapd_mesh_write_timeline(context, mesh, "threads.json") == LAPD_OK);
    CHECK(is_only_thread());
    lapd_mesh_free(mesh);
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

    for (int32_t contention = LAPD_CONTENTION_LOCAL; contention <= LAPD_CONTENTION_AGGRESSIVE;
         contention++) {
        mesh_with_threads(context, contention, LAPD_BEGGING_BY_LEVEL);
        mesh_with_threads(context, contention, LAPD_BEGGING_FLAT);
    }

    lapd_mesh_free(lone);
    lapd_params_free(params);
    lapd_image_free(image);
    lapd_context_free(context);
    free(voxels);
    return RESULT;
}
