/*
 * A request to cancel is answered within 100 ms, whenever it comes: another thread makes it at
 * moments spread over all phases of a run, and the time until lapd_mesh_image returns is taken.
 * Without a request, progress is reported as often.
 *
 * test_latency [IMAGE [DELTA [MOMENTS PER PHASE]]]; by default the AAL atlas of Debian's
 * mricron-data, or a phantom.
 */
#define _POSIX_C_SOURCE 200809L

#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "check.h"
#include "phantom.h"

enum { PHASES = 5, TRIES = 3 };
static const double PROMISE = 0.1;
static const char *const names[PHASES] = {"prepare", "refine", "extract", "improve", "certify"};

static lapd_context *context;
static lapd_image *image;
static lapd_params *params;

/* The phase of the run, -1 before and after it. */
static atomic_int phase;
/* When each phase began, the last report came, and the longest time between two in each phase. */
static double began[PHASES + 1], last_report, silence[PHASES];

static int32_t on_progress(void *user, const lapd_progress *progress) {
    (void)user;
    const double time = now();
    const int32_t p = progress->phase < PHASES ? progress->phase : PHASES - 1;
    if (atomic_load(&phase) != p) {
        began[p] = time;
    }
    if (atomic_load(&phase) >= 0) {
        const int before = atomic_load(&phase);
        silence[before] =
            time - last_report > silence[before] ? time - last_report : silence[before];
    }
    last_report = time;
    atomic_store(&phase, p);
    return 0;
}

typedef struct {
    int32_t phase;
    /* Seconds to wait from the beginning of the phase on. */
    double delay;
    /* When the request was made, and in which phase. */
    double cancelled_at;
    int cancelled_in;
} request;

static void sleep_for(double seconds) {
    struct timespec t = {(time_t)seconds, (long)(1e9 * (seconds - (double)(time_t)seconds))};
    nanosleep(&t, NULL);
}

static void *make_request(void *user) {
    request *r = user;
    while (atomic_load(&phase) < r->phase) {
        sleep_for(1e-4);
    }
    sleep_for(r->delay);
    r->cancelled_in = atomic_load(&phase);
    r->cancelled_at = now();
    CHECK(lapd_context_cancel(context) == LAPD_OK);
    return NULL;
}

/* Seconds from the request to the return; negative if the run was over before. */
static double latency(request *r) {
    pthread_t thread;
    lapd_mesh *mesh = NULL;
    atomic_store(&phase, -1);
    CHECK(pthread_create(&thread, NULL, make_request, r) == 0);
    const lapd_status status = lapd_mesh_image(context, image, params, &mesh);
    const double end = now();
    atomic_store(&phase, PHASES);
    CHECK(pthread_join(thread, NULL) == 0);
    CHECK(status == LAPD_ERROR_CANCELLED || status == LAPD_OK);
    CHECK((mesh != NULL) == (status == LAPD_OK));
    lapd_mesh_free(mesh);
    CHECK(lapd_context_reset_cancel(context) == LAPD_OK);
    return status == LAPD_ERROR_CANCELLED ? end - r->cancelled_at : -1;
}

/* The whole run, for the times of its phases; and how long the callback had to wait. Returns the
 * mesh. */
static lapd_mesh *measure_phases(double seconds[PHASES]) {
    lapd_mesh *mesh = NULL;
    for (int try = 0; try < TRIES; try++) {
        lapd_mesh_free(mesh);
        mesh = NULL;
        double longest = 0;
        memset(silence, 0, sizeof silence);
        atomic_store(&phase, -1);
        CHECK(lapd_mesh_image(context, image, params, &mesh) == LAPD_OK);
        began[PHASES] = now();
        for (int p = 0; p < PHASES; p++) {
            seconds[p] = began[p + 1] - began[p];
            longest = silence[p] > longest ? silence[p] : longest;
        }
        /* Reports are 50 ms apart, and no piece of work takes longer than a request may. */
        if (longest < 0.05 + PROMISE) {
            break;
        }
        CHECK(try + 1 < TRIES);
    }
    for (int p = 0; p < PHASES; p++) {
        printf("%-8s %6.2f s, at most %3.0f ms between reports\n", names[p], seconds[p],
               1e3 * silence[p]);
    }
    return mesh;
}

