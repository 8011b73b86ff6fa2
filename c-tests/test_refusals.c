/*
 * Memory that the system refuses: allocations of 256 bytes or more, in reading, meshing and
 * writing, one in each call. The call ends with LAPD_OK or LAPD_ERROR_OUT_OF_MEMORY, gives
 * nothing in the latter case, and leaves no file behind; the process goes on.
 *
 * The allocator's functions of this program come before those of the C library, for lapd, too.
 */
#define _GNU_SOURCE

#include <dirent.h>
#include <errno.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "check.h"
#include "phantom.h"

/* What is refused has so many bytes at least. Where less is refused, glibc itself ends the process:
 * it registers destructors of threads. */
static size_t least = 256;

/* Allocations so far, and which one is to be refused, from 1 on; 0: none. */
static atomic_long count, refused;

/* What glibc calls its own. */
void *__libc_malloc(size_t size);
void *__libc_calloc(size_t number, size_t size);
void *__libc_realloc(void *old, size_t size);
void *__libc_memalign(size_t alignment, size_t size);

static bool refuses(size_t size) {
    if (size < least) {
        return false;
    }
    const long which = atomic_fetch_add(&count, 1) + 1;
    return which == atomic_load(&refused);
}

void *malloc(size_t size) {
    return refuses(size) ? NULL : __libc_malloc(size);
}

void *calloc(size_t number, size_t size) {
    return refuses(number * size) ? NULL : __libc_calloc(number, size);
}

void *realloc(void *old, size_t size) {
    return refuses(size) ? NULL : __libc_realloc(old, size);
}

void *aligned_alloc(size_t alignment, size_t size) {
    return refuses(size) ? NULL : __libc_memalign(alignment, size);
}

int posix_memalign(void **block, size_t alignment, size_t size) {
    void *got = refuses(size) ? NULL : __libc_memalign(alignment, size);
    if (got == NULL) {
        return ENOMEM;
    }
    *block = got;
    return 0;
}

enum { N = 24 };

static lapd_context *context;
static lapd_image *ball, *thirds;
static lapd_params *params;
static lapd_mesh *made;
static bool is_second_order;
static const char *path;
static char folder[] = "/tmp/lapd_refusals_XXXXXX";

/* Each returns the status, and frees what it got. */
typedef lapd_status (*call)(void);

static lapd_status with_image(lapd_status status, lapd_image *image) {
    CHECK((image != NULL) == (status == LAPD_OK));
    lapd_image_free(image);
    return status;
}

static lapd_status read_labels(void) {
    lapd_image *image = NULL;
    const lapd_status status = lapd_image_read(context, path, LAPD_WORLD_AS_STORED, &image);
    return with_image(status, image);
}

static lapd_status read_distinct(void) {
    lapd_image *image = NULL;
    const lapd_status status = lapd_image_read_labels(context, path, LAPD_WORLD_AS_STORED,
                                                      LAPD_LABELS_DISTINCT, NULL, 0, &image);
    return with_image(status, image);
}

static lapd_status read_gray(void) {
    const double isovalue = 0.5;
    lapd_image *image = NULL;
    const lapd_status status =
        lapd_image_read_gray(context, path, LAPD_WORLD_AS_STORED, &isovalue, 1, NULL, &image);
    return with_image(status, image);
}

static lapd_status read_level_sets(void) {
    lapd_image *image = NULL;
    const lapd_status status =
        lapd_image_read_level_sets(context, &path, 1, LAPD_WORLD_AS_STORED, NULL, 0, &image);
    return with_image(status, image);
}

static lapd_status mesh_of(const lapd_image *image) {
    lapd_mesh *mesh = NULL;
    const lapd_status status = lapd_mesh_image(context, image, params, &mesh);
    CHECK((mesh != NULL) == (status == LAPD_OK));
    if (mesh != NULL && !is_second_order) {
        /* What this allocates does not count. */
        const long before = atomic_load(&count);
        atomic_store(&refused, 0);
        check_mesh(mesh, false);
        atomic_store(&count, before);
    }
    lapd_mesh_free(mesh);
    return status;
}

