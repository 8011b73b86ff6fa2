/* Progress is monotone and comes on the calling thread, also when it is slow; log lines tell what
 * each phase did and what is wrong with the mesh; a run is cancelled by its callback, before it
 * starts, and by another thread. Reading has progress, an end by cancelling, and limits. */
#define _POSIX_C_SOURCE 200809L

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "check.h"
#include "phantom.h"

static lapd_context *context;
static lapd_image *image;
static lapd_params *params;

typedef struct {
    pthread_t thread;
    double last_fraction;
    int32_t last_phase;
    int calls, cancel_at_call, wrong, logs, phases;
    lapd_status nested;
} record;

static int32_t on_progress(void *user, const lapd_progress *progress) {
    record *r = user;
    r->calls++;
    r->wrong += !pthread_equal(r->thread, pthread_self());
    r->wrong += !(progress->fraction >= r->last_fraction && progress->fraction <= 1);
    r->wrong += progress->phase < r->last_phase;
    r->wrong += progress->phase > LAPD_PHASE_REFINE && progress->tets == 0;
    r->phases |= 1 << progress->phase;
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

/* Which of these a run logs: bit i for lines[i]; and how many lines of each level. */
typedef struct {
    const char *const *lines;
    int count, seen, levels[2], wrong;
} log_record;

static void on_line(void *user, int32_t level, const char *message) {
    log_record *r = user;
    for (int i = 0; i < r->count; i++) {
        r->seen |= strstr(message, r->lines[i]) != NULL ? 1 << i : 0;
    }
    r->wrong += strchr(message, '\n') != NULL || message[0] == '\0';
    r->levels[level]++;
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
    CHECK(r.phases == 31 && r.last_fraction == 1);
    CHECK(r.nested == LAPD_ERROR_BUSY);
    CHECK(lapd_context_set_log(context, NULL, NULL) == LAPD_OK);
}

static void log_lines(void) {
    static const char *const good[] = {"meshing 1 labels of 48 x 48 x 48 voxels",
                                       "image prepared in ",
                                       "refinement done in ",
                                       "tets per second",
                                       "round 1: what is connected is as in the image",
                                       "vertices collected in ",
                                       "slivers removed in ",
                                       "certificate measured in "};
    log_record r = {.lines = good, .count = 8};
    CHECK(lapd_context_set_progress(context, NULL, NULL) == LAPD_OK);
    CHECK(lapd_context_set_log(context, on_line, &r) == LAPD_OK);
    CHECK(run() == LAPD_OK);
    CHECK(r.seen == 255 && r.wrong == 0);
    CHECK(r.levels[LAPD_LOG_INFO] == 7 && r.levels[LAPD_LOG_WARNING] == 0);

    /* Parts that are too small for delta: a label of one voxel is lost, and eight voxels of
     * another. */
    enum { N = 24 };
    uint8_t *voxels = calloc(N * N * N, 1);
    CHECK(voxels != NULL);
    for (size_t i = 0; i < N * N * N; i++) {
        const size_t x = i % N, y = i / N % N, z = i / (N * N);
        voxels[i] = x > 1 && x < 18 && y > 1 && y < 18 && z > 1 && z < 18;
    }
    voxels[6 + N * (6 + N * 6)] = 2;
    for (size_t i = 0; i < 8; i++) {
        voxels[20 + i % 2 + N * (20 + i / 2 % 2 + N * (20 + i / 4))] = 1;
    }
    lapd_image *const ball = image;
    image = unit_image(context, voxels, N);
    CHECK(lapd_params_set_delta(context, params, 4) == LAPD_OK &&
          lapd_params_set_size(context, params, 8) == LAPD_OK &&
          lapd_params_set_adaptive(context, params, LAPD_ADAPTIVE_OFF) == LAPD_OK);
    static const char *const bad[] = {
        "labels without a tet: 1, of 1 voxels in all; the first is 2",
        "components without a tet: 1; the first, of label 1, at (20.00, 20.00, 20.00)"};
    r = (log_record){.lines = bad, .count = 2};
    CHECK(run() == LAPD_OK);
    CHECK(r.seen == 3 && r.wrong == 0 && r.levels[LAPD_LOG_WARNING] >= 2);
    CHECK(lapd_params_set_delta(context, params, 1) == LAPD_OK &&
          lapd_params_set_size(context, params, 2) == LAPD_OK &&
          lapd_params_set_adaptive(context, params, LAPD_ADAPTIVE_THICKNESS) == LAPD_OK);
    CHECK(lapd_context_set_log(context, NULL, NULL) == LAPD_OK);
    lapd_image_free(image);
    image = ball;
    free(voxels);
}

/* A callback that takes long is called less often: it does not take all the time there is. */
static int32_t on_slow_progress(void *user, const lapd_progress *progress) {
    const struct timespec t = {0, 40 * 1000 * 1000};
    nanosleep(&t, NULL);
    return on_progress(user, progress);
}

static void slow_callback(void) {
    record r = {.thread = pthread_self()};
    CHECK(lapd_context_set_progress(context, on_slow_progress, &r) == LAPD_OK);
    const double start = now();
    CHECK(run() == LAPD_OK);
    const double seconds = now() - start;
    CHECK(r.wrong == 0 && r.phases == 31);
    /* One call for each step, and beside those one in 90 ms at most. */
    CHECK(r.calls <= 12 + (int)(seconds / 0.09));
    r = (record){.thread = pthread_self(), .cancel_at_call = 4};
    CHECK(run() == LAPD_ERROR_CANCELLED);
    CHECK(r.calls == 4 && r.wrong == 0);
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

/* A request ends the writing of a mesh, too; the file that was there stays. */
static void before_writing(void) {
    lapd_mesh *mesh = NULL;
    CHECK(lapd_context_set_progress(context, NULL, NULL) == LAPD_OK);
    CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
    for (int cancelled = 1; cancelled >= 0; cancelled--) {
        static const char *const paths[] = {"cancelled.vtu", "cancelled.mesh", "cancelled.node",
                                            "cancelled.stl"};
        CHECK((cancelled ? lapd_context_cancel(context) : lapd_context_reset_cancel(context)) ==
              LAPD_OK);
        for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
            remove(paths[i]);
            CHECK(lapd_mesh_write(context, mesh, paths[i]) ==
                  (cancelled ? LAPD_ERROR_CANCELLED : LAPD_OK));
            CHECK((access(paths[i], F_OK) != 0) == cancelled);
            remove(paths[i]);
        }
    }
    remove("cancelled.ele");
    remove("cancelled.face");
    lapd_mesh_free(mesh);
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

static int32_t on_reading(void *user, const lapd_progress *progress) {
    record *r = user;
    r->calls++;
    r->wrong += !pthread_equal(r->thread, pthread_self());
    r->wrong += progress->phase != LAPD_PHASE_READ;
    r->wrong += !(progress->fraction >= r->last_fraction && progress->fraction <= 1);
    r->last_fraction = progress->fraction;
    return r->calls == r->cancel_at_call;
}

/* A million voxels in a folder of their own, and a header that names what lies outside of it. */
static void reading(void) {
    char folder[] = "/tmp/lapd_reading_XXXXXX";
    char inside[64], header[64], outside[64];
    CHECK(mkdtemp(folder) != NULL);
    snprintf(outside, sizeof outside, "%s/voxels.nrrd", folder);
    snprintf(inside, sizeof inside, "%s/inside", folder);
    snprintf(header, sizeof header, "%s/inside/a.nhdr", folder);
    static const char fields[] = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 100 100 100\n"
                                 "encoding: raw\n";
    FILE *file = fopen(outside, "wb");
    fprintf(file, "%s\n", fields);
    for (int i = 0; i < 1000000; i++) {
        fputc(1, file);
    }
    fclose(file);
    CHECK(mkdir(inside, 0700) == 0);
    file = fopen(header, "wb");
    fprintf(file, "%sbyte skip: -1\ndata file: ../voxels.nrrd\n", fields);
    fclose(file);

    record r = {.thread = pthread_self()};
    lapd_image *read = NULL;
    lapd_context_set_progress(context, on_reading, &r);
    CHECK(lapd_image_read(context, outside, LAPD_WORLD_AS_STORED, &read) == LAPD_OK);
    CHECK(r.calls > 0 && r.wrong == 0);
    lapd_image_free(read);
    read = NULL;

    r = (record){.thread = pthread_self(), .cancel_at_call = 1};
    CHECK(lapd_image_read(context, outside, LAPD_WORLD_AS_STORED, &read) == LAPD_ERROR_CANCELLED);
    CHECK(lapd_context_cancel(context) == LAPD_OK);
    lapd_context_set_progress(context, NULL, NULL);
    CHECK(lapd_image_read(context, outside, LAPD_WORLD_AS_STORED, &read) == LAPD_ERROR_CANCELLED);
    CHECK(lapd_context_reset_cancel(context) == LAPD_OK);

    CHECK(lapd_context_set_max_read_bytes(context, 1999999) == LAPD_OK);
    CHECK(lapd_image_read(context, outside, LAPD_WORLD_AS_STORED, &read) ==
          LAPD_ERROR_MEMORY_LIMIT);
    CHECK(strstr(lapd_context_last_error(context), "--max-read-bytes") != NULL);
    CHECK(lapd_context_set_max_read_bytes(context, 0) == LAPD_OK);

    CHECK(lapd_image_read(context, header, LAPD_WORLD_AS_STORED, &read) == LAPD_ERROR_FORMAT);
    CHECK(strstr(lapd_context_last_error(context), "lies outside") != NULL);
    CHECK(read == NULL);
    CHECK(lapd_context_set_allow_outside(context, 1) == LAPD_OK);
    CHECK(lapd_image_read(context, header, LAPD_WORLD_AS_STORED, &read) == LAPD_OK);
    lapd_image_free(read);
    CHECK(lapd_context_set_allow_outside(context, 0) == LAPD_OK);
    unlink(header);
    unlink(outside);
    rmdir(inside);
    rmdir(folder);
}

int main(void) {
    uint8_t *voxels = ball_voxels(48, 21);
    CHECK(lapd_context_create(&context) == LAPD_OK);
    image = unit_image(context, voxels, 48);
    params = params_with_delta(context, 1);
    whole_run();
    log_lines();
    slow_callback();
    from_callback();
    before_the_run();
    before_writing();
    from_another_thread();
    reading();
    lapd_params_free(params);
    lapd_image_free(image);
    lapd_context_free(context);
    free(voxels);
    return RESULT;
}
