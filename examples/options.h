/* The command line of mesh_image. */
#ifndef MESH_IMAGE_OPTIONS_H
#define MESH_IMAGE_OPTIONS_H

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
    /* The sides of a voxel that were given; the first is 0 when none were. */
    double spacing[3];
    /* A table of names of labels, or NULL. */
    const char *names;
    /* Pairs of labels whose interfaces are split; none with `split_all`. */
    int32_t *split;
    size_t split_count;
    bool split_all;
    const char **outputs;
    size_t output_count;
    const char *report;
    const char *timeline;
    bool has_delta;
    bool has_size;
    bool has_level;
    bool measures;
    bool boundary_parts;
    /* Nothing is meshed, only told what that would need. */
    bool estimate;
    bool memory;
    bool quiet;
} options;

/* Prints what the options are. */
void print_usage(void);

/* Returns false, with a message on stderr, for bad usage; `o` is all zeros before. The caller frees
 * what it holds by free_options, whatever this returns. */
bool parse_options(int argc, char **argv, lapd_context *context, lapd_params *params, options *o);

void free_options(options *o);

/* Prints one line on stderr. */
void complain(const char *format, ...);

#endif
