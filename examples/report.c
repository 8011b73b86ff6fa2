/* The report of mesh_image: a readable table, and one JSON object. */
#define _POSIX_C_SOURCE 200809L

#include "report.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

enum { DEFECT_KINDS = LAPD_DEFECT_DROPPED + 1, LEFT_CAUSES = LAPD_LEFT_INSIDE + 1 };

/* The name of a value of an enum; a newer library may have more of them than this program knows. */
static const char *name_of(const char *const *names, size_t count, int64_t value) {
    return value >= 0 && (uint64_t)value < count ? names[value] : "unknown";
}

/* ---- The table ---- */

lapd_status keep_texts(const lapd_image *image, text_getter *get, label_texts *kept) {
    const int32_t *labels;
    size_t count, bytes = 0;
    lapd_status status = lapd_image_get_labels(image, &labels, &count);
    if (status != LAPD_OK)
        return status;
    kept->labels = calloc(count + 1, sizeof *kept->labels);
    if (kept->labels == NULL)
        return LAPD_ERROR_OUT_OF_MEMORY;
    for (size_t n = 0; n < count; n++) {
        const char *text;
        status = get(image, labels[n], &text);
        if (status != LAPD_OK)
            return status;
        if (text == NULL)
            continue;
        const size_t length = strlen(text) + 1;
        char *texts = realloc(kept->texts, bytes + length);
        if (texts == NULL)
            return LAPD_ERROR_OUT_OF_MEMORY;
        memcpy(texts + bytes, text, length);
        kept->texts = texts;
        kept->labels[kept->count++] = labels[n];
        bytes += length;
    }
    return LAPD_OK;
}

/* The text of a label, or "". */
static const char *text_of(const label_texts *kept, int32_t label) {
    const char *text = kept->texts;
    for (size_t n = 0; n < kept->count; n++, text += strlen(text) + 1) {
        if (kept->labels[n] == label)
            return text;
    }
    return "";
}

lapd_status summarize(const lapd_mesh *mesh, summary *s) {
    s->counts.struct_size = sizeof s->counts;
    s->timings.struct_size = sizeof s->timings;
    s->operations.struct_size = sizeof s->operations;
    s->quality.struct_size = sizeof s->quality;
    s->certificate.struct_size = sizeof s->certificate;
    s->improvement.struct_size = sizeof s->improvement;
    s->second_order.struct_size = sizeof s->second_order;
    s->all_threads.struct_size = sizeof s->all_threads;
    lapd_status status = lapd_mesh_get_counts(mesh, &s->counts);
    if (status == LAPD_OK)
        status = lapd_mesh_get_timings(mesh, &s->timings);
    if (status == LAPD_OK)
        status = lapd_mesh_get_operations(mesh, &s->operations);
    if (status == LAPD_OK)
        status = lapd_mesh_get_quality(mesh, &s->quality);
    if (status == LAPD_OK)
        status = lapd_mesh_get_certificate(mesh, &s->certificate);
    if (status == LAPD_OK)
        status = lapd_mesh_get_improvement(mesh, &s->improvement);
    if (status == LAPD_OK)
        status = lapd_mesh_get_second_order(mesh, &s->second_order);
    if (status == LAPD_OK)
        status = lapd_mesh_get_left_count(mesh, &s->left_count);
    if (status == LAPD_OK)
        status = lapd_mesh_get_limit_reached(mesh, &s->limit_reached);
    if (status == LAPD_OK)
        status = lapd_mesh_get_label_row_count(mesh, &s->row_count);
    if (status == LAPD_OK)
        status = lapd_mesh_get_component_row_count(mesh, &s->component_count);
    if (status == LAPD_OK)
        status = lapd_mesh_get_defect_count(mesh, &s->defect_count);
    if (status == LAPD_OK)
        status = lapd_mesh_get_thread_count(mesh, &s->thread_count);
    if (status == LAPD_OK)
        status = lapd_mesh_get_thread_report(mesh, LAPD_ALL_THREADS, &s->all_threads);
    if (status != LAPD_OK) {
        return status;
    }
    s->rows = calloc(s->row_count + 1, sizeof *s->rows);
    s->components = calloc(s->component_count + 1, sizeof *s->components);
    s->defects = calloc(s->defect_count + 1, sizeof *s->defects);
    s->left = calloc(s->left_count + 1, sizeof *s->left);
    s->threads = calloc(s->thread_count + 1, sizeof *s->threads);
    if (s->rows == NULL || s->components == NULL || s->defects == NULL || s->left == NULL ||
        s->threads == NULL) {
        return LAPD_ERROR_OUT_OF_MEMORY;
    }
    for (size_t i = 0; i < s->row_count && status == LAPD_OK; i++) {
        s->rows[i].struct_size = sizeof s->rows[i];
        status = lapd_mesh_get_label_row(mesh, i, &s->rows[i]);
    }
    for (size_t i = 0; i < s->component_count && status == LAPD_OK; i++) {
        s->components[i].struct_size = sizeof s->components[i];
        status = lapd_mesh_get_component_row(mesh, i, &s->components[i]);
    }
    for (size_t i = 0; i < s->defect_count && status == LAPD_OK; i++) {
        s->defects[i].struct_size = sizeof s->defects[i];
        status = lapd_mesh_get_defect(mesh, i, &s->defects[i]);
    }
    for (size_t i = 0; i < s->left_count && status == LAPD_OK; i++) {
        s->left[i].struct_size = sizeof s->left[i];
        status = lapd_mesh_get_left(mesh, i, &s->left[i]);
    }
    for (size_t i = 0; i < s->thread_count && status == LAPD_OK; i++) {
        s->threads[i].struct_size = sizeof s->threads[i];
        status = lapd_mesh_get_thread_report(mesh, i, &s->threads[i]);
    }
    return status;
}

