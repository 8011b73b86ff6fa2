/*
 * The command line of mesh_image.
 */
#include "options.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* In two parts: compilers need not take longer strings. */
static const char USAGE[] =
    "usage: mesh_image INPUT -o OUT [-o OUT2 ...] [options]\n"
    "\n"
    "Turns a label image, a scan or probability maps into a tetrahedral mesh of all tissues.\n"
    "INPUT: .nrrd .nhdr .nii .nii.gz .mha .mhd .inr .inr.gz .npy .tif .tiff\n"
    "OUT, by its ending: .vtu .vtk .vtm (VTK multi-block) .mesh .node .ele .msh (Gmsh 4.1)\n"
    "    .msh2 (Gmsh 2.2) .inp (Abaqus) .exo (Exodus II) .foam (OpenFOAM) .mfem .feb (FEBio)\n"
    "    .bdf (Nastran) .unv .stl .ply .off; with HDF5 .xdmf .vtkhdf\n"
    "Lengths are in the image's world units (mm).\n"
    "\n"
    "  -o OUT               write the mesh; may be given again, or left out with --report\n"
    "  --delta MM           distance between samples on the interfaces;\n"
    "                       default 1.5 times the geometric mean of the voxel's sides\n"
    "  --size MM            largest circumradius of tets; default 2 times delta\n"
    "  --label-size L=MM    the same for one label (after --merge); may be given again\n"
    "  --tets N             look for the delta and size of a mesh of N tets: both are multiplied "
    "by "
    "one factor\n"
    "  --estimate           tell how many tets, how much memory and time a mesh needs, and make "
    "none\n"
    "  --across N           so many elements or more across each layer of a label, 1 to 100; "
    "default not asked for\n"
    "  --least-size MM      circumradius of tets that no layer goes below; default that of the "
    "spacing floor\n"
    "  --gradation G        how much sizes grow per distance from a layer; default 0.4\n"
    "  --adaptive NAME      off | thickness | topology: sample more densely nothing, what is "
    "thinner than\n"
    "                       4/3 delta, or places where the mesh would tear, merge, or have holes; "
    "default topology\n"
    "  --no-adaptive        the same as --adaptive off\n"
    "  --spacing-floor V    where samples are closer than delta, no closer than this many voxels; "
    "default 0.5,\n"
    "                       but never closer than 0.75 with --adaptive thickness\n"
    "  --min-voxels N       leave out components of fewer voxels; for label images; default 0\n"
    "  --radius-edge R      largest circumradius over shortest edge; at least 2, default 2\n"
    "  --facet-angle DEG    smallest angle of interface facets; at most 30, default 30\n"
    "  --threads N          threads of the run; default 1, which makes the same mesh each time\n"
    "  --algorithm NAME     podm | lapd, with a region for the threads of each memory node; "
    "default podm\n"
    "  --contention NAME    what threads do after conflicts: local | global | random | aggressive; "
    "default local\n"
    "  --begging NAME       whom threads without work ask first: levels | flat; default levels\n"
    "  --topology TEXT      the machine that threads are taken to run on, as a synthetic "
    "description of hwloc's,\n"
    "                       such as 'numa:4 core:4 pu:1'; needs a library with the feature hwloc\n"
    "  --bind               bind each thread to a core\n"
    "  --count-accesses     report how much of the memory that threads visit is that of other "
    "memory nodes\n"
    "  --merge L,L,...=T    give these labels the label T first; may be given again\n"
    "  --background-label L the label (after --merge) that is background; default 0\n"
    "  --keep L,L,...       mesh these labels (after --merge) only\n";

