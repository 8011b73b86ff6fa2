/* Progress is monotone and comes on the calling thread; a run is cancelled by its callback, before it starts, and by
 * another thread. */
#define _POSIX_C_SOURCE 200809L

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "check.h"
#include "phantom.h"

static lapd_context *context;
static lapd_image *image;
static lapd_params *params;

typedef struct {
    pthread_t thread;
    double last_fraction;
    int32_t last_phase;
    int calls, cancel_at_call, wrong, logs;
    lapd_status nested;
} record;

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int32_t on_progress(void *user, const lapd_progress *progress) {
    record *r = user;
    r->calls++;
    r->wrong += !pthread_equal(r->thread, pthread_self());
    r->wrong += !(progress->fraction >= r->last_fraction && progress->fraction <= 1);
    r->wrong += progress->phase < r->last_phase;
    r->last_fraction = progress->fraction;
    r->last_phase = progress->phase;
    if (r->calls == 1) {
        /* The context is busy, but its message can be read. */
        lapd_mesh *mesh = NULL;
        r->nested = lapd_mesh_image(context, image, params, &mesh);
        r->wrong += mesh != NULL || strlen(lapd_context_last_error(context)) == 0;
    }
    return r->calls == r->cancel_at_call;
}

static void on_log(void *user, int32_t level, const char *message) {
    record *r = user;
    r->logs++;
    r->wrong += !pthread_equal(r->thread, pthread_self());
    r->wrong += level < LAPD_LOG_WARNING || level > LAPD_LOG_INFO || strlen(message) == 0;
}

static lapd_status run(void) {
    lapd_mesh *const untouched = (lapd_mesh *)&context;
    lapd_mesh *mesh = untouched;
    lapd_status status = lapd_mesh_image(context, image, params, &mesh);
    if (status == LAPD_OK) {
        lapd_mesh_free(mesh);
    } else {
        CHECK(mesh == untouched);
    }
    return status;
}

static void whole_run(void) {
    record r = {.thread = pthread_self()};
    CHECK(lapd_context_set_progress(context, on_progress, &r) == LAPD_OK);
    CHECK(lapd_context_set_log(context, on_log, &r) == LAPD_OK);
    CHECK(run() == LAPD_OK);
    CHECK(r.calls > 1 && r.logs > 0 && r.wrong == 0);
    CHECK(r.nested == LAPD_ERROR_BUSY);
    CHECK(lapd_context_set_log(context, NULL, NULL) == LAPD_OK);
}

static void from_callback(void) {
    for (int call = 1; call < 4; call++) {
        record r = {.thread = pthread_self(), .cancel_at_call = call};
        CHECK(lapd_context_set_progress(context, on_progress, &r) == LAPD_OK);
        CHECK(run() == LAPD_ERROR_CANCELLED);
        CHECK(strcmp(lapd_context_last_error(context), "cancelled") == 0);
        CHECK(r.calls == call && r.wrong == 0);
    }
}

static void before_the_run(void) {
    CHECK(lapd_context_set_progress(context, NULL, NULL) == LAPD_OK);
    CHECK(lapd_context_cancel(context) == LAPD_OK);
    CHECK(run() == LAPD_ERROR_CANCELLED);
    CHECK(run() == LAPD_ERROR_CANCELLED);
    CHECK(lapd_context_reset_cancel(context) == LAPD_OK);
    CHECK(run() == LAPD_OK);
}

static atomic_bool started;
static double cancelled_at;

static int32_t on_start(void *user, const lapd_progress *progress) {
    (void)user;
    (void)progress;
    atomic_store(&started, true);
    return 0;
}

static void *cancel_soon(void *unused) {
    (void)unused;
    while (!atomic_load(&started)) {
        sched_yield();
    }
    cancelled_at = now();
    CHECK(lapd_context_cancel(context) == LAPD_OK);
    return NULL;
}

static void from_another_thread(void) {
    /* The best of a few tries: the machine may be busy with other things. */
    double best = 1e9;
    CHECK(lapd_context_set_progress(context, on_start, NULL) == LAPD_OK);
    for (int i = 0; i < 5; i++) {
        pthread_t thread;
        atomic_store(&started, false);
        CHECK(pthread_create(&thread, NULL, cancel_soon, NULL) == 0);
        CHECK(run() == LAPD_ERROR_CANCELLED);
        double end = now();
        CHECK(pthread_join(thread, NULL) == 0);
        best = end - cancelled_at < best ? end - cancelled_at : best;
        CHECK(lapd_context_reset_cancel(context) == LAPD_OK);
    }
    printf("cancelled after %.1f ms\n", 1e3 * best);
    CHECK(best < 0.1);
}

int main(void) {
    uint8_t *voxels = ball_voxels(48, 21);
    CHECK(lapd_context_create(&context) == LAPD_OK);
    image = unit_image(context, voxels, 48);
    params = params_with_delta(context, 1);
    whole_run();
    from_callback();
    before_the_run();
    from_another_thread();
    lapd_params_free(params);
    lapd_image_free(image);
    lapd_context_free(context);
    free(voxels);
    return RESULT;
}