/* Volume error of a label in percent. */
static double volume_error(const lapd_label_row *row) {
    return row->image_volume > 0 ? 100 * (row->mesh_volume / row->image_volume - 1) : 0;
}

/* Of nothing there is no mean: NaN, which becomes null in JSON. */
static double ratio(double part, double whole) {
    return whole > 0 ? part / whole : NAN;
}

/* The worst label first. */
static int by_volume_error(const void *a, const void *b) {
    double x = fabs(volume_error(a)), y = fabs(volume_error(b));
    return (x < y) - (x > y);
}

void print_table(const summary *s, const file_seconds *seconds) {
    const lapd_quality *q = &s->quality;
    const lapd_certificate *c = &s->certificate;
    enum { WORST = 10, BAR = 40 };
    double mesh_volume = 0, image_volume = 0;
    for (size_t i = 0; i < s->row_count; i++) {
        mesh_volume += s->rows[i].mesh_volume;
        image_volume += s->rows[i].image_volume;
    }
    printf("tets                 %12llu\n", (unsigned long long)s->counts.tissue_tets);
    printf("vertices             %12llu\n", (unsigned long long)s->counts.vertices);
    printf("interface facets     %12llu\n", (unsigned long long)s->counts.interface_facets);
    printf("volume               %12.6g  (image %.6g, %+.3f %%)\n", mesh_volume, image_volume,
           image_volume > 0 ? 100 * (mesh_volume / image_volume - 1) : 0);
    printf("dihedral angles      %12.2f to %.2f degrees\n", q->min_dihedral, q->max_dihedral);
    printf("largest radius-edge  %12.3f\n", q->max_radius_edge);
    printf("scaled Jacobians     %12.3f to %.3f, edge ratio up to %.2f, radius ratio up to %.2f\n",
           q->min_scaled_jacobian, q->max_scaled_jacobian, q->max_edge_ratio, q->max_radius_ratio);
    printf("smallest facet angle %12.2f degrees\n", q->min_facet_angle);
    printf("seconds              %12.2f  (read %.2f, prepare %.2f, refine %.2f, extract %.2f, "
           "improve %.2f, "
           "certify %.2f, write %.2f)\n",
           seconds->total, seconds->read, s->timings.prepare, s->timings.refine, s->timings.extract,
           s->timings.improve, s->timings.certify, seconds->write);

    uint64_t largest = 1, all = 0;
    for (int i = 0; i < 18; i++) {
        largest = q->dihedral_histogram[i] > largest ? q->dihedral_histogram[i] : largest;
        all += q->dihedral_histogram[i];
    }
    printf("\ndihedral angles, degrees\n");
    for (int i = 0; i < 18; i++) {
        static const char bar[BAR + 1] = "########################################";
        uint64_t n = q->dihedral_histogram[i];
        printf("  %3d-%-3d %6.2f %% %.*s\n", 10 * i, 10 * (i + 1),
               all > 0 ? 100.0 * (double)n / (double)all : 0.0,
               (int)(BAR * (double)n / (double)largest + 0.5), bar);
    }

    lapd_label_row *worst = malloc((s->row_count + 1) * sizeof *worst);
    if (worst != NULL && s->row_count > 0) {
        memcpy(worst, s->rows, s->row_count * sizeof *worst);
        qsort(worst, s->row_count, sizeof *worst, by_volume_error);
        size_t shown = s->row_count < WORST ? s->row_count : WORST;
        printf("\n%zu labels%s\n", s->row_count,
               shown < s->row_count ? ", those with the largest volume error:" : "");
        printf("       label       tets       volume        image    error  parts (image)\n");
        for (size_t i = 0; i < shown; i++) {
            const char *name = text_of(&s->names, worst[i].label);
            printf("  %10lld %10llu %12.6g %12.6g %+7.2f%%  %llu (%llu)%s%s\n",
                   (long long)worst[i].label, (unsigned long long)worst[i].tets,
                   worst[i].mesh_volume, worst[i].image_volume, volume_error(&worst[i]),
                   (unsigned long long)worst[i].components_mesh,
                   (unsigned long long)worst[i].components_image, *name != '\0' ? "  " : "", name);
        }
    }
    free(worst);

    const lapd_improvement *im = &s->improvement;
    if (im->target_dihedral > 0) {
        printf("\nimprovement to dihedral angles of %g to %g degrees\n", im->target_dihedral,
               180 - im->target_dihedral);
        printf("  tets below %llu, left %llu\n", (unsigned long long)im->below_before,
               (unsigned long long)im->left);
        printf("  edges removed %llu, flipped on interfaces %llu, split %llu; vertices moved "
               "inside %llu, on interfaces "
               "%llu, on junctions %llu\n",
               (unsigned long long)im->edge_removals, (unsigned long long)im->interface_flips,
               (unsigned long long)im->splits, (unsigned long long)im->moves_inside,
               (unsigned long long)im->moves_on_interfaces,
               (unsigned long long)im->moves_on_junctions);
        printf("  interface vertices moved off by %.3f at most (%.3f allowed); facets no longer "
               "Delaunay %llu\n",
               im->max_interface_move, im->tolerance, (unsigned long long)im->non_delaunay_facets);
    }

    const lapd_second_order *so = &s->second_order;
    if (so->nodes > 0) {
        printf("\nsecond order\n");
        printf("  nodes on edges %llu, on interfaces moved %llu, of these not all the way %llu, "
               "not at all %llu\n",
               (unsigned long long)so->nodes, (unsigned long long)so->curved,
               (unsigned long long)so->shortened, (unsigned long long)so->straight);
        if (so->curved > 0) {
            printf(
                "  moved by %.3f at most; least Jacobian %.3f of the straight one's; volume %.6g\n",
                so->max_move, so->min_jacobian, so->volume);
        }
    }

    printf("\ncertificate\n");
    printf("  non-Delaunay facets %llu, inverted tets %llu, orphan vertices %llu, open edges %llu, "
           "facets off walls "
           "%llu\n",
           (unsigned long long)c->non_delaunay_facets, (unsigned long long)c->inverted_tets,
           (unsigned long long)c->orphan_vertices, (unsigned long long)c->open_edges,
           (unsigned long long)c->facets_off_walls);
    printf("  mesh to image: mean %.3f, largest %.3f; image to mesh: mean %.3f, largest %.3f\n",
           c->mesh_to_image_mean, c->mesh_to_image_max, c->image_to_mesh_mean,
           c->image_to_mesh_max);
    printf("  mesh to smooth surface: mean %.3f, largest %.3f; back: mean %.3f, largest %.3f\n",
           c->mesh_to_surface_mean, c->mesh_to_surface_max, c->surface_to_mesh_mean,
           c->surface_to_mesh_max);
    uint64_t defects[DEFECT_KINDS] = {0};
    for (size_t i = 0; i < s->defect_count; i++) {
        const int64_t kind = s->defects[i].kind;
        if (kind >= 0 && kind < DEFECT_KINDS) {
            defects[kind]++;
        }
    }
    printf("  components lost %llu, merged %llu, torn off %llu, stray %llu, left out %llu; non-manifold "
           "edges %llu, "
           "vertices %llu\n",
           (unsigned long long)defects[LAPD_DEFECT_LOST],
           (unsigned long long)defects[LAPD_DEFECT_MERGED],
           (unsigned long long)defects[LAPD_DEFECT_TORN],
           (unsigned long long)defects[LAPD_DEFECT_STRAY],
           (unsigned long long)defects[LAPD_DEFECT_DROPPED],
           (unsigned long long)defects[LAPD_DEFECT_NON_MANIFOLD_EDGE],
           (unsigned long long)defects[LAPD_DEFECT_NON_MANIFOLD_VERTEX]);
    printf("  unmet rules:");
    for (int i = 0; i < 6; i++) {
        printf(" R%d %llu%s", i + 1, (unsigned long long)c->unmet[i], i < 5 ? "," : "\n");
    }

    if (s->thread_count > 1) {
        const lapd_thread_report *all = &s->all_threads;
        const double attempts = (double)(all->insertions + all->removals + all->rollbacks);
        const double seconds_of_all = (double)s->thread_count * s->timings.refine;
        printf("\n%zu threads\n  rollbacks %llu, %.2f %% of operations\n", s->thread_count,
               (unsigned long long)all->rollbacks, 100 * ratio((double)all->rollbacks, attempts));
        printf("  time lost in refinement: %.2f %% rolled back, %.2f %% waiting after conflicts, "
               "%.2f %% idle\n",
               100 * ratio(all->rollback_seconds, seconds_of_all),
               100 * ratio(all->contention_seconds, seconds_of_all),
               100 * ratio(all->idle_seconds, seconds_of_all));
        const double accesses = (double)(all->local_accesses + all->remote_accesses);
        if (accesses > 0) {
            printf("  accesses to other nodes' memory: %.2f %%, %.2f hops in the mean\n",
                   100 * (double)all->remote_accesses / accesses,
                   (double)all->access_hops / accesses);
        }
    }
}