static lapd_status mesh_ball(void) {
    return mesh_of(ball);
}

static lapd_status mesh_thirds(void) {
    return mesh_of(thirds);
}

static lapd_status write_mesh(void) {
    return lapd_mesh_write(context, made, path);
}

static lapd_status write_report(void) {
    return lapd_mesh_write_report(context, made, path, NULL);
}

static lapd_status write_timeline(void) {
    return lapd_mesh_write_timeline(context, made, path);
}

/* Files in the folder, those that a call left half done included. */
static int files(void) {
    int number = 0;
    DIR *entries = opendir(folder);
    while (entries != NULL && readdir(entries) != NULL) {
        number++;
    }
    if (entries != NULL) {
        closedir(entries);
    }
    return number;
}

static long refusals, ended;

/* Refuses each allocation of a call once. Of many, every few. */
static void refuse_each(const char *name, call f) {
    atomic_store(&count, 0);
    const lapd_status usual = f();
    if (usual != LAPD_OK) {
        fprintf(stderr, "%s: %s\n", name, lapd_context_last_error(context));
    }
    CHECK(usual == LAPD_OK);
    const long all = atomic_load(&count), step = 1 + all / 150;
    const int before = files();
    for (long which = 1; which <= all; which += step) {
        atomic_store(&count, 0);
        atomic_store(&refused, which);
        const lapd_status status = f();
        atomic_store(&refused, 0);
        if (status != LAPD_OK && status != LAPD_ERROR_OUT_OF_MEMORY) {
            fprintf(stderr, "%s, allocation %ld of %ld: %s: %s\n", name, which, all,
                    lapd_status_name(status), lapd_context_last_error(context));
            check_failures++;
        }
        ended += status == LAPD_ERROR_OUT_OF_MEMORY;
        refusals++;
        CHECK(files() == before);
    }
    printf("%s: %ld allocations\n", name, all);
}

/* A path in the folder. */
static const char *in_folder(const char *name) {
    static char buffer[128];
    snprintf(buffer, sizeof buffer, "%s/%s", folder, name);
    return buffer;
}

/* A file of some lines, then `text` many times, then an end and voxels. */
static void write_image(const char *name, const char *begin, const char *text, int times,
                        const char *end, const uint8_t *voxels) {
    FILE *file = fopen(in_folder(name), "wb");
    CHECK(file != NULL);
    if (file == NULL) {
        exit(1);
    }
    fputs(begin, file);
    for (int i = 0; i < times; i++) {
        fprintf(file, text, i, i % 5, i);
    }
    fputs(end, file);
    fwrite(voxels, 1, N * N * N, file);
    fclose(file);
}

static void reading(const uint8_t *voxels) {
    static const char nrrd[] = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 24 24 24\n";
    static const char mha[] = "ObjectType = Image\nNDims = 3\nDimSize = 24 24 24\n"
                              "ElementType = MET_UCHAR\nElementSpacing = 1 1 1\n";
    write_image("a.nrrd", nrrd, "", 0, "encoding: raw\n\n", voxels);
    write_image("many.nrrd", nrrd, "Segment%d_LabelValue:=%d\nSegment%d_Layer:=0\n", 3000,
                "encoding: raw\n\n", voxels);
    write_image("many.mha", mha, "field%d_%d_%d = a value\n", 30000, "ElementDataFile = LOCAL\n",
                voxels);
    write_image("zipped.raw", "", "", 0, "", voxels);
    write_image("zipped.nhdr", nrrd, "", 0, "encoding: gzip\ndata file: zipped.raw.gz\n\n", voxels);
    char zip[160];
    snprintf(zip, sizeof zip, "gzip %s", in_folder("zipped.raw"));
    CHECK(system(zip) == 0);

    static const char *const names[] = {"a.nrrd", "many.nrrd", "many.mha", "zipped.nhdr"};
    for (int i = 0; i < 4; i++) {
        path = in_folder(names[i]);
        refuse_each(names[i], read_labels);
    }
    path = in_folder("a.nrrd");
    refuse_each("distinct values", read_distinct);
    refuse_each("a scan", read_gray);
    refuse_each("level sets", read_level_sets);
}