static const char MORE_USAGE[] =
    "  --isovalue V,V,...   INPUT is a scan; its labels, 1, 2, ..., begin at these intensities\n"
    "  --probabilities      INPUT is a stack of probability maps, of labels 1, 2, ...; may be "
    "several files\n"
    "  --level-sets         as --probabilities, of functions above 0 inside of their label; the "
    "largest wins\n"
    "  --labels L,L,...     the labels at these isovalues, or of these maps\n"
    "  --gaussian SIGMA     smooth the labels of a coarse image; in voxels, at most 5; default 0\n"
    "  --round              take voxels that are no whole numbers for the nearest labels; those "
    "within 0.001 of one\n"
    "                       always are\n"
    "  --map                number the distinct values of voxels, of any kind, as labels 1, 2, "
    "...; the report tells\n"
    "                       which is which\n"
    "  --layer-order L,L,.. the layers of a 3D Slicer segmentation, from 0 on, each once: where "
    "segments overlap,\n"
    "                       that of the later layer counts; default 0,1,...\n"
    "  --frame NAME         lps | ras: world axes that grow to the patient's left, posterior, "
    "superior, or right,\n"
    "                       anterior, superior; default as the file has them\n"
    "  --volume N           which volume of a file of several to read as labels or scan, from 0 "
    "on\n"
    "  --spacing X,Y,Z      the sides of a voxel, in place of those that INPUT says, or does not, "
    "as "
    ".npy\n"
    "  --allow-outside      read data files that lie outside of the folder of their header\n"
    "  --max-read-bytes B   the most memory that the image may take, as for --max-memory; default "
    "1000 times the\n"
    "                       file's bytes or 1 GiB, and no more than half of the machine's\n"
    "  --background         keep the whole triangulation, with label 0 outside of the object\n"
    "  --surface NAME       smooth | voxel; default smooth\n"
    "  --border NAME        flat | smooth: how the object is closed where the image cuts it off; "
    "default flat\n"
    "  --improve NAME       none | interior | full: what may be changed to remove slivers: "
    "nothing, the inside of\n"
    "                       labels, or interfaces too; default full\n"
    "  --coarsen DEG        contract edges where that changes nothing in what is connected, as far "
    "as size and\n"
    "                       delta allow and facets keep this angle; at most 30, 15 is a good "
    "choice; default not\n"
    "  --target-dihedral D  smallest dihedral angle of tets, in degrees; the largest is 180 less "
    "this; at most 30,\n"
    "                       default 15\n"
    "  --certificate NAME   none | sound | full: what is measured on the mesh: nothing, all that "
    "is exact, or\n"
    "                       distances to the image, too; default sound, full with --report\n"
    "  --order N            1 | 2: order 2 has a node in the middle of each edge, too; default 1\n"
    "  --curved             with order 2: the nodes on interfaces go where the image has them\n"
    "  --max-vertices N     give up when the mesh needs more\n"
    "  --time-limit S       give up when the refinement has not ended after this many seconds\n"
    "  --max-memory BYTES   give up when the run needs more; K, M, G stand for 2^10, 2^20, 2^30\n"
    "  --partial            when such a limit is reached, write the mesh of what there is\n"
    "  --names FILE         name labels by a table: number, name, perhaps red, green, blue on each "
    "line (those of\n"
    "                       3D Slicer, FreeSurfer, ITK-SNAP, or plain lists)\n"
    "  --boundary-parts     make each connected part of a boundary a boundary of its own\n"
    "  --split-interfaces P all | A,B: regions get nodes of their own at all interfaces, or at "
    "that "
    "of two labels;\n"
    "                       pairs may be given again\n"
    "  --measures           .vtu files get measures of the tets: dihedral angles, scaled Jacobian, "
    "ratios\n"
    "  --report FILE.json   write a report\n"
    "  --memory             with the peak of memory until the end of each phase in it\n"
    "  --timeline FILE.json write what each thread did when, for chrome://tracing or "
    "ui.perfetto.dev\n"
    "  --quiet              no progress, no table\n"
    "  --help               this text\n"
    "  --version            the version of the library, and its optional parts\n"
    "\n"
    "Exit status: 0 if the mesh was written, 2 for bad usage, 1 else. That a mesh is partial is "
    "said on stderr.\n";