/* ---- The JSON report ---- */

/* The bytes of the UTF-8 sequence at `s`, or 0 if it is not one. */
static size_t utf8_length(const unsigned char *s) {
    static const unsigned char least_second[] = {0xE0, 0xA0, 0xF0, 0x90};
    size_t length = s[0] < 0x80                   ? 1
                    : s[0] >= 0xC2 && s[0] < 0xE0 ? 2
                    : (s[0] & 0xF0) == 0xE0       ? 3
                    : s[0] >= 0xF0 && s[0] < 0xF5 ? 4
                                                  : 0;
    for (size_t i = 1; i < length; i++) {
        if ((s[i] & 0xC0) != 0x80) {
            return 0;
        }
    }
    /* Overlong forms, surrogates, and what lies beyond U+10FFFF. */
    if ((s[0] == least_second[0] && s[1] < least_second[1]) ||
        (s[0] == least_second[2] && s[1] < least_second[3]) || (s[0] == 0xED && s[1] > 0x9F) ||
        (s[0] == 0xF4 && s[1] > 0x8F)) {
        return 0;
    }
    return length;
}

static void json_string(FILE *file, const char *text) {
    fputc('"', file);
    for (const unsigned char *s = (const unsigned char *)text; *s != '\0';) {
        size_t length = utf8_length(s);
        if (length == 0) {
            fputs("\\ufffd", file);
            length = 1;
        } else if (*s == '"' || *s == '\\') {
            fprintf(file, "\\%c", *s);
        } else if (*s < 0x20) {
            fprintf(file, "\\u%04x", *s);
        } else {
            fwrite(s, 1, length, file);
        }
        s += length;
    }
    fputc('"', file);
}

