/*
 * Limits of vertices, time and memory: each has its own status, or where asked gives a valid
 * partial mesh. Memory that the system refuses is an error too, not the end of the process.
 */
#define _POSIX_C_SOURCE 200809L

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"
#include "phantom.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#else
#define SANITIZED 0
#endif

static lapd_context *context;
static lapd_image *image;
static lapd_params *params;

static void values(void) {
    lapd_params *params = params_with_delta(context, 1);
    double seconds = -1;
    uint64_t bytes = 1;
    int32_t partial = -1;
    CHECK(lapd_params_get_time_limit(params, &seconds) == LAPD_OK && seconds == 0);
    CHECK(lapd_params_get_max_memory(params, &bytes) == LAPD_OK && bytes == 0);
    CHECK(lapd_params_get_partial(params, &partial) == LAPD_OK && partial == 0);
    CHECK(lapd_params_set_time_limit(context, params, 1.5) == LAPD_OK);
    CHECK(lapd_params_set_max_memory(context, params, UINT64_MAX) == LAPD_OK);
    CHECK(lapd_params_set_partial(context, params, 1) == LAPD_OK);
    CHECK(lapd_params_set_time_limit(context, params, -1) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_params_set_time_limit(context, params, (double)NAN) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_params_set_time_limit(context, params, (double)INFINITY) ==
          LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_params_set_partial(context, params, 2) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_params_get_time_limit(params, &seconds) == LAPD_OK && seconds == 1.5);
    CHECK(lapd_params_get_max_memory(params, &bytes) == LAPD_OK && bytes == UINT64_MAX);
    CHECK(lapd_params_get_partial(params, &partial) == LAPD_OK && partial == 1);
    CHECK(lapd_params_set_time_limit(context, NULL, 1) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_params_set_max_memory(NULL, params, 1) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_params_get_partial(NULL, &partial) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_params_get_max_memory(params, NULL) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(lapd_mesh_get_limit_reached(NULL, &partial) == LAPD_ERROR_INVALID_ARGUMENT);
    /* A limit so large that the clock cannot hold it is none. */
    CHECK(lapd_params_set_time_limit(context, params, 1e300) == LAPD_OK);
    CHECK(strcmp(lapd_status_name(12), "LAPD_ERROR_TIME_LIMIT") == 0);
    CHECK(strcmp(lapd_status_name(13), "LAPD_ERROR_MEMORY_LIMIT") == 0);
    lapd_params_free(params);
}

static void set_limits(size_t vertices, double seconds, uint64_t bytes, int32_t partial) {
    CHECK(lapd_params_set_max_vertices(context, params, vertices) == LAPD_OK);
    CHECK(lapd_params_set_time_limit(context, params, seconds) == LAPD_OK);
    CHECK(lapd_params_set_max_memory(context, params, bytes) == LAPD_OK);
    CHECK(lapd_params_set_partial(context, params, partial) == LAPD_OK);
}

static void set_delta(double delta) {
    CHECK(lapd_params_set_delta(context, params, delta) == LAPD_OK);
    CHECK(lapd_params_set_size(context, params, 2 * delta) == LAPD_OK);
}

/* The run gives no mesh, and this status. */
static void expect_error(lapd_status wanted, const char *word) {
    lapd_mesh *const untouched = (lapd_mesh *)&context;
    lapd_mesh *mesh = untouched;
    const lapd_status status = lapd_mesh_image(context, image, params, &mesh);
    CHECK(status == wanted);
    CHECK(mesh == untouched);
    CHECK(strstr(lapd_context_last_error(context), word) != NULL);
    CHECK(strchr(lapd_context_last_error(context), '\n') == NULL);
    if (status == LAPD_OK) {
        lapd_mesh_free(mesh);
    }
}

static void on_log(void *user, int32_t level, const char *message) {
    int *partial = user;
    *partial += level == LAPD_LOG_WARNING && strstr(message, "partial") != NULL;
}

/* The run gives a mesh, which is whole (LAPD_OK) or was ended by this limit. Returns its vertices.
 */
static uint64_t expect_mesh(lapd_status limit, bool background) {
    lapd_mesh *mesh = NULL;
    int32_t reached = -1;
    int warned = 0;
    CHECK(lapd_context_set_log(context, on_log, &warned) == LAPD_OK);
    CHECK(lapd_mesh_image(context, image, params, &mesh) == limit);
    CHECK(lapd_context_set_log(context, NULL, NULL) == LAPD_OK);
    if (mesh == NULL) {
        return 0;
    }
    CHECK(lapd_mesh_get_limit_reached(mesh, &reached) == LAPD_OK);
    CHECK(reached == (int32_t)limit);
    CHECK(lapd_mesh_get_limit_reached(mesh, NULL) == LAPD_ERROR_INVALID_ARGUMENT);
    CHECK(warned == (limit != LAPD_OK));
    check_mesh(mesh, background);
    lapd_certificate c = {.struct_size = sizeof c};
    lapd_counts counts = {.struct_size = sizeof counts};
    CHECK(lapd_mesh_get_certificate(mesh, &c) == LAPD_OK);
    CHECK(lapd_mesh_get_counts(mesh, &counts) == LAPD_OK);
    CHECK(c.non_delaunay_facets == 0 && c.inverted_tets == 0 && c.orphan_vertices == 0 &&
          c.open_edges == 0);
    uint64_t unmet = 0;
    for (int rule = 0; rule < 6; rule++) {
        unmet += c.unmet[rule];
    }
    CHECK((unmet > 0) == (limit != LAPD_OK));
    lapd_mesh_free(mesh);
    return counts.all_vertices;
}

static void vertices(void) {
    set_delta(1);
    set_limits(0, 0, 0, 1);
    const uint64_t all = expect_mesh(LAPD_OK, false);
    set_limits(all / 2, 0, 0, 0);
    expect_error(LAPD_ERROR_LIMIT_REACHED, "vertices");
    for (int part = 2; part <= 32; part *= 2) {
        set_limits((size_t)all / (size_t)part, 0, 0, 1);
        CHECK(expect_mesh(LAPD_ERROR_LIMIT_REACHED, false) <= all / (uint64_t)part + 8);
    }
    CHECK(lapd_params_set_background(context, params, 1) == LAPD_OK);
    expect_mesh(LAPD_ERROR_LIMIT_REACHED, true);
    CHECK(lapd_params_set_background(context, params, 0) == LAPD_OK);
    /* Too few for any tet in the object. */
    set_limits(1, 0, 0, 1);
    expect_error(LAPD_ERROR_LIMIT_REACHED, "vertices");
}

static void seconds(void) {
    /* This would take minutes. The machine may be busy: the best of three counts. */
    set_delta(0.02);
    double best = 1e9;
    for (int try = 0; try < 3 && best > 0.1; try++) {
        set_limits(0, 0.5, 0, 0);
        const double start = now();
        expect_error(LAPD_ERROR_TIME_LIMIT, "0.5 seconds");
        const double late = now() - start - 0.5;
        best = late < best ? late : best;
    }
    printf("ended %.1f ms after the time limit\n", 1e3 * best);
    CHECK(best >= 0 && best < 0.1);
    set_limits(0, 0.5, 0, 1);
    const double start = now();
    expect_mesh(LAPD_ERROR_TIME_LIMIT, false);
    printf("a partial mesh took %.2f s\n", now() - start);
    /* Over before there is a triangulation. */
    set_limits(0, 1e-9, 0, 1);
    expect_error(LAPD_ERROR_TIME_LIMIT, "seconds");
    set_limits(0, 3600, 0, 0);
    set_delta(2);
    expect_mesh(LAPD_OK, false);
}

/* The peak of resident memory in bytes, by which a run in a process of its own makes it grow; 0
 * when unknown. */
static uint64_t growth_of_peak(lapd_status limit) {
    int ends[2];
    uint64_t growth = 0;
    CHECK(pipe(ends) == 0);
    fflush(NULL);
    const pid_t child = fork();
    if (child == 0) {
        struct rusage before, after;
        getrusage(RUSAGE_SELF, &before);
        expect_mesh(limit, false);
        getrusage(RUSAGE_SELF, &after);
        growth = 1024 * (uint64_t)(after.ru_maxrss - before.ru_maxrss);
        const bool told = write(ends[1], &growth, sizeof growth) == (ssize_t)sizeof growth;
        _exit(told && check_failures == 0 ? 0 : 1);
    }
    int state = 0;
    close(ends[1]);
    CHECK(read(ends[0], &growth, sizeof growth) == (ssize_t)sizeof growth);
    close(ends[0]);
    CHECK(waitpid(child, &state, 0) == child && WIFEXITED(state) && WEXITSTATUS(state) == 0);
    return growth;
}

static void memory(void) {
    set_delta(0.1);
    set_limits(0, 0, 64 << 20, 0);
    expect_error(LAPD_ERROR_MEMORY_LIMIT, "67108864");
    for (uint64_t most = 32 << 20; most <= 128 << 20; most *= 2) {
        set_limits(0, 0, most, 1);
        const uint64_t growth = growth_of_peak(LAPD_ERROR_MEMORY_LIMIT);
        printf("limit %llu MiB, peak %llu MiB\n", (unsigned long long)most >> 20,
               (unsigned long long)growth >> 20);
        /* Quite used, and kept but for what does not count. */
        CHECK(SANITIZED || (growth > most / 2 && growth < most + (16 << 20)));
    }
    /* Less than the image's own tables. */
    set_limits(0, 0, 1 << 16, 1);
    expect_error(LAPD_ERROR_MEMORY_LIMIT, "65536");
    set_delta(1);
    set_limits(0, 0, (uint64_t)1 << 40, 0);
    expect_mesh(LAPD_OK, false);
}

/* A cancelled run gives no mesh, partial or not. */
static int32_t cancel(void *user, const lapd_progress *progress) {
    (void)user;
    return progress->phase == LAPD_PHASE_EXTRACT;
}

static void cancelled(void) {
    set_delta(1);
    set_limits(100, 0, 0, 1);
    CHECK(lapd_context_set_progress(context, cancel, NULL) == LAPD_OK);
    expect_error(LAPD_ERROR_CANCELLED, "cancelled");
    CHECK(lapd_context_set_progress(context, NULL, NULL) == LAPD_OK);
}

static uint64_t address_space(void) {
    unsigned long long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    CHECK(file != NULL && fscanf(file, "%llu", &pages) == 1);
    if (file != NULL) {
        fclose(file);
    }
    return pages * (uint64_t)sysconf(_SC_PAGESIZE);
}

/* In a process that may have so many bytes more than now, runs end with a status. */
static lapd_status with_room(uint64_t bytes) {
    fflush(NULL);
    const pid_t child = fork();
    if (child == 0) {
        const rlim_t most = (rlim_t)(address_space() + bytes);
        const struct rlimit limit = {most, most};
        if (setrlimit(RLIMIT_AS, &limit) != 0) {
            _exit(100);
        }
        lapd_mesh *mesh = NULL;
        const lapd_status status = lapd_mesh_image(context, image, params, &mesh);
        if (status != LAPD_OK && mesh != NULL) {
            _exit(101);
        }
        lapd_mesh_free(mesh);
        _exit((int)status);
    }
    int state = 0;
    CHECK(waitpid(child, &state, 0) == child);
    if (!WIFEXITED(state)) {
        printf("signal %d with room for %llu KiB\n", WTERMSIG(state),
               (unsigned long long)bytes >> 10);
    }
    CHECK(WIFEXITED(state));
    return WIFEXITED(state) ? (lapd_status)WEXITSTATUS(state) : LAPD_ERROR_INTERNAL;
}

static void refused_memory(void) {
    if (SANITIZED) {
        printf("SKIPPED: refused memory, the sanitizer needs the address space\n");
        return;
    }
    set_delta(0.5);
    set_limits(0, 0, 0, 0);
    int refused = 0, granted = 0;
    for (uint64_t mib = 1; mib <= 1024; mib += mib < 64 ? 3 : mib / 4) {
        const lapd_status status = with_room(mib << 20);
        CHECK(status == LAPD_OK || status == LAPD_ERROR_OUT_OF_MEMORY);
        refused += status == LAPD_ERROR_OUT_OF_MEMORY;
        granted += status == LAPD_OK;
    }
    /* Others get their part where the largest table would just fit, too. */
    for (uint64_t gib = 64; gib <= 88; gib += 6) {
        CHECK(with_room(gib << 30) == LAPD_OK);
    }
    printf("out of memory %d times, enough %d times\n", refused, granted);
    CHECK(refused > 10 && granted > 0);
}

int main(void) {
    uint8_t *voxels = ball_voxels(48, 21);
    CHECK(lapd_context_create(&context) == LAPD_OK);
    image = unit_image(context, voxels, 48);
    params = params_with_delta(context, 1);
    /* First what wants a heap that holds nothing yet. */
    refused_memory();
    memory();
    values();
    vertices();
    seconds();
    cancelled();
    lapd_params_free(params);
    lapd_image_free(image);
    lapd_context_free(context);
    free(voxels);
    return RESULT;
}