/* The same while a file is written; the wait for the disk at its end is left out. */
static void writing(const lapd_mesh *mesh, int moments) {
    static const char *const paths[] = {"latency.vtu", "latency.mesh"};
    for (int i = 0; i < 2; i++) {
        double worst = 0;
        int answered = 0;
        const double start = now();
        CHECK(lapd_mesh_write(context, mesh, paths[i]) == LAPD_OK);
        const double whole = now() - start;
        for (int moment = 0; moment < moments; moment++) {
            double best = 1e9;
            for (int try = 0; try < TRIES && best >= PROMISE; try++) {
                request r = {.phase = 0, .delay = 0.5 * whole * moment / moments};
                pthread_t thread;
                atomic_store(&phase, 0);
                CHECK(pthread_create(&thread, NULL, make_request, &r) == 0);
                const lapd_status status = lapd_mesh_write(context, mesh, paths[i]);
                const double end = now();
                CHECK(pthread_join(thread, NULL) == 0);
                CHECK(status == LAPD_ERROR_CANCELLED || status == LAPD_OK);
                CHECK(lapd_context_reset_cancel(context) == LAPD_OK);
                best = status == LAPD_ERROR_CANCELLED && end - r.cancelled_at < best
                           ? end - r.cancelled_at
                           : best;
            }
            if (best < 1e9) {
                worst = best > worst ? best : worst;
                answered++;
            }
        }
        remove(paths[i]);
        printf("cancelled in writing %s (%.2f s) %d times, after %5.1f ms at most\n", paths[i],
               whole, answered, 1e3 * worst);
        CHECK(answered > 0);
        CHECK(worst < PROMISE);
    }
}

int main(int argc, char **argv) {
    const char *path = argc > 1 ? argv[1] : "/usr/share/mricron/templates/aal.nii.gz";
    const int moments = argc > 3 ? atoi(argv[3]) : 10;
    CHECK(lapd_context_create(&context) == LAPD_OK);
    if (access(path, R_OK) == 0) {
        CHECK(lapd_image_read(context, path, LAPD_WORLD_AS_STORED, &image) == LAPD_OK);
    } else {
        printf("SKIPPED: the atlas %s, a phantom takes its place\n", path);
        uint8_t *voxels = ball_voxels(128, 60);
        image = unit_image(context, voxels, 128);
        free(voxels);
    }
    params = params_with_delta(context, argc > 2 ? atof(argv[2]) : 3);
    CHECK(lapd_context_set_progress(context, on_progress, NULL) == LAPD_OK);
    double seconds[PHASES];
    lapd_mesh *mesh = measure_phases(seconds);
    writing(mesh, moments);
    lapd_mesh_free(mesh);
    double worst[PHASES] = {0}, sum[PHASES] = {0};
    int answered[PHASES] = {0};
    for (int p = 0; p < PHASES; p++) {
        for (int moment = 0; moment < moments; moment++) {
            double best = 1e9;
            int cancelled_in = p;
            for (int try = 0; try < TRIES && best >= PROMISE; try++) {
                request r = {.phase = p, .delay = seconds[p] * (moment + 0.5) / moments};
                const double taken = latency(&r);
                if (taken >= 0 && taken < best) {
                    best = taken;
                    cancelled_in = r.cancelled_in;
                }
            }
            /* Nothing to say of a run that was over early each time. */
            if (best < 1e9 && cancelled_in >= 0 && cancelled_in < PHASES) {
                worst[cancelled_in] = best > worst[cancelled_in] ? best : worst[cancelled_in];
                sum[cancelled_in] += best;
                answered[cancelled_in]++;
            }
        }
    }
    for (int p = 0; p < PHASES; p++) {
        printf("cancelled in %-8s %2d times, after %5.1f ms at most, %5.1f ms in the mean\n",
               names[p], answered[p], 1e3 * worst[p],
               answered[p] > 0 ? 1e3 * sum[p] / answered[p] : 0);
        CHECK(answered[p] > moments / 4);
        CHECK(worst[p] < PROMISE);
    }
    lapd_params_free(params);
    lapd_image_free(image);
    lapd_context_free(context);
    return RESULT;
}