/* JSON has no infinities and no NaN. */
static void json_number(FILE *file, const char *before, const char *name, double value) {
    if (isfinite(value)) {
        fprintf(file, "%s\"%s\": %.17g", before, name, value);
    } else {
        fprintf(file, "%s\"%s\": null", before, name);
    }
}

static void json_integer(FILE *file, const char *before, const char *name, int64_t value) {
    fprintf(file, "%s\"%s\": %lld", before, name, (long long)value);
}

static void json_position(FILE *file, const double position[3]) {
    fprintf(file, ", \"position\": [%.17g, %.17g, %.17g]", position[0], position[1], position[2]);
}

static void json_count(FILE *file, const char *before, const char *name, uint64_t value) {
    fprintf(file, "%s\"%s\": %llu", before, name, (unsigned long long)value);
}

/* One count for each of R1 to R6. */
static void json_rules(FILE *file, const char *before, const char *name, const uint64_t counts[6]) {
    fprintf(file, "%s\"%s\": {", before, name);
    for (int i = 0; i < 6; i++) {
        fprintf(file, "%s\"R%d\": %llu", i > 0 ? ", " : "", i + 1, (unsigned long long)counts[i]);
    }
    fputc('}', file);
}

/* Least, largest and histogram of a measure of tets. */
static void json_spread(FILE *file, const char *name, double least, double largest,
                        const uint64_t histogram[20]) {
    fprintf(file, ", \"%s\": {", name);
    json_number(file, "", "least", least);
    json_number(file, ", ", "largest", largest);
    fputs(", \"histogram\": [", file);
    for (int i = 0; i < 20; i++) {
        fprintf(file, "%s%llu", i > 0 ? ", " : "", (unsigned long long)histogram[i]);
    }
    fputs("]}", file);
}

