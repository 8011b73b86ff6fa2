/* The report of mesh_image: what its table and its JSON file say about a mesh. */
#ifndef MESH_IMAGE_REPORT_H
#define MESH_IMAGE_REPORT_H

#include <lapd.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* What the command line asks for. Parameters go straight to the library's handle, which checks
 * them. */
typedef struct {
    /* All but one only for probability maps. */
    const char **inputs;
    size_t input_count;
    /* Of a scan, and the labels of these or of probability maps; NULL when not given. */
    double *isovalues;
    size_t isovalue_count;
    int32_t *labels;
    size_t label_count;
    bool probabilities;
    bool level_sets;
    /* The frame of world coordinates that is asked for, a lapd_world_frame. */
    int32_t world;
    int32_t label_values;
    /* Layers of a segmentation, later over earlier ones; NULL for the order of the file. */
    size_t *layer_order;
    size_t layer_count;
    const char **outputs;
    size_t output_count;
    const char *report;
    const char *timeline;
    bool has_delta;
    bool has_size;
    bool measures;
    bool memory;
    bool quiet;
} options;

/* Seconds that only this program can know. */
typedef struct {
    double read;
    double write;
    double total;
} file_seconds;

/* Bytes of resident memory; 0 where the system does not tell. */
typedef struct {
    /* Once the image has been read. */
    uint64_t read;
    /* The peak until the end of each phase but the last, by lapd_phase. */
    uint64_t peak[LAPD_PHASE_CERTIFY];
} memory_use;

/* A text for each of some labels: all texts one after the other, each with a 0 at its end. */
typedef struct {
    int32_t *labels;
    char *texts;
    size_t count;
} label_texts;

/* All that the library knows about a mesh, the arrays apart. */
typedef struct {
    /* What the world axes of the image, and so of the mesh, mean: a lapd_world_axes. */
    int32_t world_axes;
    /* With --map the values that labels stand for. */
    label_texts values;
    /* The names that the image's file gives to labels. */
    label_texts names;
    lapd_counts counts;
    lapd_timings timings;
    lapd_operations operations;
    lapd_quality quality;
    lapd_certificate certificate;
    lapd_improvement improvement;
    lapd_second_order second_order;
    /* The limit that cut the refinement short, a lapd_status, or LAPD_OK. */
    int32_t limit_reached;
    lapd_label_row *rows;
    size_t row_count;
    /* The larger components of the image, and where the topology is at fault. */
    lapd_component_row *components;
    size_t component_count;
    lapd_defect *defects;
    size_t defect_count;
    /* The tets that are left below the target of improvement. */
    lapd_left *left;
    size_t left_count;
    /* What each thread did, and the sum. */
    lapd_thread_report *threads;
    size_t thread_count;
    lapd_thread_report all_threads;
} summary;

/* Prints one line on stderr. */
void complain(const char *format, ...);

/* Fills `s` but for world_axes. The caller frees rows, components, defects, left and threads,
 * whatever this returns. */
lapd_status summarize(const lapd_mesh *mesh, summary *s);

/* lapd_image_get_value, lapd_image_get_label_name. */
typedef lapd_status text_getter(const lapd_image *image, int32_t label, const char **text);

/* Keeps what `get` tells of each label of an image. The caller frees labels and texts, whatever
 * this returns. */
lapd_status keep_texts(const lapd_image *image, text_getter *get, label_texts *kept);

void print_table(const summary *s, const file_seconds *seconds);

/* Of this process, in bytes; 0 where the system does not tell. */
uint64_t peak_memory(void);
uint64_t resident_memory(void);

/* Writes the JSON report; `memory` is NULL when it was not asked for. Returns false, with a message
 * on stderr, when it cannot be written. */
bool save_report(const options *o, const lapd_params *params, const summary *s,
                 const file_seconds *seconds, const memory_use *memory);

#endif
