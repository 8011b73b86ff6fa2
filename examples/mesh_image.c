/*
 * mesh_image: meshes an image file. An example of the C interface, and a tool.
 *
 * It shows the whole way: parameters, context with progress and cancellation, image, run, files.
 * options.c reads the command line, report.c
 * shows what a mesh can be asked for. Exit status: 0 only if a mesh was written; 2 for bad
 * usage; 1 for everything else, with one line on stderr.
 */
#define _POSIX_C_SOURCE 200809L

#include <math.h>
#include <signal.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "options.h"
#include "report.h"

enum { EXIT_FAILED = 1, EXIT_USAGE = 2 };

/* ---- Messages ---- */

void complain(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    fputs("mesh_image: ", stderr);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
    va_end(arguments);
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* ---- Progress and cancellation ---- */

static lapd_context *volatile interrupted_context;

static void on_interrupt(int signal_number) {
    (void)signal_number;
    lapd_context_cancel(interrupted_context);
}

static void cancel_on_interrupt(lapd_context *context) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_interrupt;
    interrupted_context = context;
    sigaction(SIGINT, &action, NULL);
}

typedef struct {
    bool visible;
    double last_time;
    bool shown;
    /* Where the peaks of memory are kept, or NULL. */
    memory_use *memory;
    int32_t phase;
} progress_line;

static int32_t show_progress(void *user, const lapd_progress *progress) {
    static const char *const phases[] = {"preparing the image", "refinement",  "extraction",
                                         "improvement",         "certificate", "reading the image"};
    progress_line *line = user;
    /* The first report of a phase comes before anything is done in it, and the run waits for the
     * answer. Reading, whose number is the largest, comes before all of them. */
    for (; progress->phase != LAPD_PHASE_READ && line->phase < progress->phase &&
           line->phase < LAPD_PHASE_CERTIFY;
         line->phase++) {
        if (line->memory != NULL) {
            line->memory->peak[line->phase] = peak_memory();
        }
    }
    double time = now();
    if (line->visible && time - line->last_time >= 0.1) {
        size_t phase = (size_t)progress->phase;
        const char *name = phase < sizeof phases / sizeof *phases ? phases[phase] : "meshing";
        fprintf(stderr, "\r%3.0f %%  %-18s  %llu tets ", 100 * progress->fraction, name,
                (unsigned long long)progress->tets);
        fflush(stderr);
        line->last_time = time;
        line->shown = true;
    }
    return 0;
}

static void clear_progress(progress_line *line) {
    if (line->shown) {
        fprintf(stderr, "\r%60s\r", "");
        line->shown = false;
    }
}

static void show_warning(void *user, int32_t level, const char *message) {
    clear_progress(user);
    if (level == LAPD_LOG_WARNING) {
        fprintf(stderr, "mesh_image: warning: %s\n", message);
    }
}

/* ---- The program ---- */

/* Chooses what the command line left open. */
static lapd_status set_defaults(lapd_context *context, lapd_params *params, const lapd_image *image,
                                const options *o) {
    lapd_status status = LAPD_OK;
    double spacing[3], delta;
    if (!o->has_delta) {
        status = lapd_image_get_spacing(image, spacing);
        if (status == LAPD_OK) {
            status = lapd_params_set_delta(context, params,
                                           1.5 * cbrt(spacing[0] * spacing[1] * spacing[2]));
        }
    }
    if (status == LAPD_OK && !o->has_level && o->report != NULL) {
        status = lapd_params_set_certificate(context, params, LAPD_CERTIFICATE_FULL);
    }
    if (status == LAPD_OK && !o->has_size) {
        status = lapd_params_get_delta(params, &delta);
        if (status == LAPD_OK) {
            status = lapd_params_set_size(context, params, 2 * delta);
        }
    }
    return status;
}

static lapd_status read_input(lapd_context *context, const options *o, lapd_image **image) {
    if (o->isovalues != NULL) {
        return lapd_image_read_gray(context, o->inputs[0], o->world, o->isovalues,
                                    o->isovalue_count, o->labels, image);
    }
    if (o->level_sets) {
        return lapd_image_read_level_sets(context, o->inputs, o->input_count, o->world, o->labels,
                                          o->label_count, image);
    }
    if (o->probabilities) {
        return lapd_image_read_probabilities(context, o->inputs, o->input_count, o->world,
                                             o->labels, o->label_count, image);
    }
    return lapd_image_read_labels(context, o->inputs[0], o->world, o->label_values, o->layer_order,
                                  o->layer_count, image);
}

/* Writes the mesh to all files. */
static lapd_status write_outputs(lapd_context *context, const lapd_mesh *mesh, const options *o) {
    lapd_write_options *chosen = NULL;
    lapd_status status = lapd_write_options_create(&chosen);
    if (status == LAPD_OK)
        status = lapd_write_options_set_boundary_parts(context, chosen, o->boundary_parts);
    for (size_t i = 0; status == LAPD_OK && i < o->output_count; i++) {
        const char *path = o->outputs[i];
        const size_t length = strlen(path);
        /* Other files have no place for measures. */
        const bool is_vtu = length >= 4 && strcmp(path + length - 4, ".vtu") == 0;
        status = lapd_write_options_set_measures(context, chosen, o->measures && is_vtu);
        if (status == LAPD_OK)
            status = lapd_mesh_write_with(context, mesh, path, chosen);
    }
    lapd_write_options_free(chosen);
    return status;
}