/* With what one thread, or all of them together, lost time. */
static void json_overhead(FILE *file, const lapd_thread_report *thread) {
    json_number(file, "", "rollback_s", thread->rollback_seconds);
    json_number(file, ", ", "contention_s", thread->contention_seconds);
    json_number(file, ", ", "idle_s", thread->idle_seconds);
    json_rules(file, ", ", "rollbacks_by_rule", thread->rollbacks_by_rule);
    json_count(file, ", ", "stale", thread->stale);
    json_count(file, ", ", "waits", thread->waits);
    json_count(file, ", ", "begs", thread->begs);
    json_count(file, ", ", "gifts", thread->gifts);
    json_count(file, ", ", "local_accesses", thread->local_accesses);
    json_count(file, ", ", "remote_accesses", thread->remote_accesses);
    json_count(file, ", ", "access_hops", thread->access_hops);
}

uint64_t peak_memory(void) {
    struct rusage usage;
    return getrusage(RUSAGE_SELF, &usage) == 0 ? 1024 * (uint64_t)usage.ru_maxrss : 0;
}

/* Linux tells the pages in the second number of this file; elsewhere there is no such file. */
uint64_t resident_memory(void) {
    unsigned long long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file != NULL) {
        if (fscanf(file, "%*u %llu", &pages) != 1) {
            pages = 0;
        }
        fclose(file);
    }
    return (uint64_t)pages * (uint64_t)sysconf(_SC_PAGESIZE);
}