void print_usage(void) {
    fputs(USAGE, stdout);
    fputs(MORE_USAGE, stdout);
}

static bool parse_number(const char *text, double *value) {
    char *end;
    *value = strtod(text, &end);
    return end != text && *end == '\0';
}

static bool parse_count(const char *text, size_t *value) {
    char *end;
    errno = 0;
    unsigned long long number = strtoull(text, &end, 10);
    *value = (size_t)number;
    return *text >= '0' && *text <= '9' && *end == '\0' && errno == 0 && number <= SIZE_MAX;
}

/* Reads a label that ends at `*end`. */
static bool parse_label(const char *text, const char **end, int32_t *label) {
    char *stop;
    errno = 0;
    long long number = strtoll(text, &stop, 10);
    *end = stop;
    *label = (int32_t)number;
    return stop != text && errno == 0 && number >= INT32_MIN && number <= INT32_MAX;
}

/* Reads a number of bytes, such as 64M. */
static bool parse_bytes(const char *text, uint64_t *bytes) {
    static const char units[] = "KMG";
    char *end;
    errno = 0;
    unsigned long long number = strtoull(text, &end, 10);
    const char *unit = *end != '\0' ? strchr(units, *end) : NULL;
    const int shift = unit != NULL ? 10 * (int)(unit - units + 1) : 0;
    *bytes = (uint64_t)number << shift;
    return *text >= '0' && *text <= '9' && end[unit != NULL] == '\0' && errno == 0 &&
           *bytes >> shift == number;
}

static bool parse_name(const char *text, const char *const *names, size_t count, int32_t *value) {
    for (size_t i = 0; i < count; i++) {
        if (strcmp(text, names[i]) == 0) {
            *value = (int32_t)i;
            return true;
        }
    }
    return false;
}

/* Reads labels with commas between them, which end at `*end`; the caller frees them. NULL if there
 * is none where there should be one. */
static int32_t *parse_labels(const char *text, const char **end, size_t *count) {
    int32_t *list = malloc((strlen(text) / 2 + 1) * sizeof *list);
    *count = 0;
    for (*end = text; list != NULL && parse_label(*end, end, &list[*count]); ++*end) {
        ++*count;
        if (**end != ',') {
            return list;
        }
    }
    free(list);
    return NULL;
}

/* Reads numbers of layers with commas between them; the caller frees them. NULL if there is
 * anything else. */
static size_t *parse_layers(const char *text, size_t *count) {
    const char *end;
    int32_t *numbers = parse_labels(text, &end, count);
    size_t *list = malloc((strlen(text) / 2 + 1) * sizeof *list);
    bool good = numbers != NULL && list != NULL && *end == '\0';
    for (size_t n = 0; good && n < *count; n++) {
        good = numbers[n] >= 0;
        list[n] = (size_t)numbers[n];
    }
    free(numbers);
    if (good)
        return list;
    free(list);
    return NULL;
}

/* Reads numbers with commas between them; the caller frees them. NULL if there is anything else. */
static double *parse_numbers(const char *text, size_t *count) {
    double *list = malloc((strlen(text) / 2 + 1) * sizeof *list);
    *count = 0;
    for (char *end; list != NULL; text = end + 1) {
        list[*count] = strtod(text, &end);
        ++*count;
        if (end == text || (*end != ',' && *end != '\0')) {
            break;
        }
        if (*end == '\0') {
            return list;
        }
    }
    free(list);
    return NULL;
}

typedef enum { SET_OK, SET_UNKNOWN_OPTION, SET_BAD_VALUE, SET_REFUSED } set_result;

static set_result from_status(lapd_status status) {
    return status == LAPD_OK ? SET_OK : SET_REFUSED;
}

/* Sets the parameter that an option with a value stands for. The numbers of names are those of the
 * library's enums. */
