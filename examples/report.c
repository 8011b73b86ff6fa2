/* The report of mesh_image: a readable table, and what it adds to the library's JSON object. */
#define _POSIX_C_SOURCE 200809L

#include "report.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

enum { DEFECT_KINDS = LAPD_DEFECT_DROPPED + 1 };

/* ---- The table ---- */

lapd_status summarize(const lapd_mesh *mesh, summary *s) {
    s->counts.struct_size = sizeof s->counts;
    s->timings.struct_size = sizeof s->timings;
    s->quality.struct_size = sizeof s->quality;
    s->certificate.struct_size = sizeof s->certificate;
    s->improvement.struct_size = sizeof s->improvement;
    s->second_order.struct_size = sizeof s->second_order;
    s->all_threads.struct_size = sizeof s->all_threads;
    lapd_status status = lapd_mesh_get_counts(mesh, &s->counts);
    if (status == LAPD_OK)
        status = lapd_mesh_get_timings(mesh, &s->timings);
    if (status == LAPD_OK)
        status = lapd_mesh_get_improvement(mesh, &s->improvement);
    if (status == LAPD_OK)
        status = lapd_mesh_get_second_order(mesh, &s->second_order);
    if (status == LAPD_OK)
        status = lapd_mesh_get_thread_count(mesh, &s->thread_count);
    if (status == LAPD_OK)
        status = lapd_mesh_get_thread_report(mesh, LAPD_ALL_THREADS, &s->all_threads);
    if (status == LAPD_OK) {
        status = lapd_mesh_get_certificate(mesh, &s->certificate);
        if (status == LAPD_ERROR_NOT_MEASURED) {
            s->certificate.level = LAPD_CERTIFICATE_NONE;
            return LAPD_OK;
        }
    }
    if (status == LAPD_OK)
        status = lapd_mesh_get_quality(mesh, &s->quality);
    if (status == LAPD_OK)
        status = lapd_mesh_get_label_row_count(mesh, &s->row_count);
    if (status == LAPD_OK)
        status = lapd_mesh_get_defect_count(mesh, &s->defect_count);
    if (status != LAPD_OK) {
        return status;
    }
    s->rows = calloc(s->row_count + 1, sizeof *s->rows);
    s->defects = calloc(s->defect_count + 1, sizeof *s->defects);
    if (s->rows == NULL || s->defects == NULL) {
        return LAPD_ERROR_OUT_OF_MEMORY;
    }
    for (size_t i = 0; i < s->row_count && status == LAPD_OK; i++) {
        s->rows[i].struct_size = sizeof s->rows[i];
        status = lapd_mesh_get_label_row(mesh, i, &s->rows[i]);
    }
    for (size_t i = 0; i < s->defect_count && status == LAPD_OK; i++) {
        s->defects[i].struct_size = sizeof s->defects[i];
        status = lapd_mesh_get_defect(mesh, i, &s->defects[i]);
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

static void print_volume(const summary *s) {
    double mesh_volume = 0, image_volume = 0;
    for (size_t i = 0; i < s->row_count; i++) {
        mesh_volume += s->rows[i].mesh_volume;
        image_volume += s->rows[i].image_volume;
    }
    printf("volume               %12.6g  (image %.6g, %+.3f %%)\n", mesh_volume, image_volume,
           image_volume > 0 ? 100 * (mesh_volume / image_volume - 1) : 0);
}

static void print_quality(const lapd_quality *q) {
    printf("dihedral angles      %12.2f to %.2f degrees\n", q->min_dihedral, q->max_dihedral);
    printf("largest radius-edge  %12.3f\n", q->max_radius_edge);
    printf("scaled Jacobians     %12.3f to %.3f, edge ratio up to %.2f, radius ratio up to %.2f\n",
           q->min_scaled_jacobian, q->max_scaled_jacobian, q->max_edge_ratio, q->max_radius_ratio);
    printf("smallest facet angle %12.2f degrees\n", q->min_facet_angle);
}

static void print_angles(const lapd_quality *q) {
    enum { BAR = 40 };
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
}

static void print_labels(const lapd_mesh *mesh, const summary *s) {
    enum { WORST = 10 };
    lapd_label_row *worst = malloc((s->row_count + 1) * sizeof *worst);
    if (worst != NULL && s->row_count > 0) {
        memcpy(worst, s->rows, s->row_count * sizeof *worst);
        qsort(worst, s->row_count, sizeof *worst, by_volume_error);
        size_t shown = s->row_count < WORST ? s->row_count : WORST;
        printf("\n%zu labels%s\n", s->row_count,
               shown < s->row_count ? ", those with the largest volume error:" : "");
        printf("       label       tets       volume        image    error  parts (image)\n");
        for (size_t i = 0; i < shown; i++) {
            const char *name = NULL;
            lapd_mesh_get_label_name(mesh, (int32_t)worst[i].label, &name);
            printf("  %10lld %10llu %12.6g %12.6g %+7.2f%%  %llu (%llu)%s%s\n",
                   (long long)worst[i].label, (unsigned long long)worst[i].tets,
                   worst[i].mesh_volume, worst[i].image_volume, volume_error(&worst[i]),
                   (unsigned long long)worst[i].components_mesh,
                   (unsigned long long)worst[i].components_image, name != NULL ? "  " : "",
                   name != NULL ? name : "");
        }
    }
    free(worst);
}

static void print_improvement(const lapd_improvement *im) {
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
    if (im->tets_mended > 0) {
        printf("  tets that got another label, for the image's topology: %llu\n",
               (unsigned long long)im->tets_mended);
    }
    if (im->tets_before > 0) {
        printf("  coarsened from %llu tets: edges contracted %llu\n",
               (unsigned long long)im->tets_before, (unsigned long long)im->contractions);
    }
    if (im->facets_below > 0) {
        printf("  interface facets below the facet angle: %llu\n",
               (unsigned long long)im->facets_below);
    }
}

static void print_second_order(const lapd_second_order *so) {
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
}

static void print_certificate(const summary *s) {
    const lapd_certificate *c = &s->certificate;
    printf("\ncertificate\n");
    printf("  non-Delaunay facets %llu, inverted tets %llu, orphan vertices %llu, open edges %llu, "
           "facets off walls "
           "%llu\n",
           (unsigned long long)c->non_delaunay_facets, (unsigned long long)c->inverted_tets,
           (unsigned long long)c->orphan_vertices, (unsigned long long)c->open_edges,
           (unsigned long long)c->facets_off_walls);
    if (c->level >= LAPD_CERTIFICATE_FULL) {
        printf("  mesh to image: mean %.3f, largest %.3f; image to mesh: mean %.3f, largest %.3f\n",
               c->mesh_to_image_mean, c->mesh_to_image_max, c->image_to_mesh_mean,
               c->image_to_mesh_max);
        printf("  mesh to smooth surface: mean %.3f, largest %.3f; back: mean %.3f, largest %.3f\n",
               c->mesh_to_surface_mean, c->mesh_to_surface_max, c->surface_to_mesh_mean,
               c->surface_to_mesh_max);
    } else {
        printf("  distances: not measured (--certificate full)\n");
    }
    uint64_t defects[DEFECT_KINDS] = {0};
    for (size_t i = 0; i < s->defect_count; i++) {
        const int64_t kind = s->defects[i].kind;
        if (kind >= 0 && kind < DEFECT_KINDS) {
            defects[kind]++;
        }
    }
    printf("  components lost %llu, merged %llu, torn off %llu, stray %llu, left out %llu; "
           "non-manifold edges %llu, vertices %llu\n",
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
}

static void print_threads(const summary *s) {
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

void print_table(const lapd_mesh *mesh, const summary *s, const file_seconds *seconds) {
    const bool measured = s->certificate.level >= LAPD_CERTIFICATE_SOUND;
    printf("tets                 %12llu\n", (unsigned long long)s->counts.tissue_tets);
    printf("vertices             %12llu\n", (unsigned long long)s->counts.vertices);
    printf("interface facets     %12llu\n", (unsigned long long)s->counts.interface_facets);
    if (measured) {
        print_volume(s);
        print_quality(&s->quality);
    }
    printf("seconds              %12.2f  (read %.2f, prepare %.2f, refine %.2f, extract %.2f, "
           "improve %.2f, "
           "certify %.2f, write %.2f)\n",
           seconds->total, seconds->read, s->timings.prepare, s->timings.refine, s->timings.extract,
           s->timings.improve, s->timings.certify, seconds->write);
    if (measured) {
        print_angles(&s->quality);
        print_labels(mesh, s);
    }
    print_improvement(&s->improvement);
    print_second_order(&s->second_order);
    if (measured) {
        print_certificate(s);
    } else {
        printf("\nnothing was measured (--certificate sound, full)\n");
    }
    print_threads(s);
}

/* ---- The JSON report ---- */

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

/* The names of files may have quotes and backslashes. */
static void json_string(FILE *file, const char *text) {
    fputc('"', file);
    for (const unsigned char *s = (const unsigned char *)text; *s != '\0'; s++) {
        if (*s == '"' || *s == '\\') {
            fprintf(file, "\\%c", *s);
        } else if (*s < 0x20) {
            fprintf(file, "\\u%04x", *s);
        } else {
            fputc(*s, file);
        }
    }
    fputc('"', file);
}

lapd_status save_report(lapd_context *context, const lapd_mesh *mesh, const options *o,
                        const file_seconds *seconds, const memory_use *memory) {
    /* What the library cannot know; it writes all else. */
    char *extra = NULL;
    size_t length = 0;
    FILE *f = open_memstream(&extra, &length);
    if (f == NULL) {
        return LAPD_ERROR_OUT_OF_MEMORY;
    }
    fputs("{\"input\": ", f);
    json_string(f, o->inputs[0]);
    fprintf(f, ", \"peak_rss_bytes\": %llu", (unsigned long long)peak_memory());
    if (memory != NULL) {
        fprintf(
            f,
            ", \"memory_bytes\": {\"read\": %llu, \"peak_prepare\": %llu, \"peak_refine\": %llu, "
            "\"peak_extract\": %llu, \"peak_improve\": %llu}",
            (unsigned long long)memory->read, (unsigned long long)memory->peak[LAPD_PHASE_PREPARE],
            (unsigned long long)memory->peak[LAPD_PHASE_REFINE],
            (unsigned long long)memory->peak[LAPD_PHASE_EXTRACT],
            (unsigned long long)memory->peak[LAPD_PHASE_IMPROVE]);
    }
    fprintf(f, ", \"seconds\": {\"read\": %.9g, \"write\": %.9g, \"total\": %.9g}}", seconds->read,
            seconds->write, seconds->total);
    lapd_status status = fclose(f) == 0 ? LAPD_OK : LAPD_ERROR_OUT_OF_MEMORY;
    if (status == LAPD_OK) {
        status = lapd_mesh_write_report(context, mesh, o->report, extra);
    }
    free(extra);
    return status;
}