/* Tells what a mesh would need, as lines of a name and a number. */
static lapd_status print_estimate(lapd_context *context, const lapd_image *image,
                                  const lapd_params *params, progress_line *line) {
    uint64_t tets = 0, peak_bytes = 0;
    double seconds = 0;
    lapd_status status = lapd_image_estimate(context, image, params, &tets, &peak_bytes, &seconds);
    clear_progress(line);
    if (status == LAPD_OK) {
        printf("tets %.3g\npeak MiB %.3g\nseconds %.2g\n", (double)tets,
               (double)peak_bytes / 1048576, seconds);
    }
    return status;
}

/* Everything from the image on. Returns the exit status. */
static int run(lapd_context *context, lapd_params *params, const options *o, progress_line *line) {
    int exit_status = EXIT_FAILED;
    lapd_image *image = NULL;
    lapd_mesh *mesh = NULL;
    summary s;
    file_seconds seconds = {0, 0, 0};
    memory_use memory;
    memset(&s, 0, sizeof s);
    memset(&memory, 0, sizeof memory);
    line->memory = o->memory ? &memory : NULL;
    const double start = now();

    lapd_status status = read_input(context, o, &image);
    seconds.read = now() - start;
    memory.read = resident_memory();
    if (status == LAPD_OK && o->spacing[0] != 0)
        status = lapd_image_set_spacing(context, image, o->spacing);
    if (status == LAPD_OK && o->names != NULL)
        status = lapd_image_read_label_names(context, image, o->names);
    if (status == LAPD_OK)
        status = set_defaults(context, params, image, o);
    if (status == LAPD_OK && o->estimate) {
        status = print_estimate(context, image, params, line);
        if (status == LAPD_OK)
            exit_status = EXIT_SUCCESS;
        else
            complain("%s", lapd_context_last_error(context));
        lapd_image_free(image);
        goto done;
    }
    if (status == LAPD_OK)
        status = lapd_mesh_image(context, image, params, &mesh);
    lapd_image_free(image);
    clear_progress(line);
    /* With --partial a mesh comes along with the status of a limit. */
    if (mesh == NULL) {
        complain("%s", lapd_context_last_error(context));
        goto done;
    }

    if ((o->split_all || o->split_count > 0) &&
        lapd_mesh_split_interfaces(context, mesh, o->split_all ? NULL : o->split, o->split_count) !=
            LAPD_OK) {
        complain("%s", lapd_context_last_error(context));
        goto done;
    }
    const double write_start = now();
    if (write_outputs(context, mesh, o) != LAPD_OK) {
        complain("%s", lapd_context_last_error(context));
        goto done;
    }
    if (o->timeline != NULL && lapd_mesh_write_timeline(context, mesh, o->timeline) != LAPD_OK) {
        complain("%s", lapd_context_last_error(context));
        goto done;
    }
    seconds.write = now() - write_start;
    seconds.total = now() - start;

    status = summarize(mesh, &s);
    if (status != LAPD_OK) {
        complain("%s", lapd_status_message(status));
        goto done;
    }
    if (o->report != NULL && save_report(context, mesh, o, &seconds, line->memory) != LAPD_OK) {
        complain("%s", lapd_context_last_error(context));
        goto done;
    }
    if (!o->quiet) {
        print_table(mesh, &s, &seconds);
    }
    exit_status = EXIT_SUCCESS;

done:
    line->memory = NULL;
    free(s.rows);
    free(s.defects);
    lapd_mesh_free(mesh);
    return exit_status;
}

int main(int argc, char **argv) {
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0) {
            print_usage();
            return EXIT_SUCCESS;
        }
        if (strcmp(argv[i], "--version") == 0) {
            puts(lapd_version());
            printf("built with: %s\n", *lapd_features() != '\0' ? lapd_features() : "nothing more");
            return EXIT_SUCCESS;
        }
    }

    int exit_status = EXIT_FAILED;
    lapd_context *context = NULL;
    lapd_params *params = NULL;
    options o;
    progress_line line;
    memset(&o, 0, sizeof o);
    memset(&line, 0, sizeof line);
    if (lapd_context_create(&context) != LAPD_OK || lapd_params_create(&params) != LAPD_OK) {
        complain("the library does not start");
    } else if (!parse_options(argc, argv, context, params, &o)) {
        exit_status = EXIT_USAGE;
    } else {
        cancel_on_interrupt(context);
        lapd_context_set_log(context, show_warning, &line);
        line.visible = !o.quiet && isatty(STDERR_FILENO);
        if (line.visible || o.memory) {
            lapd_context_set_progress(context, show_progress, &line);
        }
        exit_status = run(context, params, &o, &line);
        signal(SIGINT, SIG_DFL);
    }
    free_options(&o);
    lapd_params_free(params);
    lapd_context_free(context);
    return exit_status;
}
