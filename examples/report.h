/* The report of mesh_image: what its table and its JSON file say about a mesh. */
#ifndef MESH_IMAGE_REPORT_H
#define MESH_IMAGE_REPORT_H

#include <lapd.h>
#include <stddef.h>
#include <stdint.h>

#include "options.h"

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