static set_result set_parameter(lapd_context *context, lapd_params *params, const char *option,
                                const char *value) {
    static const char *const surfaces[] = {"smooth", "voxel"};
    static const char *const borders[] = {"flat", "smooth"};
    static const char *const improves[] = {"none", "interior", "full"};
    static const char *const adaptives[] = {"off", "thickness", "topology"};
    static const char *const levels[] = {"none", "sound", "full"};
    static const char *const algorithms[] = {"podm", "lapd"};
    static const char *const contentions[] = {"local", "global", "random", "aggressive"};
    static const char *const beggings[] = {"levels", "flat"};
    static const struct {
        const char *option;
        lapd_status (*set)(lapd_context *, lapd_params *, double);
    } numbers[] = {{"--delta", lapd_params_set_delta},
                   {"--size", lapd_params_set_size},
                   {"--radius-edge", lapd_params_set_radius_edge},
                   {"--facet-angle", lapd_params_set_facet_angle},
                   {"--spacing-floor", lapd_params_set_spacing_floor},
                   {"--across", lapd_params_set_across},
                   {"--least-size", lapd_params_set_least_size},
                   {"--gradation", lapd_params_set_gradation},
                   {"--gaussian", lapd_params_set_sigma},
                   {"--coarsen", lapd_params_set_coarsen},
                   {"--target-dihedral", lapd_params_set_target_dihedral},
                   {"--time-limit", lapd_params_set_time_limit}};
    static const struct {
        const char *option;
        lapd_status (*set)(lapd_context *, lapd_params *, size_t);
    } counts[] = {{"--threads", lapd_params_set_threads},
                  {"--max-vertices", lapd_params_set_max_vertices}};
    static const struct {
        const char *option;
        lapd_status (*set)(lapd_context *, lapd_params *, int32_t);
        const char *const *names;
        size_t count;
    } choices[] = {{"--surface", lapd_params_set_surface, surfaces, 2},
                   {"--border", lapd_params_set_border, borders, 2},
                   {"--improve", lapd_params_set_improve, improves, 3},
                   {"--adaptive", lapd_params_set_adaptive, adaptives, 3},
                   {"--certificate", lapd_params_set_certificate, levels, 3},
                   {"--algorithm", lapd_params_set_algorithm, algorithms, 2},
                   {"--contention", lapd_params_set_contention, contentions, 4},
                   {"--begging", lapd_params_set_begging, beggings, 2}};

    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        double number;
        if (strcmp(option, numbers[i].option) == 0) {
            return parse_number(value, &number)
                       ? from_status(numbers[i].set(context, params, number))
                       : SET_BAD_VALUE;
        }
    }
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        size_t count;
        if (strcmp(option, counts[i].option) == 0) {
            return parse_count(value, &count) ? from_status(counts[i].set(context, params, count))
                                              : SET_BAD_VALUE;
        }
    }
    for (size_t i = 0; i < sizeof choices / sizeof *choices; i++) {
        int32_t choice;
        if (strcmp(option, choices[i].option) == 0) {
            return parse_name(value, choices[i].names, choices[i].count, &choice)
                       ? from_status(choices[i].set(context, params, choice))
                       : SET_BAD_VALUE;
        }
    }
    if (strcmp(option, "--topology") == 0) {
        return from_status(lapd_params_set_topology(context, params, value));
    }
    if (strcmp(option, "--max-memory") == 0) {
        uint64_t bytes;
        return parse_bytes(value, &bytes)
                   ? from_status(lapd_params_set_max_memory(context, params, bytes))
                   : SET_BAD_VALUE;
    }
    if (strcmp(option, "--volume") == 0) {
        size_t volume;
        return parse_count(value, &volume) && volume <= INT64_MAX
                   ? from_status(lapd_context_set_volume(context, (int64_t)volume))
                   : SET_BAD_VALUE;
    }
    if (strcmp(option, "--max-read-bytes") == 0) {
        uint64_t bytes;
        return parse_bytes(value, &bytes)
                   ? from_status(lapd_context_set_max_read_bytes(context, bytes))
                   : SET_BAD_VALUE;
    }
    if (strcmp(option, "--label-size") == 0) {
        int32_t label;
        double size;
        const char *rest;
        if (!parse_label(value, &rest, &label) || *rest != '=' || !parse_number(rest + 1, &size)) {
            return SET_BAD_VALUE;
        }
        return from_status(lapd_params_set_label_size(context, params, label, size));
    }
    if (strcmp(option, "--order") == 0) {
        double order;
        if (!parse_number(value, &order) || order != floor(order) || fabs(order) > INT32_MAX) {
            return SET_BAD_VALUE;
        }
        return from_status(lapd_params_set_order(context, params, (int32_t)order));
    }
    if (strcmp(option, "--tets") == 0) {
        size_t tets;
        return parse_count(value, &tets) && tets > 0
                   ? from_status(lapd_params_set_target_tets(context, params, tets))
                   : SET_BAD_VALUE;
    }
    if (strcmp(option, "--min-voxels") == 0) {
        size_t least;
        return parse_count(value, &least)
                   ? from_status(lapd_params_set_min_voxels(context, params, least))
                   : SET_BAD_VALUE;
    }
    if (strcmp(option, "--background-label") == 0) {
        int32_t label;
        const char *rest;
        return parse_label(value, &rest, &label) && *rest == '\0'
                   ? from_status(lapd_params_set_background_label(context, params, label))
                   : SET_BAD_VALUE;
    }
    const bool merge = strcmp(option, "--merge") == 0;
    if (merge || strcmp(option, "--keep") == 0) {
        size_t count;
        int32_t target = 0;
        const char *rest;
        int32_t *labels = parse_labels(value, &rest, &count);
        bool good = labels != NULL &&
                    (!merge || (*rest == '=' && parse_label(rest + 1, &rest, &target))) &&
                    *rest == '\0';
        set_result result = SET_BAD_VALUE;
        if (good) {
            result =
                from_status(merge ? lapd_params_set_merge(context, params, labels, count, target)
                                  : lapd_params_set_keep(context, params, labels, count));
        }
        free(labels);
        return result;
    }
    return SET_UNKNOWN_OPTION;
}

