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
    bool has_level;
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

/* What the table tells of a mesh. */
typedef struct {
    lapd_counts counts;
    lapd_timings timings;
    lapd_quality quality;
    lapd_certificate certificate;
    lapd_improvement improvement;
    lapd_second_order second_order;
    lapd_label_row *rows;
    size_t row_count;
    /* Where the topology is at fault. */
    lapd_defect *defects;
    size_t defect_count;
    /* What all threads did. */
    size_t thread_count;
    lapd_thread_report all_threads;
} summary;

/* Prints one line on stderr. */
void complain(const char *format, ...);

/* Fills `s`. The caller frees rows and defects, whatever this returns. */
lapd_status summarize(const lapd_mesh *mesh, summary *s);

void print_table(const lapd_mesh *mesh, const summary *s, const file_seconds *seconds);

/* Of this process, in bytes; 0 where the system does not tell. */
uint64_t peak_memory(void);
uint64_t resident_memory(void);

/* Writes the JSON report; `memory` is NULL when it was not asked for. The context has the message
 * of a failure. */
lapd_status save_report(lapd_context *context, const lapd_mesh *mesh, const options *o,
                        const file_seconds *seconds, const memory_use *memory);

#endif