static void meshing(void) {
    params = params_with_delta(context, 2);
    refuse_each("a mesh of one thread", mesh_ball);
    CHECK(lapd_params_set_certificate(context, params, LAPD_CERTIFICATE_FULL) == LAPD_OK);
    CHECK(lapd_params_set_order(context, params, 2) == LAPD_OK);
    is_second_order = true;
    CHECK(lapd_params_set_curved(context, params, 1) == LAPD_OK);
    CHECK(lapd_params_set_timeline(context, params, 1) == LAPD_OK);
    refuse_each("second order", mesh_thirds);
    CHECK(lapd_mesh_image(context, thirds, params, &made) == LAPD_OK);
    CHECK(lapd_params_set_order(context, params, 1) == LAPD_OK);
    is_second_order = false;
    CHECK(lapd_params_set_curved(context, params, 0) == LAPD_OK);
    CHECK(lapd_params_set_sigma(context, params, 1) == LAPD_OK);
    CHECK(lapd_params_set_min_voxels(context, params, 2) == LAPD_OK);
    refuse_each("smoothed", mesh_thirds);
    CHECK(lapd_params_set_sigma(context, params, 0) == LAPD_OK);
    CHECK(lapd_params_set_threads(context, params, 2) == LAPD_OK);
    CHECK(lapd_params_set_algorithm(context, params, LAPD_ALGORITHM_LAPD) == LAPD_OK);
    /* hwloc, which tells the machine's nodes, does not look at what it gets. */
    least = 4096;
    refuse_each("two threads", mesh_thirds);
    least = 256;
    lapd_params_free(params);
}

static void writing(void) {
    static const char *const second_order[] = {"m.vtu", "m.mesh", "m.msh", "m.inp"};
    static const char *const surfaces[] = {"m.vtk", "m.node", "m.ele", "m.msh2",
                                           "m.stl", "m.ply",  "m.off"};
    for (int i = 0; i < 4; i++) {
        path = in_folder(second_order[i]);
        refuse_each(second_order[i], write_mesh);
    }
    path = in_folder("m.json");
    refuse_each("report", write_report);
    refuse_each("timeline", write_timeline);
    lapd_mesh_free(made);
    params = params_with_delta(context, 2);
    CHECK(lapd_mesh_image(context, thirds, params, &made) == LAPD_OK);
    for (int i = 0; i < 7; i++) {
        path = in_folder(surfaces[i]);
        refuse_each(surfaces[i], write_mesh);
    }
    lapd_mesh_free(made);
    lapd_params_free(params);
}

int main(void) {
    CHECK(mkdtemp(folder) != NULL);
    CHECK(lapd_context_create(&context) == LAPD_OK);
    uint8_t *voxels = ball_voxels(N, 10);
    int16_t *labels = three_label_voxels(N, 10);
    const size_t dims[] = {N, N, N};
    const double origin[] = {0, 0, 0}, spacing[] = {1, 1, 1};
    ball = unit_image(context, voxels, N);
    CHECK(lapd_image_create(context, labels, LAPD_VOXEL_I16, dims, NULL, origin, spacing, NULL,
                            &thirds) == LAPD_OK);
    reading(voxels);
    meshing();
    writing();
    printf("%ld refusals, of which %ld ended a call\n", refusals, ended);
    CHECK(refusals > 1000 && ended > refusals / 2);
    lapd_image_free(ball);
    lapd_image_free(thirds);
    lapd_context_free(context);
    free(voxels);
    free(labels);
    char remove[64];
    snprintf(remove, sizeof remove, "rm -r %s", folder);
    CHECK(system(remove) == 0);
    return RESULT;
}