/* Sets what an option with a value says of the input. */
static set_result set_input(options *o, const char *option, const char *value) {
    if (strcmp(option, "--isovalue") == 0) {
        free(o->isovalues);
        o->isovalues = parse_numbers(value, &o->isovalue_count);
        return o->isovalues != NULL ? SET_OK : SET_BAD_VALUE;
    }
    if (strcmp(option, "--frame") == 0) {
        static const char *const frames[] = {"lps", "ras"};
        int32_t choice;
        if (!parse_name(value, frames, 2, &choice)) {
            return SET_BAD_VALUE;
        }
        o->world = choice == 0 ? LAPD_WORLD_LPS : LAPD_WORLD_RAS;
        return SET_OK;
    }
    if (strcmp(option, "--split-interfaces") == 0) {
        if (strcmp(value, "all") == 0) {
            o->split_all = true;
            return SET_OK;
        }
        const char *rest;
        size_t count;
        int32_t *pair = parse_labels(value, &rest, &count);
        int32_t *pairs = realloc(o->split, (o->split_count + 1) * 2 * sizeof *pairs);
        const bool good = pair != NULL && pairs != NULL && count == 2 && *rest == '\0';
        if (pairs != NULL)
            o->split = pairs;
        if (good)
            memcpy(pairs + 2 * o->split_count++, pair, 2 * sizeof *pair);
        free(pair);
        return good ? SET_OK : SET_BAD_VALUE;
    }
    if (strcmp(option, "--spacing") == 0) {
        size_t count;
        double *sides = parse_numbers(value, &count);
        const bool good =
            sides != NULL && count == 3 && sides[0] > 0 && sides[1] > 0 && sides[2] > 0;
        if (good)
            memcpy(o->spacing, sides, sizeof o->spacing);
        free(sides);
        return good ? SET_OK : SET_BAD_VALUE;
    }
    if (strcmp(option, "--names") == 0) {
        o->names = value;
        return SET_OK;
    }
    if (strcmp(option, "--layer-order") == 0) {
        free(o->layer_order);
        o->layer_order = parse_layers(value, &o->layer_count);
        return o->layer_order != NULL ? SET_OK : SET_BAD_VALUE;
    }
    if (strcmp(option, "--labels") == 0) {
        const char *rest;
        free(o->labels);
        o->labels = parse_labels(value, &rest, &o->label_count);
        return o->labels != NULL && *rest == '\0' ? SET_OK : SET_BAD_VALUE;
    }
    return SET_UNKNOWN_OPTION;
}