static void write_json(FILE *f, const options *o, const lapd_params *params, const summary *s,
                       const file_seconds *seconds, const memory_use *memory) {
    double delta = NAN, size = NAN;
    size_t threads = 0;
    lapd_params_get_delta(params, &delta);
    lapd_params_get_size(params, &size);
    lapd_params_get_threads(params, &threads);
    int32_t algorithm = LAPD_ALGORITHM_PODM;
    lapd_params_get_algorithm(params, &algorithm);

    fprintf(f, "{\n  \"version\": \"%s\",\n  \"input\": ", lapd_version());
    json_string(f, o->inputs[0]);
    static const char *const axes[] = {"unknown", "LPS", "RAS", "LAS"};
    fprintf(f, ",\n  \"world\": \"%s\"", name_of(axes, 4, s->world_axes));
    json_number(f, ",\n  ", "delta", delta);
    json_number(f, ",\n  ", "size", size);
    json_count(f, ",\n  ", "threads", threads);
    static const char *const algorithms[] = {"podm", "lapd"};
    fprintf(f, ",\n  \"algorithm\": \"%s\"", name_of(algorithms, 2, algorithm));
    fputs(",\n  \"limit_reached\": ", f);
    if (s->limit_reached != LAPD_OK) {
        json_string(f, lapd_status_name(s->limit_reached));
    } else {
        fputs("null", f);
    }
    json_count(f, ",\n  ", "tets", s->counts.tissue_tets);
    json_count(f, ",\n  ", "vertices", s->counts.vertices);
    json_count(f, ",\n  ", "interface_facets", s->counts.interface_facets);
    json_count(f, ",\n  ", "all_tets", s->counts.all_tets);
    json_count(f, ",\n  ", "all_vertices", s->counts.all_vertices);
    json_count(f, ",\n  ", "peak_rss_bytes", peak_memory());
    json_count(f, ",\n  ", "oracle_bytes", s->counts.oracle_bytes);
    if (memory != NULL) {
        json_count(f, ",\n  \"memory_bytes\": {", "read", memory->read);
        json_count(f, ", ", "peak_prepare", memory->peak[LAPD_PHASE_PREPARE]);
        json_count(f, ", ", "peak_refine", memory->peak[LAPD_PHASE_REFINE]);
        json_count(f, ", ", "peak_extract", memory->peak[LAPD_PHASE_EXTRACT]);
        json_count(f, ", ", "peak_improve", memory->peak[LAPD_PHASE_IMPROVE]);
        fputc('}', f);
    }

    fputs(",\n  \"seconds\": {", f);
    json_number(f, "", "read", seconds->read);
    json_number(f, ", ", "prepare", s->timings.prepare);
    json_number(f, ", ", "refine", s->timings.refine);
    json_number(f, ", ", "extract", s->timings.extract);
    json_number(f, ", ", "improve", s->timings.improve);
    json_number(f, ", ", "certify", s->timings.certify);
    json_number(f, ", ", "write", seconds->write);
    json_number(f, ", ", "total", seconds->total);

    fputs("},\n  \"operations\": {", f);
    json_count(f, "", "insertions", s->operations.insertions);
    json_count(f, ", ", "removals", s->operations.removals);
    json_count(f, ", ", "rollbacks", s->operations.rollbacks);
    json_count(f, ", ", "exact_predicates", s->operations.exact_predicates);
    json_count(f, ", ", "in_sphere_tests", s->operations.in_sphere_tests);
    json_count(f, ", ", "tets_created", s->operations.tets_created);
    json_count(f, ", ", "cavity_tets", s->operations.cavity_tets);
    json_count(f, ", ", "looks", s->operations.inspections);
    json_count(f, ", ", "label_lookups", s->operations.label_lookups);
    json_count(f, ", ", "crossing_lookups", s->operations.crossing_lookups);
    json_rules(f, ", ", "by_rule", s->operations.by_rule);
    const double vertices = (double)s->counts.all_vertices, tets = (double)s->counts.all_tets;
    const double insertions = (double)s->operations.insertions,
                 tests = (double)s->operations.in_sphere_tests;
    json_number(f, ", ", "insertions_per_vertex", ratio(insertions, vertices));
    json_number(f, ", ", "removals_per_vertex", ratio((double)s->operations.removals, vertices));
    json_number(f, ", ", "mean_cavity", ratio((double)s->operations.cavity_tets, insertions));
    json_number(f, ", ", "exact_share", ratio((double)s->operations.exact_predicates, tests));
    json_number(f, ", ", "looks_per_tet", ratio((double)s->operations.inspections, tets));
    json_number(
        f, ", ", "lookups_per_tet",
        ratio((double)(s->operations.label_lookups + s->operations.crossing_lookups), tets));
    fputs("},\n  \"overhead\": {", f);
    json_overhead(f, &s->all_threads);
    /* Accesses to memory of other nodes are counted, if asked for, and not timed. */
    fputs(", \"remote_s\": 0},\n  \"thread_reports\": [", f);
    for (size_t i = 0; i < s->thread_count; i++) {
        json_count(f, i > 0 ? ",\n    {" : "\n    {", "insertions", s->threads[i].insertions);
        json_count(f, ", ", "removals", s->threads[i].removals);
        json_count(f, ", ", "tets_created", s->threads[i].tets_created);
        json_count(f, ", ", "rollbacks", s->threads[i].rollbacks);
        fputs(", ", f);
        json_overhead(f, &s->threads[i]);
        fputc('}', f);
    }
    fputs("\n  ]", f);

    fputs(",\n  \"quality\": {", f);
    json_number(f, "", "min_dihedral", s->quality.min_dihedral);
    json_number(f, ", ", "max_dihedral", s->quality.max_dihedral);
    json_number(f, ", ", "max_radius_edge", s->quality.max_radius_edge);
    json_number(f, ", ", "min_facet_angle", s->quality.min_facet_angle);
    fputs(", \"dihedral_histogram\": [", f);
    for (int i = 0; i < 18; i++) {
        fprintf(f, "%s%llu", i > 0 ? ", " : "",
                (unsigned long long)s->quality.dihedral_histogram[i]);
    }

    fputc(']', f);
    json_spread(f, "scaled_jacobian", s->quality.min_scaled_jacobian,
                s->quality.max_scaled_jacobian, s->quality.scaled_jacobian_histogram);
    json_spread(f, "edge_ratio", s->quality.min_edge_ratio, s->quality.max_edge_ratio,
                s->quality.edge_ratio_histogram);
    json_spread(f, "radius_ratio", s->quality.min_radius_ratio, s->quality.max_radius_ratio,
                s->quality.radius_ratio_histogram);

    const lapd_improvement *im = &s->improvement;
    fputs("},\n  \"improvement\": {", f);
    json_number(f, "", "target_dihedral", im->target_dihedral);
    json_number(f, ", ", "tolerance", im->tolerance);
    json_count(f, ", ", "below_before", im->below_before);
    json_count(f, ", ", "left", im->left);
    json_count(f, ", ", "edge_removals", im->edge_removals);
    json_count(f, ", ", "interface_flips", im->interface_flips);
    json_count(f, ", ", "moves_inside", im->moves_inside);
    json_count(f, ", ", "moves_on_interfaces", im->moves_on_interfaces);
    json_count(f, ", ", "moves_on_junctions", im->moves_on_junctions);
    json_count(f, ", ", "splits", im->splits);
    json_number(f, ", ", "max_flip", im->max_flip);
    json_number(f, ", ", "max_interface_move", im->max_interface_move);
    json_number(f, ", ", "max_move", im->max_move);
    json_count(f, ", ", "non_delaunay_facets", im->non_delaunay_facets);
    fputs(", \"left_tets\": [", f);
    for (size_t i = 0; i < s->left_count; i++) {
        static const char *const causes[LEFT_CAUSES] = {"contact", "wall", "junction", "interface",
                                                        "inside"};
        const lapd_left *left = &s->left[i];
        fprintf(f, "%s\n    {\"tet\": %llu, \"label\": %lld, \"cause\": \"%s\"", i > 0 ? "," : "",
                (unsigned long long)left->tet, (long long)left->label,
                name_of(causes, LEFT_CAUSES, left->cause));
        json_position(f, left->position);
        json_number(f, ", ", "min_dihedral", left->min_dihedral);
        json_number(f, ", ", "max_dihedral", left->max_dihedral);
        fputc('}', f);
    }

    const lapd_second_order *so = &s->second_order;
    fputs("]},\n  \"second_order\": {", f);
    json_count(f, "", "nodes", so->nodes);
    json_count(f, ", ", "curved", so->curved);
    json_count(f, ", ", "shortened", so->shortened);
    json_count(f, ", ", "straight", so->straight);
    json_number(f, ", ", "max_move", so->max_move);
    json_number(f, ", ", "min_jacobian", so->min_jacobian);
    json_number(f, ", ", "volume", so->volume);

    const lapd_certificate *c = &s->certificate;
    fputs("},\n  \"certificate\": {", f);
    json_count(f, "", "non_delaunay_facets", c->non_delaunay_facets);
    json_count(f, ", ", "inverted_tets", c->inverted_tets);
    json_count(f, ", ", "orphan_vertices", c->orphan_vertices);
    json_count(f, ", ", "open_edges", c->open_edges);
    json_count(f, ", ", "facets_off_walls", c->facets_off_walls);
    json_count(f, ", ", "small_components_lost", c->small_components_lost);
    json_number(f, ", ", "hausdorff_mesh_to_image", c->mesh_to_image_max);
    json_number(f, ", ", "hausdorff_image_to_mesh", c->image_to_mesh_max);
    json_number(f, ", ", "mean_mesh_to_image", c->mesh_to_image_mean);
    json_number(f, ", ", "mean_image_to_mesh", c->image_to_mesh_mean);
    json_number(f, ", ", "hausdorff_mesh_to_surface", c->mesh_to_surface_max);
    json_number(f, ", ", "hausdorff_surface_to_mesh", c->surface_to_mesh_max);
    json_number(f, ", ", "mean_mesh_to_surface", c->mesh_to_surface_mean);
    json_number(f, ", ", "mean_surface_to_mesh", c->surface_to_mesh_mean);
    json_rules(f, ", ", "unmet", c->unmet);

    if (s->values.count > 0) {
        fputs("},\n  \"values\": {", f);
        const char *value = s->values.texts;
        for (size_t n = 0; n < s->values.count; n++, value += strlen(value) + 1) {
            fprintf(f, "%s\"%lld\": ", n > 0 ? ", " : "", (long long)s->values.labels[n]);
            json_string(f, value);
        }
    }

    fputs("},\n  \"labels\": [", f);
    for (size_t i = 0; i < s->row_count; i++) {
        const lapd_label_row *row = &s->rows[i];
        fprintf(f, "%s\n    {\"label\": %lld", i > 0 ? "," : "", (long long)row->label);
        const char *name = text_of(&s->names, row->label);
        if (*name != '\0') {
            fputs(", \"name\": ", f);
            json_string(f, name);
        }
        json_count(f, ", ", "tets", row->tets);
        json_number(f, ", ", "mesh_volume", row->mesh_volume);
        json_number(f, ", ", "image_volume", row->image_volume);
        json_count(f, ", ", "image_voxels", row->image_voxels);
        json_count(f, ", ", "components_image", row->components_image);
        json_count(f, ", ", "components_mesh", row->components_mesh);
        json_count(f, ", ", "components_lost", row->components_lost);
        json_count(f, ", ", "components_merged", row->components_merged);
        json_count(f, ", ", "pieces", row->pieces);
        json_integer(f, ", ", "euler_image", row->euler_image);
        json_integer(f, ", ", "euler_mesh", row->euler_mesh);
        json_count(f, ", ", "non_manifold_edges", row->non_manifold_edges);
        json_count(f, ", ", "non_manifold_vertices", row->non_manifold_vertices);
        json_number(f, ", ", "hausdorff_mesh_to_image", row->mesh_to_image_max);
        json_number(f, ", ", "hausdorff_image_to_mesh", row->image_to_mesh_max);
        json_number(f, ", ", "mean_mesh_to_image", row->mesh_to_image_mean);
        json_number(f, ", ", "mean_image_to_mesh", row->image_to_mesh_mean);
        json_number(f, ", ", "hausdorff_mesh_to_surface", row->mesh_to_surface_max);
        json_number(f, ", ", "hausdorff_surface_to_mesh", row->surface_to_mesh_max);
        json_number(f, ", ", "mean_mesh_to_surface", row->mesh_to_surface_mean);
        json_number(f, ", ", "mean_surface_to_mesh", row->surface_to_mesh_mean);
        json_number(f, ", ", "volume_change", row->volume_change);
        fputc('}', f);
    }

    fputs("\n  ],\n  \"components\": [", f);
    for (size_t i = 0; i < s->component_count; i++) {
        static const char *const fates[] = {"kept", "merged", "lost"};
        const lapd_component_row *row = &s->components[i];
        fprintf(f, "%s\n    {\"label\": %lld, \"fate\": \"%s\"", i > 0 ? "," : "",
                (long long)row->label, name_of(fates, 3, row->fate));
        json_position(f, row->position);
        json_count(f, ", ", "image_voxels", row->image_voxels);
        json_number(f, ", ", "image_volume", row->image_volume);
        json_count(f, ", ", "tets", row->tets);
        json_number(f, ", ", "mesh_volume", row->mesh_volume);
        json_count(f, ", ", "components_mesh", row->components_mesh);
        json_integer(f, ", ", "euler_image", row->euler_image);
        json_integer(f, ", ", "euler_mesh", row->euler_mesh);
        json_number(f, ", ", "hausdorff_mesh_to_image", row->mesh_to_image_max);
        json_number(f, ", ", "hausdorff_image_to_mesh", row->image_to_mesh_max);
        json_number(f, ", ", "mean_mesh_to_image", row->mesh_to_image_mean);
        json_number(f, ", ", "mean_image_to_mesh", row->image_to_mesh_mean);
        json_number(f, ", ", "hausdorff_mesh_to_surface", row->mesh_to_surface_max);
        json_number(f, ", ", "hausdorff_surface_to_mesh", row->surface_to_mesh_max);
        json_number(f, ", ", "mean_mesh_to_surface", row->mesh_to_surface_mean);
        json_number(f, ", ", "mean_surface_to_mesh", row->surface_to_mesh_mean);
        fputc('}', f);
    }

    fputs("\n  ],\n  \"defects\": [", f);
    for (size_t i = 0; i < s->defect_count; i++) {
        static const char *const kinds[DEFECT_KINDS] = {
            "lost", "merged", "torn", "stray", "non_manifold_edge", "non_manifold_vertex", "dropped"};
        const lapd_defect *defect = &s->defects[i];
        fprintf(f, "%s\n    {\"kind\": \"%s\", \"label\": %lld", i > 0 ? "," : "",
                name_of(kinds, DEFECT_KINDS, defect->kind), (long long)defect->label);
        json_position(f, defect->position);
        json_count(f, ", ", "size", defect->size);
        fputc('}', f);
    }
    fputs("\n  ]\n}\n", f);
}

/* Writes the report beside its place and moves it there, so that nobody ever reads half of one. */
bool save_report(const options *o, const lapd_params *params, const summary *s,
                 const file_seconds *seconds, const memory_use *memory) {
    size_t length = strlen(o->report) + 32;
    char *temporary = malloc(length);
    if (temporary == NULL) {
        complain("out of memory");
        return false;
    }
    snprintf(temporary, length, "%s.%ld.tmp", o->report, (long)getpid());
    FILE *file = fopen(temporary, "w");
    bool ok = file != NULL;
    if (ok) {
        write_json(file, o, params, s, seconds, memory);
        ok = !ferror(file);
        ok = fclose(file) == 0 && ok;
        ok = ok && rename(temporary, o->report) == 0;
    }
    if (!ok) {
        complain("%s: %s", o->report, strerror(errno));
        remove(temporary);
    }
    free(temporary);
    return ok;
}