static bool usage_error(const char *format, const char *a, const char *b) {
    complain(format, a, b);
    fputs("mesh_image: see mesh_image --help\n", stderr);
    return false;
}

bool parse_options(int argc, char **argv, lapd_context *context, lapd_params *params, options *o) {
    o->inputs = calloc((size_t)argc, sizeof *o->inputs);
    o->outputs = calloc((size_t)argc, sizeof *o->outputs);
    if (o->inputs == NULL || o->outputs == NULL) {
        return usage_error("out of memory%s%s", "", "");
    }
    for (int i = 1; i < argc; i++) {
        const char *option = argv[i];
        lapd_status status = LAPD_OK;
        if (option[0] != '-' || option[1] == '\0') {
            o->inputs[o->input_count++] = option;
            continue;
        }
        if (strcmp(option, "--background") == 0) {
            status = lapd_params_set_background(context, params, 1);
        } else if (strcmp(option, "--partial") == 0) {
            status = lapd_params_set_partial(context, params, 1);
        } else if (strcmp(option, "--count-accesses") == 0) {
            status = lapd_params_set_count_accesses(context, params, 1);
        } else if (strcmp(option, "--no-adaptive") == 0) {
            status = lapd_params_set_adaptive(context, params, LAPD_ADAPTIVE_OFF);
        } else if (strcmp(option, "--bind") == 0) {
            status = lapd_params_set_bind(context, params, 1);
        } else if (strcmp(option, "--curved") == 0) {
            status = lapd_params_set_curved(context, params, 1);
        } else if (strcmp(option, "--round") == 0) {
            o->label_values = LAPD_LABELS_ROUNDED;
        } else if (strcmp(option, "--map") == 0) {
            o->label_values = LAPD_LABELS_DISTINCT;
        } else if (strcmp(option, "--probabilities") == 0) {
            o->probabilities = true;
        } else if (strcmp(option, "--level-sets") == 0) {
            o->probabilities = true;
            o->level_sets = true;
        } else if (strcmp(option, "--measures") == 0) {
            o->measures = true;
        } else if (strcmp(option, "--boundary-parts") == 0) {
            o->boundary_parts = true;
        } else if (strcmp(option, "--memory") == 0) {
            o->memory = true;
        } else if (strcmp(option, "--estimate") == 0) {
            o->estimate = true;
        } else if (strcmp(option, "--allow-outside") == 0) {
            status = lapd_context_set_allow_outside(context, 1);
        } else if (strcmp(option, "--quiet") == 0) {
            o->quiet = true;
        } else {
            static const char *const with_value[] = {"-o",
                                                     "--report",
                                                     "--timeline",
                                                     "--topology",
                                                     "--delta",
                                                     "--size",
                                                     "--tets",
                                                     "--coarsen",
                                                     "--across",
                                                     "--least-size",
                                                     "--gradation",
                                                     "--keep",
                                                     "--label-size",
                                                     "--merge",
                                                     "--background-label",
                                                     "--radius-edge",
                                                     "--facet-angle",
                                                     "--threads",
                                                     "--algorithm",
                                                     "--begging",
                                                     "--contention",
                                                     "--max-vertices",
                                                     "--time-limit",
                                                     "--surface",
                                                     "--max-memory",
                                                     "--max-read-bytes",
                                                     "--volume",
                                                     "--spacing",
                                                     "--spacing-floor",
                                                     "--min-voxels",
                                                     "--isovalue",
                                                     "--labels",
                                                     "--frame",
                                                     "--layer-order",
                                                     "--names",
                                                     "--split-interfaces",
                                                     "--gaussian",
                                                     "--border",
                                                     "--improve",
                                                     "--adaptive",
                                                     "--certificate",
                                                     "--target-dihedral",
                                                     "--order"};
            int32_t known;
            if (!parse_name(option, with_value, sizeof with_value / sizeof *with_value, &known)) {
                return usage_error("unknown option %s%s", option, "");
            }
            if (i + 1 == argc) {
                return usage_error("%s needs a value%s", option, "");
            }
            const char *value = argv[++i];
            if (strcmp(option, "-o") == 0) {
                /* A bad name costs no run. */
                status = lapd_mesh_check_path(context, value);
                o->outputs[o->output_count++] = value;
            } else if (strcmp(option, "--report") == 0) {
                o->report = value;
            } else if (strcmp(option, "--timeline") == 0) {
                o->timeline = value;
                status = lapd_params_set_timeline(context, params, 1);
            } else {
                set_result result = set_input(o, option, value);
                if (result == SET_UNKNOWN_OPTION) {
                    result = set_parameter(context, params, option, value);
                }
                switch (result) {
                case SET_OK:
                    break;
                case SET_REFUSED:
                    return usage_error("%s: %s", option, lapd_context_last_error(context));
                default:
                    return usage_error("%s: bad value '%s'", option, value);
                }
                o->has_delta = o->has_delta || strcmp(option, "--delta") == 0;
                o->has_size = o->has_size || strcmp(option, "--size") == 0;
                o->has_level = o->has_level || strcmp(option, "--certificate") == 0;
            }
        }
        if (status != LAPD_OK) {
            return usage_error("%s: %s", option, lapd_context_last_error(context));
        }
    }
    if (o->input_count == 0) {
        return usage_error("no input%s%s", "", "");
    }
    if (o->input_count > 1 && !o->probabilities) {
        return usage_error("two inputs: %s and %s", o->inputs[0], o->inputs[1]);
    }
    if (o->layer_order != NULL && (o->isovalues != NULL || o->probabilities)) {
        return usage_error("--layer-order is for labels%s%s", "", "");
    }
    if (o->split_all && o->split_count > 0) {
        return usage_error("--split-interfaces takes all%s%s", " or pairs, ", "not both");
    }
    if (o->isovalues != NULL && o->probabilities) {
        return usage_error("--isovalue is for scans%s%s", ", --probabilities for maps", "");
    }
    if (o->labels != NULL && !o->probabilities && o->isovalue_count != o->label_count) {
        return usage_error("--labels needs as many values%s%s", " as --isovalue", "");
    }
    int32_t order = 1, curved = 0;
    lapd_params_get_order(params, &order);
    lapd_params_get_curved(params, &curved);
    if (curved && order != 2) {
        return usage_error("--curved needs --order 2%s%s", "", "");
    }
    for (size_t i = 0; order == 2 && i < o->output_count; i++) {
        static const char *const endings[] = {".node", ".ele", ".face", ".foam", ".mfem"};
        const char *dot = strrchr(o->outputs[i], '.');
        int32_t found;
        if (dot != NULL && parse_name(dot, endings, sizeof endings / sizeof *endings, &found)) {
            return usage_error("%s: this file has no place for --order 2%s", o->outputs[i], "");
        }
    }
    if (o->output_count == 0 && o->report == NULL && !o->estimate) {
        return usage_error("no output (-o), no --report%s%s", " and no --estimate", "");
    }
    return true;
}

void free_options(options *o) {
    free(o->inputs);
    free(o->isovalues);
    free(o->layer_order);
    free(o->labels);
    free(o->split);
    free(o->outputs);
}
