/*
 * lapd: quality tetrahedral Delaunay meshes of segmented 3D images, all tissues at once.
 * SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * Made by cbindgen from src/capi; do not edit.
 *
 * Conventions
 * - Handles (lapd_context, lapd_image, lapd_params, lapd_write_options, lapd_mesh) are
 *   opaque. What a create, read or mesh function hands out belongs to the caller, who frees it once
 *   with the lapd_..._free function of its type.
 * - Functions return a lapd_status; 0 is success. Out-parameters are written on success only, but
 *   for a partial mesh that was asked for, which comes with the status of the limit.
 * - A function that takes a context leaves one line there about what went wrong:
 *   lapd_context_last_error. Functions without one fail only for their own arguments, which the
 *   status tells. There is no global state.
 * - NULL is refused with LAPD_ERROR_INVALID_ARGUMENT wherever the text does not allow it; so are
 *   numbers that are no value of their enum, which is why enums are passed as int32_t.
 * - Strings are UTF-8 and end with NUL. Lengths are in the world units of the image, angles in
 *   degrees.
 * - Structs with a struct_size may grow at their end: set it to sizeof before the call, and
 *   programs and libraries of different versions understand each other. What the library does not
 *   know yet reads 0.
 * - Images change only when their labels are named, meshes only by lapd_mesh_certify and
 *   lapd_mesh_split_interfaces; otherwise any number of threads may use them at once. Parameters
 *   and write options may be read by many threads as long as none changes them. A context belongs
 *   to one thread at a time, but for lapd_context_cancel.
 * - The library prints nothing, reads no environment, installs no signal handler, and does not
 *   end the process: memory that the system refuses is LAPD_ERROR_OUT_OF_MEMORY, in every call of
 *   the process that works at that moment.
 */

#ifndef LAPD_H
#define LAPD_H

#include <stddef.h>
#include <stdint.h>

/* The version of this header; lapd_version() is that of the library. */
#define LAPD_VERSION_MAJOR 0
#define LAPD_VERSION_MINOR 1
#define LAPD_VERSION_PATCH 0
#define LAPD_VERSION "0.1.0"

/**
 * Most threads of a run.
 */
#define LAPD_MAX_THREADS 254

/**
 * "No tet", among the neighbours of a tet and beside a facet.
 */
#define LAPD_NO_TET UINT32_MAX

/**
 * "Not counted", as one of the counts of lapd_certificate that say so.
 */
#define LAPD_NOT_COUNTED (uint64_t)-1ll

/**
 * "The sum of all threads", as the number of a thread.
 */
#define LAPD_ALL_THREADS ((size_t)-1)

/**
 * Components of the image with fewer voxels have no row of their own, and are not listed when they
 * are lost or merged.
 */
#define LAPD_MIN_COMPONENT_VOXELS 8

/**
 * What a function came to. The numbers are stable: none will ever change its meaning, new ones may
 * be added. 0 is success.
 */
typedef enum {
  /**
   * The function did what it says.
   */
  LAPD_OK = 0,
  /**
   * An argument is NULL, out of its range, or not a value of its enum.
   */
  LAPD_ERROR_INVALID_ARGUMENT = 1,
  /**
   * The value exists in this interface, but not yet in this version of the library, in this
   * build, or on this system.
   */
  LAPD_ERROR_UNSUPPORTED = 2,
  /**
   * A file could not be opened, read or written.
   */
  LAPD_ERROR_IO = 3,
  /**
   * A file was read, but it holds no valid image of its format, or uses what this version does
   * not read.
   */
  LAPD_ERROR_FORMAT = 4,
  /**
   * The image holds no label to mesh.
   */
  LAPD_ERROR_EMPTY_IMAGE = 5,
  /**
   * The caller's limit of vertices was reached, or one of the library's own: that of the ids, or
   * of what a file format can number.
   */
  LAPD_ERROR_LIMIT_REACHED = 6,
  /**
   * The run was cancelled by its progress callback or by lapd_context_cancel.
   */
  LAPD_ERROR_CANCELLED = 7,
  /**
   * Memory could not be had.
   */
  LAPD_ERROR_OUT_OF_MEMORY = 8,
  /**
   * An invariant of the library broke. This is a bug of lapd, please report it.
   */
  LAPD_ERROR_INTERNAL = 9,
  /**
   * The caller's buffer is too small for the copy. Nothing was written.
   */
  LAPD_ERROR_BUFFER_TOO_SMALL = 10,
  /**
   * The context is in use by a run that has not returned yet.
   */
  LAPD_ERROR_BUSY = 11,
  /**
   * The caller's limit of time was reached.
   */
  LAPD_ERROR_TIME_LIMIT = 12,
  /**
   * The caller's limit of memory was reached.
   */
  LAPD_ERROR_MEMORY_LIMIT = 13,
  /**
   * The mesh has no certificate: nothing was measured on it.
   */
  LAPD_ERROR_NOT_MEASURED = 14,
} lapd_status;

/**
 * The phases of a run, in their order. More may be added in between, with numbers of their own.
 */
typedef enum {
  /**
   * The image is prepared: volumes and weights of the labels, where the interfaces are.
   */
  LAPD_PHASE_PREPARE = 0,
  /**
   * Delaunay refinement.
   */
  LAPD_PHASE_REFINE = 1,
  /**
   * The mesh is collected, and the triangulation checked.
   */
  LAPD_PHASE_EXTRACT = 2,
  /**
   * Slivers are removed.
   */
  LAPD_PHASE_IMPROVE = 3,
  /**
   * Quality and certificate are measured.
   */
  LAPD_PHASE_CERTIFY = 4,
  /**
   * An image is read from files: before all others, in a call of its own.
   */
  LAPD_PHASE_READ = 5,
} lapd_phase;

/**
 * How much a log line matters.
 */
typedef enum {
  /**
   * The result may not be what the caller expects.
   */
  LAPD_LOG_WARNING = 0,
  /**
   * What the library does.
   */
  LAPD_LOG_INFO = 1,
} lapd_log_level;

/**
 * Type of the voxels in a caller's buffer.
 */
typedef enum {
  /**
   * uint8_t
   */
  LAPD_VOXEL_U8 = 0,
  /**
   * int8_t
   */
  LAPD_VOXEL_I8 = 1,
  /**
   * uint16_t
   */
  LAPD_VOXEL_U16 = 2,
  /**
   * int16_t
   */
  LAPD_VOXEL_I16 = 3,
  /**
   * uint32_t; labels must fit int32_t
   */
  LAPD_VOXEL_U32 = 4,
  /**
   * int32_t
   */
  LAPD_VOXEL_I32 = 5,
  /**
   * uint64_t; labels must fit int32_t
   */
  LAPD_VOXEL_U64 = 6,
  /**
   * int64_t; labels must fit int32_t
   */
  LAPD_VOXEL_I64 = 7,
} lapd_voxel_type;

/**
 * The frame of world coordinates that an image from a file, and so its mesh, is to have. LPS and
 * RAS differ by a half turn about z: x and y change their signs.
 */
typedef enum {
  /**
   * Coordinates as the file gives them: RAS for NIfTI, LPS for MetaImage, what `space` says for
   * NRRD; INRIMAGE does not say.
   */
  LAPD_WORLD_AS_STORED = 0,
  /**
   * x, y, z grow towards the patient's left, posterior, superior: DICOM, ITK.
   */
  LAPD_WORLD_LPS = 1,
  /**
   * x, y, z grow towards the patient's right, anterior, superior: NIfTI, 3D Slicer.
   */
  LAPD_WORLD_RAS = 2,
} lapd_world_frame;

/**
 * What becomes of voxels of a label image that are no whole numbers. Those within 1e-3 of one are
 * always rounded, with a warning.
 */
typedef enum {
  /**
   * They are refused: the file may be no label image.
   */
  LAPD_LABELS_WHOLE = 0,
  /**
   * They are rounded, with a warning.
   */
  LAPD_LABELS_ROUNDED = 1,
  /**
   * Each distinct value becomes a label, those of 64-bit integers, too: 0 stays 0, the others
   * become 1, 2, ... in increasing order. lapd_image_get_value tells which is which.
   */
  LAPD_LABELS_DISTINCT = 2,
} lapd_label_values;

/**
 * What the world axes of an image mean in the patient.
 */
typedef enum {
  /**
   * The image comes from memory, or from a file that does not say.
   */
  LAPD_AXES_UNKNOWN = 0,
  /**
   * Left, posterior, superior.
   */
  LAPD_AXES_LPS = 1,
  /**
   * Right, anterior, superior.
   */
  LAPD_AXES_RAS = 2,
  /**
   * Left, anterior, superior: some NRRD files, as stored.
   */
  LAPD_AXES_LAS = 3,
} lapd_world_axes;

/**
 * A face of the image's box; x, y, z are the axes of the image, and MIN is the face of the voxels
 * with the smallest indices.
 */
typedef enum {
  /**
   * None of them.
   */
  LAPD_WALL_NONE = 0,
  /**
   * In front of the first voxels along x.
   */
  LAPD_WALL_X_MIN = 1,
  /**
   * Behind the last voxels along x.
   */
  LAPD_WALL_X_MAX = 2,
  /**
   * In front of the first voxels along y.
   */
  LAPD_WALL_Y_MIN = 3,
  /**
   * Behind the last voxels along y.
   */
  LAPD_WALL_Y_MAX = 4,
  /**
   * In front of the first voxels along z.
   */
  LAPD_WALL_Z_MIN = 5,
  /**
   * Behind the last voxels along z.
   */
  LAPD_WALL_Z_MAX = 6,
} lapd_wall;

/**
 * How labels between voxel centres are decided.
 */
typedef enum {
  /**
   * The label whose indicator, interpolated trilinearly, is largest; of images made of
   * intensities or probabilities, these are interpolated. The default.
   */
  LAPD_SURFACE_SMOOTH = 0,
  /**
   * The label of the nearest voxel: interfaces are voxel faces.
   */
  LAPD_SURFACE_VOXEL = 1,
} lapd_surface;

/**
 * How the object is closed where it reaches the border of the image.
 */
typedef enum {
  /**
   * By flat walls with sharp edges, the outer faces of the outermost voxels. The default.
   */
  LAPD_BORDER_FLAT = 0,
  /**
   * By the smooth surface, as if one more layer of background lay around the image. With
   * LAPD_SURFACE_VOXEL the same as LAPD_BORDER_FLAT.
   */
  LAPD_BORDER_SMOOTH = 1,
} lapd_border;

/**
 * How the work is shared by threads.
 */
typedef enum {
  /**
   * Speculative refinement of one triangulation by all threads, each where it comes to. The
   * default.
   */
  LAPD_ALGORITHM_PODM = 0,
  /**
   * The same, with a region for the threads of each memory node, whose memory they visit most of
   * the time. On a machine of one memory node the same as LAPD_ALGORITHM_PODM.
   */
  LAPD_ALGORITHM_LAPD = 1,
} lapd_algorithm;

/**
 * What a thread does after it met another one: it needed a vertex that the other one was using,
 * and has given its operation up.
 */
typedef enum {
  /**
   * It waits until the thread that it met has made some progress, unless that one waits itself.
   * The default.
   */
  LAPD_CONTENTION_LOCAL = 0,
  /**
   * It waits, in one list for all threads, until others have made some progress; the last one
   * that works never waits.
   */
  LAPD_CONTENTION_GLOBAL = 1,
  /**
   * After some conflicts in sequence it waits for a random time.
   */
  LAPD_CONTENTION_RANDOM = 2,
  /**
   * It goes on at once.
   */
  LAPD_CONTENTION_AGGRESSIVE = 3,
} lapd_contention;

/**
 * Whom a thread without work asks for some first.
 */
typedef enum {
  /**
   * The threads of its own cache, then those of its processor, then those of the machine. The
   * default.
   */
  LAPD_BEGGING_BY_LEVEL = 0,
  /**
   * All threads alike.
   */
  LAPD_BEGGING_FLAT = 1,
} lapd_begging;

/**
 * What the mesh made of a component of the image.
 */
typedef enum {
  /**
   * A component of the mesh stands for it.
   */
  LAPD_FATE_KEPT = 0,
  /**
   * It is part of a component of the mesh that stands for another one.
   */
  LAPD_FATE_MERGED = 1,
  /**
   * No tet of its label lies in it.
   */
  LAPD_FATE_LOST = 2,
} lapd_fate;

/**
 * What is wrong with the topology of a label somewhere.
 */
typedef enum {
  /**
   * A component of the image, of LAPD_MIN_COMPONENT_VOXELS or more, in which no tet of its label
   * lies.
   */
  LAPD_DEFECT_LOST = 0,
  /**
   * A component of the image, of LAPD_MIN_COMPONENT_VOXELS or more, that the mesh has joined to
   * another one of its label.
   */
  LAPD_DEFECT_MERGED = 1,
  /**
   * A component of the mesh that is torn off from the one that stands for its component of the
   * image.
   */
  LAPD_DEFECT_TORN = 2,
  /**
   * A component of the mesh that lies in no component of its label.
   */
  LAPD_DEFECT_STRAY = 3,
  /**
   * An edge at which more than two facets of the label's boundary meet.
   */
  LAPD_DEFECT_NON_MANIFOLD_EDGE = 4,
  /**
   * A vertex, on no such edge, at which more than one sheet of the label's boundary meet.
   */
  LAPD_DEFECT_NON_MANIFOLD_VERTEX = 5,
  /**
   * A component of the image that was left out for its size, as asked
   * (lapd_params_set_min_voxels).
   */
  LAPD_DEFECT_DROPPED = 6,
} lapd_defect_kind;

/**
 * What may be changed to remove slivers from the refined mesh.
 */
typedef enum {
  /**
   * Nothing: the mesh is Delaunay, as refinement leaves it, and has slivers.
   */
  LAPD_IMPROVE_NONE = 0,
  /**
   * What lies inside of the labels. Their interfaces stay bit for bit as refinement leaves them.
   */
  LAPD_IMPROVE_INTERIOR = 1,
  /**
   * Interfaces, too: edges on them are flipped, and vertices move along what they belong to. The
   * default.
   */
  LAPD_IMPROVE_FULL = 2,
} lapd_improve;

/**
 * What is sampled more densely than lapd_params_set_delta says, and its surroundings too, ever
 * less so farther away.
 */
typedef enum {
  /**
   * Nothing: structures that are thinner than samples are apart may tear.
   */
  LAPD_ADAPTIVE_OFF = 0,
  /**
   * Components and layers of a label that are thinner than 4/3 of the distance of samples. What
   * holds cubes of 32 times the smallest side of a voxel is never thin.
   */
  LAPD_ADAPTIVE_THICKNESS = 1,
  /**
   * Places where the mesh turns out to differ from the image in what is connected: where labels
   * are torn, merged, or have a hole too many or too few, or where it ends before a wall that
   * the object reaches. Far fewer elements where samples are farther apart than structures are
   * thick. Holes that are left although samples are close get mended with LAPD_IMPROVE_FULL: a
   * few tets get another label. The default.
   */
  LAPD_ADAPTIVE_TOPOLOGY = 2,
} lapd_adaptive;

/**
 * What is measured on the finished mesh.
 */
typedef enum {
  /**
   * Nothing. Functions that tell of it return LAPD_ERROR_NOT_MEASURED.
   */
  LAPD_CERTIFICATE_NONE = 0,
  /**
   * All that is exact, and the shapes of tets: Delaunay and orientation, closed interfaces,
   * rules that stay unmet, volumes, components with what became of them, Euler numbers, defects,
   * quality. The default.
   */
  LAPD_CERTIFICATE_SOUND = 1,
  /**
   * That, and the distances between mesh and image, in both directions, which take about half
   * as long as the refinement.
   */
  LAPD_CERTIFICATE_FULL = 2,
} lapd_certificate_level;

/**
 * Why a tet is left: the first of these that one of its vertices belongs to.
 */
typedef enum {
  /**
   * Voxels of a label that touch in an edge or a corner, within a voxel.
   */
  LAPD_LEFT_CONTACT = 0,
  /**
   * A wall, where the image cuts the object off.
   */
  LAPD_LEFT_WALL = 1,
  /**
   * A line or corner where three labels or more meet.
   */
  LAPD_LEFT_JUNCTION = 2,
  /**
   * An interface between two labels.
   */
  LAPD_LEFT_INTERFACE = 3,
  /**
   * None of these: all vertices are inside of the label.
   */
  LAPD_LEFT_INSIDE = 4,
} lapd_left_cause;

/**
 * A measure that each tet has a value of. But for the last, they are those of Verdict and VTK.
 */
typedef enum {
  /**
   * The smallest dihedral angle, degrees.
   */
  LAPD_MEASURE_MIN_DIHEDRAL = 0,
  /**
   * The largest dihedral angle, degrees.
   */
  LAPD_MEASURE_MAX_DIHEDRAL = 1,
  /**
   * The Jacobian over the largest product of the three edges of a vertex, times the root of 2: 1
   * for a regular tet, 0 for a flat one.
   */
  LAPD_MEASURE_SCALED_JACOBIAN = 2,
  /**
   * The longest edge over the shortest one: 1 for a regular tet.
   */
  LAPD_MEASURE_EDGE_RATIO = 3,
  /**
   * The circumradius over three times the inradius: 1 for a regular tet.
   */
  LAPD_MEASURE_RADIUS_RATIO = 4,
  /**
   * The circumradius over the shortest edge, which Delaunay refinement bounds: 0.61 for a
   * regular tet.
   */
  LAPD_MEASURE_RADIUS_EDGE = 5,
} lapd_tet_measure;

/**
 * What a call reports to. Holds the message of the last call that failed, the callbacks for
 * progress and log lines, and the cancel flag.
 *
 * Use one context per thread that makes calls. Only lapd_context_cancel may be called while
 * another thread uses the context.
 */
typedef struct lapd_context lapd_context;

/**
 * A label image: a grid of integer labels, and its place in the world. Label 0 is the background.
 * Its voxels never change after it was made, so any number of threads may use it at once, unless
 * one names its labels.
 */
typedef struct lapd_image lapd_image;

/**
 * A finished tetrahedral mesh in world coordinates, with its report. Nothing but
 * lapd_mesh_certify and lapd_mesh_split_interfaces changes it after it was made, so any number of
 * threads may use it at once.
 *
 * Every tet (a, b, c, d) has (b - a) x (c - a) . (d - a) > 0, as in VTK; facet i of a tet is the
 * one opposite to its vertex i.
 */
typedef struct lapd_mesh lapd_mesh;

/**
 * Parameters of a run, with defaults for all. Not to be changed while another thread uses them; a
 * run takes a copy.
 */
typedef struct lapd_params lapd_params;

/**
 * How a file of a mesh is written: lapd_mesh_write_with.
 */
typedef struct lapd_write_options lapd_write_options;

/**
 * One report of progress. Later versions may append fields.
 */
typedef struct {
  /**
   * The phase, a lapd_phase.
   */
  int32_t phase;
  /**
   * Part of the call's work that is done, 0 to 1: an estimate that never decreases.
   */
  double fraction;
  /**
   * Tets of the triangulation so far, those outside of the object included.
   */
  uint64_t tets;
} lapd_progress;

/**
 * Receives progress on the thread that called lapd_mesh_image, or a function that reads an image.
 * Returns 0 to go on, anything else to cancel the call. `progress` is valid during the call only.
 * Must not throw, nor leave by longjmp; must not free the context.
 */
typedef int32_t (*lapd_progress_fn)(void *user, const lapd_progress *progress);

/**
 * Receives a log line (UTF-8, without a line end) of a lapd_log_level, on the thread that made the
 * call. `message` is valid during the call only. Must not throw, nor leave by longjmp; must not
 * free the context.
 */
typedef void (*lapd_log_fn)(void *user, int32_t level, const char *message);

/**
 * How large a mesh is. Set struct_size to sizeof(lapd_counts) before the call.
 */
typedef struct {
  /**
   * sizeof(lapd_counts), set by the caller.
   */
  uint64_t struct_size;
  /**
   * Vertices of the mesh.
   */
  uint64_t vertices;
  /**
   * Tets of the mesh, the background included where it was kept.
   */
  uint64_t tets;
  /**
   * Tets of the mesh with a label other than 0.
   */
  uint64_t tissue_tets;
  /**
   * Facets between two labels.
   */
  uint64_t interface_facets;
  /**
   * Vertices of the whole triangulation, when refinement ended, the corners of the box around it
   * included.
   */
  uint64_t all_vertices;
  /**
   * Tets of the whole triangulation, when refinement ended.
   */
  uint64_t all_tets;
  /**
   * Bytes of what refinement keeps of the image: labels, and where interfaces are.
   */
  uint64_t oracle_bytes;
} lapd_counts;

/**
 * Wall-clock seconds of the phases of a run. Set struct_size to sizeof(lapd_timings) before the
 * call.
 */
typedef struct {
  /**
   * sizeof(lapd_timings), set by the caller.
   */
  uint64_t struct_size;
  /**
   * Preparing the image: volumes and weights of the labels, where the interfaces are.
   */
  double prepare;
  /**
   * From there to the last rule satisfied.
   */
  double refine;
  /**
   * Collecting the mesh, and giving back the memory of the triangulation.
   */
  double extract;
  /**
   * Measuring quality and certificate.
   */
  double certify;
  /**
   * Removing slivers.
   */
  double improve;
} lapd_timings;

/**
 * What refinement did, all threads together. Set struct_size to sizeof(lapd_operations) before the
 * call.
 */
typedef struct {
  /**
   * sizeof(lapd_operations), set by the caller.
   */
  uint64_t struct_size;
  /**
   * Vertices inserted.
   */
  uint64_t insertions;
  /**
   * Vertices removed.
   */
  uint64_t removals;
  /**
   * Operations given up because of a conflict with another thread: 0 with 1 thread.
   * lapd_thread_report has more about them.
   */
  uint64_t rollbacks;
  /**
   * Predicates that floating point could not decide.
   */
  uint64_t exact_predicates;
  /**
   * In-sphere tests of insertions.
   */
  uint64_t in_sphere_tests;
  /**
   * Tets created, living or not.
   */
  uint64_t tets_created;
  /**
   * Tets that insertions destroyed: the tets of all cavities.
   */
  uint64_t cavity_tets;
  /**
   * Tets that the rules were asked of.
   */
  uint64_t inspections;
  /**
   * Labels of points that the rules asked for.
   */
  uint64_t label_lookups;
  /**
   * Crossings of segments with the interfaces that the rules asked for.
   */
  uint64_t crossing_lookups;
  /**
   * Vertices that each of rules R1 to R5 inserted, and those that R6 removed, in this order.
   */
  uint64_t by_rule[6];
} lapd_operations;

/**
 * Shape of the tets with a label other than 0, and of the interface facets. Set struct_size to
 * sizeof(lapd_quality) before the call.
 */
typedef struct {
  /**
   * sizeof(lapd_quality), set by the caller.
   */
  uint64_t struct_size;
  /**
   * Smallest dihedral angle, degrees.
   */
  double min_dihedral;
  /**
   * Largest dihedral angle, degrees.
   */
  double max_dihedral;
  /**
   * Largest ratio of circumradius to shortest edge.
   */
  double max_radius_edge;
  /**
   * Smallest planar angle of interface facets, degrees.
   */
  double min_facet_angle;
  /**
   * Dihedral angles, six for each tet, in bins of 10 degrees.
   */
  uint64_t dihedral_histogram[18];
  /**
   * Least scaled Jacobian: 1 for a regular tet, 0 for a flat one. This and the measures below
   * are those of Verdict and VTK.
   */
  double min_scaled_jacobian;
  /**
   * Largest scaled Jacobian.
   */
  double max_scaled_jacobian;
  /**
   * Scaled Jacobians in bins of 1/20 from 0 on.
   */
  uint64_t scaled_jacobian_histogram[20];
  /**
   * Least ratio of longest to shortest edge; 1 for a regular tet.
   */
  double min_edge_ratio;
  /**
   * Largest ratio of longest to shortest edge.
   */
  double max_edge_ratio;
  /**
   * Edge ratios in bins of 1/4 from 1 on; the last one has all beyond, too.
   */
  uint64_t edge_ratio_histogram[20];
  /**
   * Least ratio of circumradius to three inradii; 1 for a regular tet.
   */
  double min_radius_ratio;
  /**
   * Largest ratio of circumradius to three inradii; infinite with a flat tet.
   */
  double max_radius_ratio;
  /**
   * Radius ratios in bins of 1/4 from 1 on; the last one has all beyond, too.
   */
  uint64_t radius_ratio_histogram[20];
} lapd_quality;

/**
 * What was checked on the finished mesh. Set struct_size to sizeof(lapd_certificate) before the
 * call. Lengths are in world units.
 */
typedef struct {
  /**
   * sizeof(lapd_certificate), set by the caller.
   */
  uint64_t struct_size;
  /**
   * Facets with a vertex of a neighbour inside the circumsphere, by exact arithmetic, as
   * refinement left the mesh: 0, as that is Delaunay. lapd_improvement tells of the mesh without
   * slivers. LAPD_NOT_COUNTED where the run had no certificate and the mesh was improved since.
   * In a mesh that lapd_mesh_from_arrays made, those of that mesh.
   */
  uint64_t non_delaunay_facets;
  /**
   * Tets without positive volume, by exact arithmetic.
   */
  uint64_t inverted_tets;
  /**
   * Vertices of no tet.
   */
  uint64_t orphan_vertices;
  /**
   * Edges where an interface is open.
   */
  uint64_t open_edges;
  /**
   * What stayed unmet of rules R1 to R6, in this order; LAPD_NOT_COUNTED where the run had no
   * certificate, and in a mesh that lapd_mesh_from_arrays made.
   */
  uint64_t unmet[6];
  /**
   * Mean distance from the mesh's interfaces to those of the image.
   */
  double mesh_to_image_mean;
  /**
   * Largest distance from the mesh's interfaces to those of the image, to within a hundredth of
   * the smallest spacing.
   */
  double mesh_to_image_max;
  /**
   * Mean distance from the image's interfaces to those of the mesh.
   */
  double image_to_mesh_mean;
  /**
   * Largest distance from the image's interfaces to those of the mesh.
   */
  double image_to_mesh_max;
  /**
   * Mean distance from the mesh's interfaces to the smooth ones: from the centroids of facets
   * along their normals, two largest spacings at most.
   */
  double mesh_to_surface_mean;
  /**
   * The largest such distance.
   */
  double mesh_to_surface_max;
  /**
   * Mean distance from the smooth interfaces, where they cross the edges between voxel centres,
   * to those of the mesh.
   */
  double surface_to_mesh_mean;
  /**
   * The largest such distance.
   */
  double surface_to_mesh_max;
  /**
   * Outer facets that should lie on a wall, a face of the image's box where it cuts the object
   * off, and do not.
   */
  uint64_t facets_off_walls;
  /**
   * Components of the image, of fewer than LAPD_MIN_COMPONENT_VOXELS, in which the mesh has no
   * tet.
   */
  uint64_t small_components_lost;
  /**
   * The world position of the first voxel of the first of these; 0 without any.
   */
  double small_component_lost_at[3];
  /**
   * What was measured, a lapd_certificate_level: LAPD_CERTIFICATE_SOUND or more. Without
   * LAPD_CERTIFICATE_FULL all distances are NaN.
   */
  int64_t level;
} lapd_certificate;

/**
 * What one thread of the refinement did, and with what it lost time. Set struct_size to
 * sizeof(lapd_thread_report) before the call.
 *
 * Of the seconds that refinement took (lapd_timings) a thread worked those that it did not lose.
 * With 1 thread none are lost.
 */
typedef struct {
  /**
   * sizeof(lapd_thread_report), set by the caller.
   */
  uint64_t struct_size;
  /**
   * Vertices inserted.
   */
  uint64_t insertions;
  /**
   * Vertices removed.
   */
  uint64_t removals;
  /**
   * Tets created, living or not.
   */
  uint64_t tets_created;
  /**
   * Operations given up because another thread was using a vertex.
   */
  uint64_t rollbacks;
  /**
   * Of these, the insertions for each of rules R1 to R5, and the removals for R6, in this order.
   */
  uint64_t rollbacks_by_rule[6];
  /**
   * Operations given up because another thread had changed the place before it was locked.
   */
  uint64_t stale;
  /**
   * Seconds spent in operations that were given up.
   */
  double rollback_seconds;
  /**
   * Seconds spent waiting after conflicts.
   */
  double contention_seconds;
  /**
   * Seconds spent without work.
   */
  double idle_seconds;
  /**
   * How often the thread waited after a conflict.
   */
  uint64_t waits;
  /**
   * How often it asked others for work.
   */
  uint64_t begs;
  /**
   * How often it gave work to another thread.
   */
  uint64_t gifts;
  /**
   * Tets and vertices that its operations visited in the memory of its own node; 0 where
   * accesses were not counted (lapd_params_set_count_accesses).
   */
  uint64_t local_accesses;
  /**
   * Those that they visited in the memory of other nodes.
   */
  uint64_t remote_accesses;
  /**
   * The hops to other nodes' memory, summed up over all accesses.
   */
  uint64_t access_hops;
} lapd_thread_report;

/**
 * One label, mesh against image. Set struct_size to sizeof(lapd_label_row) before the call.
 * Volumes are in cubic world units. Distances are NaN unless the certificate has the level
 * LAPD_CERTIFICATE_FULL.
 */
typedef struct {
  /**
   * sizeof(lapd_label_row), set by the caller.
   */
  uint64_t struct_size;
  /**
   * The label.
   */
  int64_t label;
  /**
   * Its tets.
   */
  uint64_t tets;
  /**
   * Their volume.
   */
  double mesh_volume;
  /**
   * The volume of its voxels.
   */
  double image_volume;
  /**
   * Its voxels.
   */
  uint64_t image_voxels;
  /**
   * Connected components of its voxels, joined with all 26 around them.
   */
  uint64_t components_image;
  /**
   * Connected components of its tets, joined where they share a facet, an edge or a vertex.
   */
  uint64_t components_mesh;
  /**
   * Components of the image, of LAPD_MIN_COMPONENT_VOXELS or more, in which it has no tet.
   */
  uint64_t components_lost;
  /**
   * Components of the image, of LAPD_MIN_COMPONENT_VOXELS or more, that the mesh has joined to
   * another one.
   */
  uint64_t components_merged;
  /**
   * Components of the mesh that are torn off from the one they belong to, or lie in none of the
   * image.
   */
  uint64_t pieces;
  /**
   * Euler characteristic of its boundary in the image, whose voxels are joined with all 26
   * around them.
   */
  int64_t euler_image;
  /**
   * Euler characteristic of its boundary in the mesh, of a surface just inside: 2 for a ball, 0
   * for a torus, added up over all parts.
   */
  int64_t euler_mesh;
  /**
   * Edges at which more than two facets of its boundary meet.
   */
  uint64_t non_manifold_edges;
  /**
   * Vertices, on no such edge, at which more than one sheet of its boundary meet.
   */
  uint64_t non_manifold_vertices;
  /**
   * Mean distance from its boundary in the mesh to that in the image.
   */
  double mesh_to_image_mean;
  /**
   * Largest distance from its boundary in the mesh to that in the image.
   */
  double mesh_to_image_max;
  /**
   * Mean distance from its boundary in the image to that in the mesh; infinite when it has no
   * tet.
   */
  double image_to_mesh_mean;
  /**
   * Largest distance from its boundary in the image to that in the mesh; infinite when it has no
   * tet.
   */
  double image_to_mesh_max;
  /**
   * Mean distance from its boundary in the mesh to the smooth interfaces.
   */
  double mesh_to_surface_mean;
  /**
   * Largest distance from its boundary in the mesh to the smooth interfaces.
   */
  double mesh_to_surface_max;
  /**
   * Mean distance from the smooth interfaces around it to its boundary in the mesh; infinite
   * when it has no tet.
   */
  double surface_to_mesh_mean;
  /**
   * Largest distance from the smooth interfaces around it to its boundary in the mesh; infinite
   * when it has no tet.
   */
  double surface_to_mesh_max;
  /**
   * By how much its volume grew when slivers were removed.
   */
  double volume_change;
} lapd_label_row;

/**
 * One component of the image that has LAPD_MIN_COMPONENT_VOXELS or more. Set struct_size to
 * sizeof(lapd_component_row) before the call.
 *
 * Voxels are joined with all 26 around them, tets where they share a facet, an edge or a vertex.
 * Volumes are in cubic world units, positions and distances in world units. Distances are NaN
 * unless the certificate has the level LAPD_CERTIFICATE_FULL.
 */
typedef struct {
  /**
   * sizeof(lapd_component_row), set by the caller.
   */
  uint64_t struct_size;
  /**
   * Its label.
   */
  int64_t label;
  /**
   * What became of it, a lapd_fate.
   */
  int64_t fate;
  /**
   * The centre of its first voxel, x fastest.
   */
  double position[3];
  /**
   * Its voxels.
   */
  uint64_t image_voxels;
  /**
   * Their volume.
   */
  double image_volume;
  /**
   * Tets of its label that lie in it.
   */
  uint64_t tets;
  /**
   * Their volume.
   */
  double mesh_volume;
  /**
   * Components of the mesh that belong to it: 1 where all is well, 0 where it is lost or merged.
   */
  uint64_t components_mesh;
  /**
   * Euler characteristic of its boundary.
   */
  int64_t euler_image;
  /**
   * That of the components of the mesh that belong to it, of a surface just inside, added up.
   */
  int64_t euler_mesh;
  /**
   * Mean distance from the boundary of the components of the mesh that belong to it to that of
   * its label in the image.
   */
  double mesh_to_image_mean;
  /**
   * The largest such distance.
   */
  double mesh_to_image_max;
  /**
   * Mean distance from its boundary to that of its label in the mesh; infinite when the label
   * has no tet.
   */
  double image_to_mesh_mean;
  /**
   * The largest such distance.
   */
  double image_to_mesh_max;
  /**
   * Mean distance from the boundary of the components of the mesh that belong to it to the
   * smooth interfaces.
   */
  double mesh_to_surface_mean;
  /**
   * The largest such distance.
   */
  double mesh_to_surface_max;
  /**
   * Mean distance from the smooth interfaces around it to its label's boundary in the mesh;
   * infinite when the label has no tet.
   */
  double surface_to_mesh_mean;
  /**
   * The largest such distance.
   */
  double surface_to_mesh_max;
} lapd_component_row;

/**
 * A place where the topology of a label in the mesh is not that of a solid, or not that of the
 * image. Set struct_size to sizeof(lapd_defect) before the call.
 */
typedef struct {
  /**
   * sizeof(lapd_defect), set by the caller.
   */
  uint64_t struct_size;
  /**
   * What is wrong, a lapd_defect_kind.
   */
  int64_t kind;
  /**
   * The label.
   */
  int64_t label;
  /**
   * Where, in world units: the centre of the component's first voxel, the centroid of its first
   * tet, the middle of the edge, the vertex.
   */
  double position[3];
  /**
   * Voxels of the component of the image, tets of that of the mesh; 0 for an edge or vertex.
   */
  uint64_t size;
} lapd_defect;

/**
 * What coarsening and the removal of slivers did. Set struct_size to sizeof(lapd_improvement)
 * before the call. All is 0 with LAPD_IMPROVE_NONE.
 */
typedef struct {
  /**
   * sizeof(lapd_improvement), set by the caller.
   */
  uint64_t struct_size;
  /**
   * The dihedral angle that was asked for, degrees.
   */
  double target_dihedral;
  /**
   * How far interfaces might be moved.
   */
  double tolerance;
  /**
   * Tets with a label other than 0 below the target before.
   */
  uint64_t below_before;
  /**
   * Those that are left below it: lapd_mesh_get_left.
   */
  uint64_t left;
  /**
   * Edges removed inside of labels.
   */
  uint64_t edge_removals;
  /**
   * Edges flipped on interfaces.
   */
  uint64_t interface_flips;
  /**
   * Moves of vertices inside of labels.
   */
  uint64_t moves_inside;
  /**
   * Moves of vertices on interfaces between two labels and in walls.
   */
  uint64_t moves_on_interfaces;
  /**
   * Moves of vertices where three labels or more meet, or an interface meets a wall.
   */
  uint64_t moves_on_junctions;
  /**
   * Edges split inside of labels: vertices that were added.
   */
  uint64_t splits;
  /**
   * The largest distance between an interface edge that was flipped and the one in its place.
   */
  double max_flip;
  /**
   * The largest distance of a vertex on an interface from where refinement put the interface; of
   * a mesh that was coarsened, from the facets that are left, with refinement's vertices. Where
   * coarsening made one vertex of two on an interface, it counts from the image's interface.
   */
  double max_interface_move;
  /**
   * The largest distance of any vertex from where refinement put it. Where coarsening made one
   * of two on an interface or a line, it counts from the place there.
   */
  double max_move;
  /**
   * Facets between tets with labels other than 0 that are not Delaunay any more.
   */
  uint64_t non_delaunay_facets;
  /**
   * Tets of background within the image that became a part of the label beside them, where the
   * image cuts that off.
   */
  uint64_t nicks_filled;
  /**
   * Edges contracted, as lapd_params_set_coarsen asks for: vertices that are gone.
   */
  uint64_t contractions;
  /**
   * Tets with a label other than 0 before the first of them; 0 where none was asked for.
   */
  uint64_t tets_before;
  /**
   * Interface facets with an angle below that of lapd_params_set_facet_angle. Refinement leaves
   * a few where the image cuts the object off; others come of tets_mended and of contractions.
   */
  uint64_t facets_below;
  /**
   * Tets that got another label, with LAPD_ADAPTIVE_TOPOLOGY and LAPD_IMPROVE_FULL: so that a
   * component has the Euler characteristic that it has in the image, or is joined with a piece
   * that was torn off.
   */
  uint64_t tets_mended;
} lapd_improvement;

/**
 * A tet that is left below the target. Set struct_size to sizeof(lapd_left) before the call.
 */
typedef struct {
  /**
   * sizeof(lapd_left), set by the caller.
   */
  uint64_t struct_size;
  /**
   * Its index among the tets of the mesh.
   */
  uint64_t tet;
  /**
   * Its label.
   */
  int64_t label;
  /**
   * What was in the way, a lapd_left_cause.
   */
  int64_t cause;
  /**
   * Its centroid, in world units.
   */
  double position[3];
  /**
   * Its smallest dihedral angle, degrees.
   */
  double min_dihedral;
  /**
   * Its largest dihedral angle, degrees.
   */
  double max_dihedral;
} lapd_left;

/**
 * The nodes in the middles of edges, and where curving put them. Set struct_size to
 * sizeof(lapd_second_order) before the call. All is 0 for a mesh of order 1, and all but `nodes`
 * without lapd_params_set_curved.
 */
typedef struct {
  /**
   * sizeof(lapd_second_order), set by the caller.
   */
  uint64_t struct_size;
  /**
   * The nodes in the middles of edges: points behind the vertices.
   */
  uint64_t nodes;
  /**
   * Those on interfaces that were moved from the middle of their edge.
   */
  uint64_t curved;
  /**
   * Those among the moved ones that do not go all the way, so that tets stay valid.
   */
  uint64_t shortened;
  /**
   * Those on interfaces that stay, so that tets stay valid.
   */
  uint64_t straight;
  /**
   * The largest distance of a node from the middle of its edge.
   */
  double max_move;
  /**
   * The least determinant of the Jacobian in a tet with a moved node, in parts of the
   * determinant of the straight tet: a bound from below, by Bezier coefficients.
   */
  double min_jacobian;
  /**
   * The volume of all tets, curved as they are.
   */
  double volume;
} lapd_second_order;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * The version of the library that runs, as "MAJOR.MINOR.PATCH". LAPD_VERSION is that of the header
 * the caller was compiled with.
 *
 * The string is static. May be called from any thread.
 */
const char *lapd_version(void);

/**
 * The optional parts that the library that runs was built with, by name and separated by spaces;
 * "" for none. "hwloc": the machine is as hwloc tells it, and lapd_params_set_topology takes
 * descriptions of others; without it Linux tells the machine in /sys. "hdf5": .xdmf and
 * .vtkhdf files are written. "tiff": .tif files are read.
 *
 * The string is static. May be called from any thread.
 */
const char *lapd_features(void);

/**
 * The name of a status code, such as "LAPD_ERROR_IO"; "LAPD_UNKNOWN_STATUS" for a number that is
 * none.
 *
 * The string is static. May be called from any thread.
 */
const char *lapd_status_name(int32_t status);

/**
 * What a status code means, in one line; "unknown status" for a number that is none.
 * lapd_context_last_error() says more about the call that failed.
 *
 * The string is static. May be called from any thread.
 */
const char *lapd_status_message(int32_t status);

/**
 * Creates a context: no message, no callbacks, not cancelled.
 *
 * The caller owns `*context` and frees it with lapd_context_free. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL.
 */
lapd_status lapd_context_create(lapd_context **context);

/**
 * Frees a context. NULL is allowed and does nothing. No other thread may use the context, nor a
 * call be under way with it. Images, parameters and meshes made with it live on.
 *
 * Waits until the memory of calls of the process that were cancelled is given back: some 0.1 s for
 * each GB.
 */
void lapd_context_free(lapd_context *context);

/**
 * The message of the last call that failed with this context: one line, UTF-8; empty when none
 * failed yet. Calls that succeed leave it as it is. For NULL a message that says so.
 *
 * The string belongs to the context and is valid until the next failing call with it, or until it
 * is freed. No other thread may use the context meanwhile.
 */
const char *lapd_context_last_error(const lapd_context *context);

/**
 * Sets the function that receives progress, and the pointer handed to it. A NULL `callback` means
 * none. Takes effect with the next call that meshes or reads an image.
 *
 * The library keeps `user` but never looks at it; both must stay valid until replaced or the
 * context is freed. No other thread may use the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL.
 */
lapd_status lapd_context_set_progress(lapd_context *context, lapd_progress_fn callback, void *user);

/**
 * Sets the function that receives log lines, and the pointer handed to it. A NULL `callback` means
 * none.
 *
 * The library keeps `user` but never looks at it; both must stay valid until replaced or the
 * context is freed. No other thread may use the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL.
 */
lapd_status lapd_context_set_log(lapd_context *context, lapd_log_fn callback, void *user);

/**
 * The most bytes that an image which is read with this context may take in memory; 0 for the
 * default. A file that asks for more is refused before anything is allocated: few bytes of a
 * compressed file can ask for a thousand times as many. By default that is 1000 times the file's
 * own bytes, or 1 GiB where that is more, and never more than half of the machine's memory.
 *
 * A label takes 2 bytes, an intensity or probability 4. No other thread may use the context
 * meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL.
 */
lapd_status lapd_context_set_max_read_bytes(lapd_context *context, uint64_t bytes);

/**
 * Which volume is read with this context of files that hold several, as images over time and NIfTI
 * files of four axes do, from 0 on. With -1, the default, such files are refused, but as
 * probability maps. No other thread may use the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL, or `volume` is below -1.
 */
lapd_status lapd_context_set_volume(lapd_context *context, int64_t volume);

/**
 * Whether headers that are read with this context may name a data file outside of their own
 * folder: not 0 for yes. By default (0) they may not, links that lead outside included, so that a
 * header from a stranger can't have other files read.
 *
 * No other thread may use the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL.
 */
lapd_status lapd_context_set_allow_outside(lapd_context *context, int32_t allow);

/**
 * Asks the run of this context to end, or the reading or writing of a file with it; the call
 * returns LAPD_ERROR_CANCELLED within 100 ms. The memory of triangulation and mesh is given back
 * by another thread after that, see lapd_context_free. Time in callbacks, and waiting for the disk
 * when a file is complete, comes on top. The calls that obey are lapd_mesh_image, those that read
 * an image from files, lapd_mesh_write and lapd_mesh_write_timeline; all others, those that make
 * an image from memory too, run to their end.
 * The request stays until lapd_context_reset_cancel: without a call under way that obeys, the next
 * one ends at once, so that no request is ever lost.
 *
 * May be called from any thread at any time in the life of the context, from its callbacks, and
 * from a signal handler.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL.
 */
lapd_status lapd_context_cancel(const lapd_context *context);

/**
 * Takes back what lapd_context_cancel asked for, so that the context can be used for another run.
 * No other thread may use the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when `context` is NULL; LAPD_ERROR_BUSY while a run is under
 * way.
 */
lapd_status lapd_context_reset_cancel(lapd_context *context);

/**
 * Makes an image from a caller's buffer. The voxels are copied (into dense ids of 2 bytes each),
 * so the buffer may be freed or changed as soon as the call returns.
 *
 * - `data` points to voxel (0, 0, 0), aligned for its type, which `voxel_type` (a lapd_voxel_type)
 *   names.
 * - `dims`: 3 values, voxels along x, y, z; at least 1 each, and at most 2^32 - 1 voxels in all.
 * - `strides`: 3 values, the distance from a voxel to the next one along x, y, z, counted in
 *   elements (not bytes); negative ones are allowed. NULL means packed, x fastest: 1, dims[0],
 *   dims[0] * dims[1].
 * - `origin`: 3 values, the world position of the centre of voxel (0, 0, 0); at most 1e9 of the
 *   smallest spacing away from that of the world.
 * - `spacing`: 3 values, the distance between voxel centres along x, y, z; between 1e-12 and 1e9,
 *   and no more than a factor of 1e5 apart.
 * - `direction`: 9 values, row by row; column k is the world direction of image axis k. Must be
 *   orthonormal; reflections are allowed, and tets have positive volumes all the same. NULL means
 *   the identity.
 *
 * World position of voxel (i, j, k): origin + direction * (i * spacing[0], j * spacing[1], k *
 * spacing[2]). Lengths are in one unit, millimetres for medical images, and so are those of the
 * mesh.
 *
 * The caller owns `*image` and frees it with lapd_image_free. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer other than `strides` and `direction` is NULL,
 * for an unknown voxel type, a dimension of 0, more than 2^32 - 1 voxels, strides beyond the
 * address space, a spacing not above 0, a value that is not finite, axes that are sheared, a label
 * that does not fit int32_t, more than 65534 labels besides 0; LAPD_ERROR_OUT_OF_MEMORY.
 */
lapd_status lapd_image_create(lapd_context *context,
                              const void *data,
                              int32_t voxel_type,
                              const size_t *dims,
                              const ptrdiff_t *strides,
                              const double *origin,
                              const double *spacing,
                              const double *direction,
                              lapd_image **image);

/**
 * Reads an image file; its format is told by the end of its name: .nrrd .nhdr .nii .nii.gz .mha
 * .mhd .inr .inr.gz .npy .tif .tiff.
 *
 * `path` is UTF-8; on Unix any bytes that name a file are taken. `world` is the frame that the
 * image is to have, a lapd_world_frame. The coordinates of a file that does not say its own stay
 * as stored, with a warning; lapd_image_get_world_axes tells what the axes of the image mean. What
 * a file says ambiguously goes to the log callback, and is kept with the image
 * (lapd_image_get_warning).
 *
 * The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
 * this one. What files may ask for is limited: see lapd_context_set_max_read_bytes and
 * lapd_context_set_allow_outside.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, `world` is unknown, or no format
 * has this ending; LAPD_ERROR_IO when the file cannot be read; LAPD_ERROR_FORMAT when it is not a
 * valid image, is cut off, or uses what this version does not read; LAPD_ERROR_MEMORY_LIMIT when
 * it asks for more memory than it may; LAPD_ERROR_CANCELLED; LAPD_ERROR_OUT_OF_MEMORY.
 */
lapd_status lapd_image_read(lapd_context *context,
                            const char *path,
                            int32_t world,
                            lapd_image **image);

/**
 * As lapd_image_read, with choices.
 *
 * - `values`: what becomes of voxels that are no whole numbers, a lapd_label_values.
 * - `layer_order`: for segmentations of 3D Slicer with several layers, whose segments may overlap:
 *   the `layer_count` layers of the file, counted from 0, each once. Where segments overlap, that
 *   of the later layer of this order counts. NULL for the order of the file.
 *
 * The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
 * this one.
 *
 * Errors: those of lapd_image_read; LAPD_ERROR_INVALID_ARGUMENT when `values` is unknown, when
 * `layer_order` does not name each layer once or the file has no layers, and for
 * LAPD_LABELS_DISTINCT of several layers.
 */
lapd_status lapd_image_read_labels(lapd_context *context,
                                   const char *path,
                                   int32_t world,
                                   int32_t values,
                                   const size_t *layer_order,
                                   size_t layer_count,
                                   lapd_image **image);

/**
 * Frees an image. NULL is allowed and does nothing. Any thread; no call may be using it. Meshes
 * made from it live on.
 */
void lapd_image_free(lapd_image *image);

/**
 * The voxels along x, y, z; `dims` has room for 3 values. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_image_get_dims(const lapd_image *image, size_t *dims);

/**
 * The world position of the centre of voxel (0, 0, 0); `origin` has room for 3 values. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_image_get_origin(const lapd_image *image, double *origin);

/**
 * The distance between voxel centres along x, y, z; `spacing` has room for 3 values. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_image_get_spacing(const lapd_image *image, double *spacing);

/**
 * Sets the distance between voxel centres along x, y, z, three values above 0: for files that do
 * not say it, as .npy and .tif. Origin and directions stay. No other thread may use the image
 * meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, or a value is out of the range
 * that lapd_image_create takes.
 */
lapd_status lapd_image_set_spacing(lapd_context *context, lapd_image *image, const double *spacing);

/**
 * The direction matrix, row by row; column k is the world direction of image axis k. `direction`
 * has room for 9 values. The rounding of file headers is taken out of it. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_image_get_direction(const lapd_image *image, double *direction);

/**
 * What the world axes of the image mean, a lapd_world_axes: those of the frame that its file was
 * read in. LAPD_AXES_UNKNOWN for images made from memory, and for files that do not say. Any
 * thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_image_get_world_axes(const lapd_image *image, int32_t *axes);

/**
 * The labels of the image other than 0, in increasing order, and how many they are.
 *
 * `*labels` belongs to the image and is valid until it is freed; with a count of 0 it must not be
 * read. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_image_get_labels(const lapd_image *image, const int32_t **labels, size_t *count);

/**
 * Copies the label of every voxel, x fastest and packed, into a buffer with room for `capacity`
 * values; as many as there are voxels are needed. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL; LAPD_ERROR_BUFFER_TOO_SMALL, and
 * nothing was written.
 */
lapd_status lapd_image_copy_voxels(const lapd_image *image, int32_t *buffer, size_t capacity);

/**
 * The value that a label stands for in an image read with LAPD_LABELS_DISTINCT, as text with all
 * its digits.
 *
 * `*value` belongs to the image and is valid until it is freed. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, or the label stands for no value.
 */
lapd_status lapd_image_get_value(const lapd_image *image, int32_t label, const char **value);

/**
 * The number of warnings that came up when the image was made or read. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_image_get_warning_count(const lapd_image *image, size_t *count);

/**
 * Warning `index` (from 0) that came up when the image was made or read: one line, UTF-8.
 *
 * `*warning` belongs to the image and is valid until it is freed. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or `index` is not below the count.
 */
lapd_status lapd_image_get_warning(const lapd_image *image, size_t index, const char **warning);

/**
 * Names a label, in place of the name that the image's file gave it. Meshes made of the image have
 * the name, and files of these. Labels that lapd_params_set_merge makes others are named by those
 * of the image: their names are joined by '+', unless the label that they become has a name of its
 * own, which may be one that the image does not have.
 *
 * `name` is UTF-8, one line; it is copied. No other thread may use the image or the context
 * meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL, or `name` is empty, not UTF-8, or
 * has control characters.
 */
lapd_status lapd_image_set_label_name(lapd_context *context,
                                      lapd_image *image,
                                      int32_t label,
                                      const char *name);

/**
 * Names labels by a table, in place of the names that they have: a label a line, its number, its
 * name, and perhaps its red, green and blue. Such are the tables of 3D Slicer (.ctbl), FreeSurfer
 * (FreeSurferColorLUT.txt) and ITK-SNAP (label descriptions), tables with commas, and lists like
 * "7 liver". Labels that the image does not have may be among them.
 *
 * `path` is as in lapd_image_read, with any ending. No other thread may use the image or the
 * context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_IO when the file cannot
 * be read; LAPD_ERROR_FORMAT when it is no such table.
 */
lapd_status lapd_image_read_label_names(lapd_context *context, lapd_image *image, const char *path);

/**
 * The name of a label: one that it was given (lapd_image_set_label_name,
 * lapd_image_read_label_names), or that the image's file has for it, as 3D Slicer's segmentations
 * do; `*name` is NULL where it has none.
 *
 * `*name` belongs to the image and is valid until that is freed or its labels are named. Any
 * thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_image_get_label_name(const lapd_image *image, int32_t label, const char **name);

/**
 * The name that a label of the image gave to a label of the mesh, as lapd_image_set_label_name
 * tells; `*name` is NULL where it has none.
 *
 * `*name` belongs to the mesh and is valid until that is freed or certified. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_label_name(const lapd_mesh *mesh, int32_t label, const char **name);

/**
 * The colour of a label, red, green and blue from 0 to 255, where the image's file or a table of
 * names gave it one: `color` has room for 3 values, `*known` is 1. Else nothing is written to
 * `color`, and `*known` is 0. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_label_color(const lapd_mesh *mesh,
                                      int32_t label,
                                      uint8_t *color,
                                      int32_t *known);

/**
 * Makes an image of a scan, by isovalues v1 < v2 < ...: background below v1, the first label from
 * v1 on, the second from v2 on, and so forth. Smooth interfaces (LAPD_SURFACE_SMOOTH) are the
 * isosurfaces of the intensity, interpolated trilinearly between voxel centres, which is much
 * closer to the object than a segmentation can be. In everything else the image is that of the
 * labels at the voxel centres.
 *
 * - `data` points to the intensity of voxel (0, 0, 0). The voxels are copied (4 bytes each, and 2
 *   for labels).
 * - `dims` (at most 2^32 - 1 voxels), `strides`, `origin`, `spacing`, `direction`: as in
 *   lapd_image_create; `strides` and `direction` may be NULL.
 * - `isovalues`: `isovalue_count` values, 1 to 31, increasing. An isovalue that many voxels have
 *   exactly puts the surface through their centres; half a unit beside it is better.
 * - `labels`: as many labels as isovalues, or NULL for 1, 2, ... Label 0 is background here too,
 *   so that a range of intensities can be meshed alone.
 *
 * The caller owns `*image` and frees it with lapd_image_free. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT as lapd_image_create, and for isovalues that are not finite
 * or do not increase, none or too many of them, an intensity that is not finite, an isovalue that
 * no voxel reaches, or no voxel between two of them; LAPD_ERROR_OUT_OF_MEMORY.
 */
lapd_status lapd_image_create_gray(lapd_context *context,
                                   const float *data,
                                   const size_t *dims,
                                   const ptrdiff_t *strides,
                                   const double *origin,
                                   const double *spacing,
                                   const double *direction,
                                   const double *isovalues,
                                   size_t isovalue_count,
                                   const int32_t *labels,
                                   lapd_image **image);

/**
 * Makes an image of probability maps, one for each label: each voxel has its most likely label, on
 * a tie the background, or else the smaller one. Smooth interfaces (LAPD_SURFACE_SMOOTH) are where
 * the largest of the probabilities, interpolated trilinearly between voxel centres, changes hands;
 * of a voxel the four largest count. In everything else the image is that of the labels at the
 * voxel centres. Merged labels have the sum of their probabilities, and labels that are not kept
 * count to the background.
 *
 * - `maps`: `map_count` pointers, each to the value of voxel (0, 0, 0) in the map of one label.
 *   The maps are copied (4 bytes per voxel and map, and 2 for labels).
 * - `labels`: `map_count` labels, all different. Where 0, the background, is among them, values
 *   may be of any scale; else the background has what all others leave to 1, and values must not
 *   exceed 1 nor be below -0.5. Values below 0 count as 0, with a warning below -0.001.
 * - `dims` (at most 2^32 - 1 voxels), `strides`, `origin`, `spacing`, `direction`: as in
 *   lapd_image_create, the same for all maps; `strides` and `direction` may be NULL. With strides
 *   maps may stand side by side, voxel by voxel.
 *
 * A label that is nowhere the most likely one has no voxel, and will have no tet: a warning, for
 * the log callback and lapd_image_get_warning, names it. So does one where a hundredth or more of
 * the object is as likely of one label as of another, as with masks that overlap.
 *
 * The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
 * this one.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT as lapd_image_create, and for no maps, a label given twice,
 * a value that is not finite, or above 1 or below -0.5 without a map of label 0;
 * LAPD_ERROR_OUT_OF_MEMORY.
 */
lapd_status lapd_image_create_probabilities(lapd_context *context,
                                            const float *const *maps,
                                            const int32_t *labels,
                                            size_t map_count,
                                            const size_t *dims,
                                            const ptrdiff_t *strides,
                                            const double *origin,
                                            const double *spacing,
                                            const double *direction,
                                            lapd_image **image);

/**
 * As lapd_image_create_probabilities for level sets: functions above 0 inside of their label and
 * below it outside, such as signed distances. The largest value wins; the background has the level
 * 0, unless it has a map. Values may be of any scale, the same for all maps. Of merged labels the
 * largest value counts.
 *
 * The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
 * this one.
 *
 * Errors: those of lapd_image_create_probabilities, but for values out of a range.
 */
lapd_status lapd_image_create_level_sets(lapd_context *context,
                                         const float *const *maps,
                                         const int32_t *labels,
                                         size_t map_count,
                                         const size_t *dims,
                                         const ptrdiff_t *strides,
                                         const double *origin,
                                         const double *spacing,
                                         const double *direction,
                                         lapd_image **image);

/**
 * Reads a scan, as lapd_image_read reads labels, and makes an image of it by isovalues, as
 * lapd_image_create_gray does. Numbers of all types are read, scaled as the file says, and rounded
 * to single precision. `path` and `world`, a lapd_world_frame, are as in lapd_image_read.
 *
 * The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
 * this one.
 *
 * Errors: those of lapd_image_read, and those of lapd_image_create_gray for isovalues and labels;
 * LAPD_ERROR_FORMAT for an intensity that is not finite, and for more than one value per voxel.
 */
lapd_status lapd_image_read_gray(lapd_context *context,
                                 const char *path,
                                 int32_t world,
                                 const double *isovalues,
                                 size_t isovalue_count,
                                 const int32_t *labels,
                                 lapd_image **image);

/**
 * Reads probability maps, as lapd_image_read reads labels, and makes an image of them, as
 * lapd_image_create_probabilities does. There may be several files, and several volumes in a file:
 * a fourth axis (NIfTI, NRRD, MetaImage) or several values for each voxel (NRRD, MetaImage, INR).
 * All volumes of all files count, in their order.
 *
 * - `paths`: `path_count` names of files. All must have the grid of the first, in the frame that
 *   is asked for.
 * - `world`: that frame, a lapd_world_frame, as in lapd_image_read.
 * - `labels`: `label_count` labels, all different, as many as there are volumes; or NULL for 1, 2,
 *   ..., `label_count` is not read then.
 *
 * The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
 * this one.
 *
 * Errors: those of lapd_image_read; LAPD_ERROR_INVALID_ARGUMENT for no files, a label given twice,
 * and not as many labels as volumes; LAPD_ERROR_FORMAT, naming the file, for files whose grids
 * differ, and for a value that is not finite, or above 1 without a map of label 0.
 */
lapd_status lapd_image_read_probabilities(lapd_context *context,
                                          const char *const *paths,
                                          size_t path_count,
                                          int32_t world,
                                          const int32_t *labels,
                                          size_t label_count,
                                          lapd_image **image);

/**
 * Reads level sets, as lapd_image_read_probabilities reads probability maps, and makes an image of
 * them, as lapd_image_create_level_sets does.
 *
 * The caller owns `*image` and frees it with lapd_image_free. Any thread; callbacks are called on
 * this one.
 *
 * Errors: those of lapd_image_read_probabilities, but for values out of a range.
 */
lapd_status lapd_image_read_level_sets(lapd_context *context,
                                       const char *const *paths,
                                       size_t path_count,
                                       int32_t world,
                                       const int32_t *labels,
                                       size_t label_count,
                                       lapd_image **image);

/**
 * Creates parameters with the defaults: delta 1, size 2, radius-edge bound 2, facet angle 30
 * degrees, slivers removed to a dihedral angle of 15 degrees, smooth surfaces, flat walls at the
 * border of the image, all labels, no background, 1 thread, no limits.
 *
 * The caller owns `*params` and frees it with lapd_params_free. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when `params` is NULL.
 */
lapd_status lapd_params_create(lapd_params **params);

/**
 * Frees parameters. NULL is allowed and does nothing. Any thread; no call may be using them.
 */
void lapd_params_free(lapd_params *params);

/**
 * Sets the distance between samples on the interfaces, in world units; above 0. Smaller means
 * closer to the image. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
 */
lapd_status lapd_params_set_delta(lapd_context *context, lapd_params *params, double delta);

/**
 * The distance between samples on the interfaces. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_delta(const lapd_params *params, double *delta);

/**
 * Sets the largest circumradius of tets, in world units; above 0. Samples on the interfaces are no
 * farther apart than 0.7 of it: a larger delta is lowered to that, with a warning. No other thread
 * may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
 */
lapd_status lapd_params_set_size(lapd_context *context, lapd_params *params, double size);

/**
 * The largest circumradius of tets. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_size(const lapd_params *params, double *size);

/**
 * Sets the largest circumradius of the tets of one label (after merging), in world units; above 0.
 * Around the label delta is lowered to 0.7 of that, if it is more. A second call for the label
 * replaces the first. lapd_mesh_image refuses a label that the image
 * does not have. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
 */
lapd_status lapd_params_set_label_size(lapd_context *context,
                                       lapd_params *params,
                                       int32_t label,
                                       double size);

/**
 * The largest circumradius of the tets of a label: its own, or that of all. Any thread, unless
 * another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
 */
lapd_status lapd_params_get_label_size(const lapd_params *params, int32_t label, double *size);

/**
 * Forgets the sizes of single labels. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_clear_label_sizes(lapd_context *context, lapd_params *params);

/**
 * Sets the largest ratio of circumradius to shortest edge of tets; at least 2 (below, refinement
 * need not end). No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
 */
lapd_status lapd_params_set_radius_edge(lapd_context *context,
                                        lapd_params *params,
                                        double radius_edge);

/**
 * The largest ratio of circumradius to shortest edge. Any thread, unless another one changes
 * `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_radius_edge(const lapd_params *params, double *radius_edge);

/**
 * Sets the smallest planar angle of interface facets, in degrees; 0 to 30 (above, refinement need
 * not end). No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
 */
lapd_status lapd_params_set_facet_angle(lapd_context *context, lapd_params *params, double degrees);

/**
 * The smallest planar angle of interface facets, in degrees. Any thread, unless another one
 * changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_facet_angle(const lapd_params *params, double *degrees);

/**
 * Sets the surface model, a lapd_surface. No other thread may use `params` or the context
 * meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL, the value is unknown, or it is
 * LAPD_SURFACE_VOXEL and labels are to be smoothed (lapd_params_set_sigma).
 */
lapd_status lapd_params_set_surface(lapd_context *context, lapd_params *params, int32_t surface);

/**
 * The surface model, a lapd_surface. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_surface(const lapd_params *params, int32_t *surface);

/**
 * Sets how the object is closed at the border of the image, a lapd_border. No other thread may use
 * `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is unknown.
 */
lapd_status lapd_params_set_border(lapd_context *context, lapd_params *params, int32_t border);

/**
 * How the object is closed at the border of the image, a lapd_border. Any thread, unless another
 * one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_border(const lapd_params *params, int32_t *border);

/**
 * Whether to keep the whole triangulation (1) or the tissues alone (0). When kept, tets outside of
 * the object have label 0. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
 */
lapd_status lapd_params_set_background(lapd_context *context,
                                       lapd_params *params,
                                       int32_t background);

/**
 * Whether the whole triangulation is kept, 1 or 0. Any thread, unless another one changes
 * `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_background(const lapd_params *params, int32_t *background);

/**
 * Sets the largest number of vertices; a run that needs more ends with LAPD_ERROR_LIMIT_REACHED,
 * or with a partial mesh where lapd_params_set_partial allows it. 0 means no limit. No other
 * thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
 */
lapd_status lapd_params_set_max_vertices(lapd_context *context,
                                         lapd_params *params,
                                         size_t max_vertices);

/**
 * The largest number of vertices, 0 for no limit. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_max_vertices(const lapd_params *params, size_t *max_vertices);

/**
 * Sets a limit of time, in wall-clock seconds from the call of lapd_mesh_image on; above 0, or 0
 * for no limit. A run whose refinement has not ended by then ends with LAPD_ERROR_TIME_LIMIT, or
 * with a partial mesh where lapd_params_set_partial allows it.
 *
 * The limit ends the preparation of the image and refinement, within some ten milliseconds. What
 * follows is not cut short: collecting and certifying the mesh takes up to twice as long. No other
 * thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is negative or not
 * finite.
 */
lapd_status lapd_params_set_time_limit(lapd_context *context, lapd_params *params, double seconds);

/**
 * The limit of time in seconds, 0 for none. Any thread, unless another one changes `params`.
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_time_limit(const lapd_params *params, double *seconds);

/**
 * Sets a limit of memory in bytes, 0 for none. A run that needs more ends with
 * LAPD_ERROR_MEMORY_LIMIT, or with a partial mesh where lapd_params_set_partial allows it.
 *
 * Counted are the tables of the run that grow with the image or the mesh: those made of the
 * image's labels, also to find what is thin, of the triangulation and the work that waits, and in
 * advance those of the mesh to come and what its certificate asks of the image, so that the limit
 * holds to the end of the run. What distances need for the mesh is checked only when they
 * are measured: if it does not fit, the run ends with LAPD_ERROR_MEMORY_LIMIT, or with
 * lapd_params_set_partial its certificate has no distances. Not counted are the caller's
 * image, the samples from which the smooth surface's label weights are found (gone before the
 * refinement begins; on a brain atlas of 256^3 voxels 70 MB), threads, and some 10 MB beside. No
 * other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
 */
lapd_status lapd_params_set_max_memory(lapd_context *context, lapd_params *params, uint64_t bytes);

/**
 * The limit of memory in bytes, 0 for none. Any thread, unless another one changes `params`.
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_max_memory(const lapd_params *params, uint64_t *bytes);

/**
 * Whether a run whose refinement is ended by a limit (of vertices, time or memory) hands out the
 * mesh of what there is by then (1), or none (0, the default). Either way lapd_mesh_image returns
 * the status of the limit, which lapd_mesh_get_limit_reached gives later.
 *
 * A partial mesh is a valid Delaunay mesh whose labels are those at the circumcenters of its tets,
 * and whose interfaces are closed. It is coarser than asked for, may be far from the image and
 * miss labels; its certificate says how much, and counts the rules that are still unmet. A limit
 * reached before the object has any tet gives no mesh. A cancelled run never gives a mesh. No
 * other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
 */
lapd_status lapd_params_set_partial(lapd_context *context, lapd_params *params, int32_t partial);

/**
 * Whether a partial mesh is allowed, 1 or 0. Any thread, unless another one changes `params`.
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_partial(const lapd_params *params, int32_t *partial);

/**
 * Sets the algorithm, a lapd_algorithm. Which memory nodes there are is read from the machine, or
 * given by lapd_params_set_topology. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is unknown.
 */
lapd_status lapd_params_set_algorithm(lapd_context *context,
                                      lapd_params *params,
                                      int32_t algorithm);

/**
 * The algorithm, a lapd_algorithm. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_algorithm(const lapd_params *params, int32_t *algorithm);

/**
 * Sets what may be changed to remove slivers, a lapd_improve. Topology, labels and the angles of
 * interface facets (lapd_params_set_facet_angle) are kept by it in any case. With
 * LAPD_IMPROVE_FULL and LAPD_ADAPTIVE_TOPOLOGY the topology is mended before: a few tets get
 * another label, and a few facets may have smaller angles (lapd_improvement: tets_mended,
 * facets_below). No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is no lapd_improve.
 */
lapd_status lapd_params_set_improve(lapd_context *context, lapd_params *params, int32_t improve);

/**
 * What may be changed to remove slivers, a lapd_improve. Any thread, unless another one changes
 * `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_improve(const lapd_params *params, int32_t *improve);

/**
 * Sets the dihedral angle that tets are to have at least, in degrees; none is to be above 180 less
 * this, either. Above 0 and at most 30. With the default, 15, interfaces move by at most 0.1 of
 * the smallest side of a voxel; with 20 and more, by 0.2; of a mesh that is coarsened, by 0.2 or
 * 0.1 of delta, whichever is more, but by no more than half of such a side. What can't be reached
 * is listed: lapd_mesh_get_left. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
 */
lapd_status lapd_params_set_target_dihedral(lapd_context *context,
                                            lapd_params *params,
                                            double degrees);

/**
 * The dihedral angle that tets are to have at least, in degrees. Any thread, unless another one
 * changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_target_dihedral(const lapd_params *params, double *degrees);

/**
 * Sets the order of tets: 1, the default, for four nodes each, or 2 for ten, one more in the
 * middle of each edge. See lapd_mesh_get_tet_mid_nodes. No other thread may use `params` or the
 * context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
 */
lapd_status lapd_params_set_order(lapd_context *context, lapd_params *params, int32_t order);

/**
 * The order of tets, 1 or 2. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_order(const lapd_params *params, int32_t *order);

/**
 * Sets whether (1) or not (0, the default) the nodes in the middle of edges of interface facets go
 * from there to where the image has the interface, as far as tets stay valid: the determinant of
 * the Jacobian is positive in all of each tet. Needs order 2 when the mesh is made. See
 * lapd_mesh_get_second_order. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
 */
lapd_status lapd_params_set_curved(lapd_context *context, lapd_params *params, int32_t curved);

/**
 * Whether nodes in the middle of edges of interface facets go to the image's interface. Any
 * thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_curved(const lapd_params *params, int32_t *curved);

/**
 * Sets what is measured on the finished mesh, a lapd_certificate_level. What was not measured says
 * so where it is asked for, and is never 0. No other thread may use `params` or the context
 * meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is none of the enum.
 */
lapd_status lapd_params_set_certificate(lapd_context *context, lapd_params *params, int32_t level);

/**
 * What is measured on the finished mesh, a lapd_certificate_level. Any thread, unless another one
 * changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_certificate(const lapd_params *params, int32_t *level);

/**
 * Sets what is sampled more densely than lapd_params_set_delta says, a lapd_adaptive. The mesh
 * then has as many more elements as that takes. No other thread may use `params` or the context
 * meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is no lapd_adaptive.
 */
lapd_status lapd_params_set_adaptive(lapd_context *context, lapd_params *params, int32_t adaptive);

/**
 * What is sampled more densely, a lapd_adaptive. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_adaptive(const lapd_params *params, int32_t *adaptive);

/**
 * Sets how close samples come at most where they are closer than lapd_params_set_delta says: this
 * times the smallest side of a voxel; above 0, by default 0.5. With LAPD_ADAPTIVE_THICKNESS they
 * come no closer than 0.9 sides anyway, nor than 0.75 where voxels of a label touch in an edge or
 * a corner alone. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
 */
lapd_status lapd_params_set_spacing_floor(lapd_context *context,
                                          lapd_params *params,
                                          double spacing_floor);

/**
 * How close samples come at most where they are closer than lapd_params_set_delta says, in
 * smallest sides of a voxel. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_spacing_floor(const lapd_params *params, double *spacing_floor);

/**
 * Sets how many elements are to lie across each layer of a label: where a label is t thick, the
 * edges of its tets are about t over this long on average. Their circumradii are at most 0.85 of
 * that, and samples of interfaces at most 0.6 of it apart. 1 to 100; 0, the default: thickness
 * does not matter for the sizes of tets. Across slanted layers there may be 1.7 times as many.
 * lapd_params_set_target_tets multiplies these bounds, too. The size of lapd_params_set_size is
 * the largest then, lapd_params_set_least_size sets the least, and lapd_params_set_gradation how
 * fast sizes grow away from a layer. What holds cubes of 32 times the smallest side of a voxel
 * counts as thick. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
 */
lapd_status lapd_params_set_across(lapd_context *context, lapd_params *params, double elements);

/**
 * How many elements are to lie across each layer of a label; 0: thickness does not matter. Any
 * thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_across(const lapd_params *params, double *elements);

/**
 * Sets the least size that lapd_params_set_across leads to, a circumradius in world units; at
 * least 0, the default. No layer leads to less than the spacing floor over 0.7 either: by default
 * 0.71 times the smallest side of a voxel. No other thread may use `params` or the context
 * meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
 */
lapd_status lapd_params_set_least_size(lapd_context *context,
                                       lapd_params *params,
                                       double least_size);

/**
 * The least size that lapd_params_set_across leads to. Any thread, unless another one changes
 * `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_least_size(const lapd_params *params, double *least_size);

/**
 * Sets by how much sizes grow per distance away from a layer, where lapd_params_set_across asks
 * for elements across it; above 0, by default 0.4. No other thread may use `params` or the context
 * meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
 */
lapd_status lapd_params_set_gradation(lapd_context *context, lapd_params *params, double gradation);

/**
 * By how much sizes grow per distance away from a layer. Any thread, unless another one changes
 * `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_gradation(const lapd_params *params, double *gradation);

/**
 * Leaves out components of a label (after lapd_params_set_merge, of voxels joined with all 26
 * around them) of fewer voxels than this: they become a part of the label, or the background, that
 * most voxels around them have. lapd_mesh_get_defect lists them. 0, the default, and 1 leave out
 * nothing. For images of labels only: lapd_mesh_image refuses images made of intensities or
 * probabilities where this is 2 or more. No other thread may use `params` or the context
 * meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
 */
lapd_status lapd_params_set_min_voxels(lapd_context *context,
                                       lapd_params *params,
                                       uint64_t min_voxels);

/**
 * The voxels that a component has at least, not to be left out. Any thread, unless another one
 * changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_min_voxels(const lapd_params *params, uint64_t *min_voxels);

/**
 * Gives labels of the image another one before all else: each of `labels` becomes `target`. All
 * labels are changed at once, so that two can be exchanged by two calls. 0 may be among them, and
 * may be the target, which makes them background. A second call for a label replaces the first.
 * lapd_mesh_image refuses a label that the image does not have. The values are copied. No other
 * thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or `count` is 0.
 */
lapd_status lapd_params_set_merge(lapd_context *context,
                                  lapd_params *params,
                                  const int32_t *labels,
                                  size_t count,
                                  int32_t target);

/**
 * What becomes of a label of the image: the target of the last lapd_params_set_merge for it, or
 * the label itself. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
 */
lapd_status lapd_params_get_merge(const lapd_params *params, int32_t label, int32_t *target);

/**
 * Forgets which labels were to become others. No other thread may use `params` or the context
 * meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_clear_merge(lapd_context *context, lapd_params *params);

/**
 * Sets the label that counts as background, after merging; the default is 0. Its voxels are as the
 * outside of the image, which has label 0 in the mesh. lapd_mesh_image refuses a label that the
 * image does not have, and, for another background than 0, an image that has label 0 as well:
 * merge 0 into that label or into another one. No other thread may use `params` or the context
 * meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
 */
lapd_status lapd_params_set_background_label(lapd_context *context,
                                             lapd_params *params,
                                             int32_t label);

/**
 * The label that counts as background. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_background_label(const lapd_params *params, int32_t *label);

/**
 * Sets the labels to mesh (after merging); all others count as background. A count of 0 means all
 * labels, and `labels` may then be NULL. lapd_mesh_image refuses a label that the image does not
 * have. The values are copied. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL.
 */
lapd_status lapd_params_set_keep(lapd_context *context,
                                 lapd_params *params,
                                 const int32_t *labels,
                                 size_t count);

/**
 * The labels to mesh, and how many they are; 0 means all.
 *
 * `*labels` belongs to the parameters and is valid until they are changed or freed; with a count
 * of 0 it must not be read. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_keep(const lapd_params *params, const int32_t **labels, size_t *count);

/**
 * Sets the standard deviation of the Gaussian that smooths the labels of a coarse segmentation, in
 * voxels along each axis of the image; 0 to 5, 0 (the default) for none. For images of labels and
 * smooth surfaces only: lapd_mesh_image refuses images made of intensities or probabilities. Voxel
 * centres keep their labels, so that nothing thin or small is lost. No other thread may use
 * `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL, the value is out of range, or it is
 * above 0 and the surface is LAPD_SURFACE_VOXEL.
 */
lapd_status lapd_params_set_sigma(lapd_context *context, lapd_params *params, double sigma);

/**
 * The standard deviation of the Gaussian that smooths labels, in voxels, 0 for none. Any thread,
 * unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_sigma(const lapd_params *params, double *sigma);

/**
 * Sets the number of threads of a run, 1 (the default) to LAPD_MAX_THREADS. lapd_mesh_image starts
 * them and joins them before it returns. More than there are processors work, but do not help.
 *
 * With 1 the mesh is the same in every run. With more it is not, because it depends on which
 * thread is first; what the certificate and the bounds on quality promise holds all the same. No
 * other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the number is out of range.
 */
lapd_status lapd_params_set_threads(lapd_context *context, lapd_params *params, size_t threads);

/**
 * The number of threads of a run. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_threads(const lapd_params *params, size_t *threads);

/**
 * Sets what threads do after conflicts, a lapd_contention. With 1 thread there are none. No other
 * thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is unknown.
 */
lapd_status lapd_params_set_contention(lapd_context *context,
                                       lapd_params *params,
                                       int32_t contention);

/**
 * What threads do after conflicts, a lapd_contention. Any thread, unless another one changes
 * `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_contention(const lapd_params *params, int32_t *contention);

/**
 * Sets whom threads without work ask for some first, a lapd_begging. With 1 thread there is nobody
 * to ask. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is unknown.
 */
lapd_status lapd_params_set_begging(lapd_context *context, lapd_params *params, int32_t begging);

/**
 * Whom threads without work ask for some first, a lapd_begging. Any thread, unless another one
 * changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_begging(const lapd_params *params, int32_t *begging);

/**
 * Sets the machine that the threads are taken to run on, for LAPD_ALGORITHM_LAPD and
 * LAPD_BEGGING_BY_LEVEL, by one of hwloc's synthetic descriptions, such as "numa:4 core:4 pu:1":
 * four memory nodes of four cores each. An empty text (the default) means the machine at hand.
 *
 * It serves tests and planning. The text is copied. No other thread may use `params` or the
 * context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or hwloc does not understand the
 * text; LAPD_ERROR_UNSUPPORTED when the library was built without its feature hwloc.
 */
lapd_status lapd_params_set_topology(lapd_context *context,
                                     lapd_params *params,
                                     const char *description);

/**
 * The description of the machine that the threads are taken to run on; empty for the machine at
 * hand.
 *
 * `*description` belongs to the parameters and is valid until they are changed or freed. Any
 * thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_topology(const lapd_params *params, const char **description);

/**
 * Whether to bind each thread of the refinement to a core of its own (1) or not (0, the default).
 * Cores are taken memory node by memory node, among those that the calling thread may use; more
 * threads than cores share them. The caller's thread itself is never bound. No other thread may
 * use `params` or the context meanwhile.
 *
 * Where threads cannot be bound, lapd_mesh_image fails with LAPD_ERROR_UNSUPPORTED: on other
 * systems than Linux, where a machine has more than 1024 processors, and where the calling thread
 * may use none of them. The feature hwloc is not needed.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
 */
lapd_status lapd_params_set_bind(lapd_context *context, lapd_params *params, int32_t bind);

/**
 * Whether threads are bound to cores, 1 or 0. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_bind(const lapd_params *params, int32_t *bind);

/**
 * Whether to count, for lapd_mesh_get_thread_report, the tets and vertices that each thread visits
 * in the memory of its own and of other nodes (1), or not (0, the default). Counting takes some
 * percent of the time. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
 */
lapd_status lapd_params_set_count_accesses(lapd_context *context,
                                           lapd_params *params,
                                           int32_t count_accesses);

/**
 * Whether accesses are counted, 1 or 0. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_count_accesses(const lapd_params *params, int32_t *count_accesses);

/**
 * Whether to keep what each thread did when (1), for lapd_mesh_write_timeline, or not (0, the
 * default). It takes memory while the mesh lives, some ten bytes for each time that a thread
 * begins something else. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is neither.
 */
lapd_status lapd_params_set_timeline(lapd_context *context, lapd_params *params, int32_t timeline);

/**
 * Whether a timeline is kept, 1 or 0. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_timeline(const lapd_params *params, int32_t *timeline);

/**
 * Meshes an image.
 *
 * The call returns when the mesh is done, or the run was cancelled or failed. A mesh comes with
 * LAPD_OK; a partial one, where lapd_params_set_partial asks for it, with the status of the limit.
 * With any other status `*mesh` stays as it is. Progress and log callbacks of the context are
 * called on this thread. The work is done by threads that are joined at return, but for one that
 * gives memory back after a cancel (lapd_context_free waits for it); the calling thread is neither
 * pinned nor moved. Any number of runs may go on at once, in different threads, each with its own
 * context; they may share the image and the parameters. With 1 thread the same image and
 * parameters give the same mesh, byte for byte, unless a limit of time ended it; with more they do
 * not, see lapd_params_set_threads.
 *
 * The caller owns `*mesh` and frees it with lapd_mesh_free; it needs none of the other handles to
 * live on.
 *
 * No other thread may use the context meanwhile, but to cancel, nor change `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, a label is to be merged, the
 * background, kept, or of a size of its own that the image does not have, label 0 occurs beside
 * another background, merging makes more than 65534 labels besides 0, sigma is above 0 or small
 * components are to be left out (lapd_params_set_sigma, lapd_params_set_min_voxels) of an image
 * made of intensities or probabilities, the box of the object, a voxel more on each side, has more
 * than 2^32 - 1 voxels, or delta is so coarse that no tet lies in the object;
 * LAPD_ERROR_UNSUPPORTED when threads are to be bound to cores and cannot be, see
 * lapd_params_set_bind; LAPD_ERROR_EMPTY_IMAGE when there is no label to mesh;
 * LAPD_ERROR_CANCELLED; LAPD_ERROR_LIMIT_REACHED, LAPD_ERROR_TIME_LIMIT, LAPD_ERROR_MEMORY_LIMIT,
 * see lapd_params_set_partial; LAPD_ERROR_OUT_OF_MEMORY; LAPD_ERROR_BUSY when the context is in
 * use by a run.
 */
lapd_status lapd_mesh_image(lapd_context *context,
                            const lapd_image *image,
                            const lapd_params *params,
                            lapd_mesh **mesh);

/**
 * Sets how many tets of labels the mesh is to have. Delta, the sizes, and above 1 the floor of
 * spacing (but for a mesh that is coarsened), are then multiplied by one factor, which is
 * searched: the mesh has as many tets within a tenth, unless no factor leads to that, of which a
 * warning tells. With 0, the default, these lengths are taken as they are. lapd_mesh_get_bounds
 * tells what was found. It takes one to three refinements, seldom more, each with its coarsening
 * where that is asked for. Where a limit ends a later one, and partial meshes are allowed, the
 * mesh is that of an earlier one. No other thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the number is above 4294967295.
 */
lapd_status lapd_params_set_target_tets(lapd_context *context, lapd_params *params, uint64_t tets);

/**
 * How many tets of labels the mesh is to have; 0: no number is asked for. Any thread, unless
 * another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_target_tets(const lapd_params *params, uint64_t *tets);

/**
 * Makes the refined mesh coarser where that changes nothing in what is connected: edges are
 * contracted as long as tets stay within size, samples of the interfaces within delta, and the
 * facets between keep planar angles of at least so many degrees (or those that they had), above 0
 * and at most 30. 15 is a good choice; with more fewer edges can go. Most is gained at a large
 * delta: at one of three voxels a mesh of a brain has three tenths of the tets, and no component
 * less. It takes one to three times as long as the refinement, 7 to 17 times with
 * LAPD_ADAPTIVE_THICKNESS. A limit of time that ends it early leaves many slivers, where partial
 * meshes are allowed. lapd_mesh_get_improvement tells what was done. With 0, the default, the mesh
 * stays as refinement made it. Needs LAPD_IMPROVE_FULL, which lapd_mesh_image checks. No other
 * thread may use `params` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or the value is out of range.
 */
lapd_status lapd_params_set_coarsen(lapd_context *context, lapd_params *params, double degrees);

/**
 * The planar angle in degrees that interface facets keep where the mesh is made coarser; 0: it is
 * not. Any thread, unless another one changes `params`.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_params_get_coarsen(const lapd_params *params, double *degrees);

/**
 * Tells what bounds a mesh was made with: the distance of samples, and the largest circumradius of
 * tets where no label has its own; those that lapd_params_set_target_tets has led to. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL; LAPD_ERROR_UNSUPPORTED for a mesh
 * that lapd_mesh_image did not make.
 */
lapd_status lapd_mesh_get_bounds(const lapd_mesh *mesh, double *delta, double *size);

/**
 * Tells what lapd_mesh_image is to be expected to need for an image, without making a mesh: tets
 * of labels, bytes of memory at the peak, the image among them, and seconds on this machine, as
 * busy as it is now. Mostly within a fifth, but seconds within a half with
 * LAPD_ADAPTIVE_TOPOLOGY. Where lapd_params_set_coarsen is set tets are within a quarter of what
 * is told, but with LAPD_ADAPTIVE_TOPOLOGY up to two fifths more; seconds are within a half then.
 *
 * It takes as long as the preparation of the image, up to three times that with
 * LAPD_ADAPTIVE_TOPOLOGY, and some 20 milliseconds to find out how fast the machine is. Progress
 * callbacks of the context are called on this thread. No other thread may use the context
 * meanwhile, but to cancel, nor change `params`.
 *
 * Errors: as lapd_mesh_image, as far as they come of the image and of `params`.
 */
lapd_status lapd_image_estimate(lapd_context *context,
                                const lapd_image *image,
                                const lapd_params *params,
                                uint64_t *tets,
                                uint64_t *peak_bytes,
                                double *seconds);

/**
 * Frees a mesh. NULL is allowed and does nothing. Any thread; no call may be using it, and every
 * array got from it is invalid from now on.
 */
void lapd_mesh_free(lapd_mesh *mesh);

/**
 * The limit that ended the refinement of a partial mesh (see lapd_params_set_partial):
 * LAPD_ERROR_LIMIT_REACHED, LAPD_ERROR_TIME_LIMIT or LAPD_ERROR_MEMORY_LIMIT; LAPD_OK for a mesh
 * whose refinement came to its end. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_limit_reached(const lapd_mesh *mesh, int32_t *limit);

/**
 * Writes what each thread of the refinement did when, for a mesh whose parameters asked for it
 * (lapd_params_set_timeline): JSON in Chrome's trace format, which chrome://tracing and
 * ui.perfetto.dev show as one row for each thread.
 *
 * Each span of time is an event with "ph": "X"; "tid" is the thread's number as in
 * lapd_mesh_get_thread_report, "ts" and "dur" are microseconds since the refinement began. "name"
 * is "sampling" (inserting samples of the interfaces), "refining", "rolling back" (work on an
 * operation that was given up), "waiting" (after a conflict) or "begging" (without work). The
 * events of a thread stand in the order of time.
 *
 * `path` is as in lapd_mesh_write, with any ending. An existing file is replaced. Any thread;
 * several may write at once, to different files. The work is shared by threads as that of
 * lapd_mesh_write.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or no timeline was kept;
 * LAPD_ERROR_IO when the file cannot be written; LAPD_ERROR_CANCELLED after lapd_context_cancel,
 * which leaves an existing file as it is; LAPD_ERROR_OUT_OF_MEMORY.
 */
lapd_status lapd_mesh_write_timeline(lapd_context *context,
                                     const lapd_mesh *mesh,
                                     const char *path);

/**
 * Writes all that is known about a mesh, its arrays apart, as one JSON object: what the getters of
 * this interface tell, with the names and values of labels that the image had. A number that is
 * infinite or undefined is null.
 *
 * `extra` is NULL, or a JSON object in UTF-8 with what only the caller knows. Its members come
 * beside the library's, and must have other names; but for those of its member "seconds", an
 * object, which join the library's times.
 *
 * `path` is as in lapd_mesh_write, with any ending. An existing file is replaced. Any thread;
 * several may write at once, to different files.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument other than `extra` is NULL, or `extra` is
 * no such object; LAPD_ERROR_IO when the file cannot be written; LAPD_ERROR_CANCELLED after
 * lapd_context_cancel, which leaves an existing file as it is; LAPD_ERROR_OUT_OF_MEMORY.
 */
lapd_status lapd_mesh_write_report(lapd_context *context,
                                   const lapd_mesh *mesh,
                                   const char *path,
                                   const char *extra);

/**
 * The positions of the vertices in world units: `*points` is [count][3]. In a mesh of order 2 the
 * nodes in the middles of edges come behind them.
 *
 * The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
 * read. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_points(const lapd_mesh *mesh, const double **points, size_t *count);

/**
 * The vertices of the tets, as row numbers of the points: `*tets` is [count][4].
 *
 * The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
 * read. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_tets(const lapd_mesh *mesh, const uint32_t **tets, size_t *count);

/**
 * The label of every tet: `*labels` is [count]. 0 stands for the background, where that was kept.
 *
 * The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
 * read. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_labels(const lapd_mesh *mesh, const int32_t **labels, size_t *count);

/**
 * The neighbours of the tets across their four facets, or LAPD_NO_TET: `*neighbors` is [count][4].
 *
 * The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
 * read. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_neighbors(const lapd_mesh *mesh,
                                    const uint32_t **neighbors,
                                    size_t *count);

/**
 * The vertices of the interface facets, those between two labels: `*facets` is [count][3]. The
 * normal (b - a) x (c - a) points from the facet's first label to its second one.
 *
 * The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
 * read. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_facets(const lapd_mesh *mesh, const uint32_t **facets, size_t *count);

/**
 * The labels on the two sides of the interface facets: `*labels` is [count][2]. The smaller label
 * comes first, and the background, 0, last: the order of BoundaryLabels in VTK's surface filters.
 *
 * The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
 * read. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_facet_labels(const lapd_mesh *mesh,
                                       const int32_t **labels,
                                       size_t *count);

/**
 * The face of the image's box that each interface facet lies on, a lapd_wall; `*walls` is [count].
 * Where the image cuts the object off, facets lie on a face exactly, and are LAPD_WALL_NONE
 * everywhere else. So are all facets of a mesh from other arrays, until lapd_mesh_certify has
 * compared it with its image.
 *
 * The array belongs to the mesh and is valid until it is freed or certified; NULL with a count of
 * 0 where no image is known. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_facet_walls(const lapd_mesh *mesh, const uint8_t **walls, size_t *count);

/**
 * The tets on the two sides of the interface facets, in the order of their labels: `*tets` is
 * [count][2]. LAPD_NO_TET where that side is background that was not kept.
 *
 * The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
 * read. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_facet_tets(const lapd_mesh *mesh, const uint32_t **tets, size_t *count);

/**
 * The nodes in the middles of the edges of the tets, as row numbers of the points: `*nodes` is
 * [count][6]; of a tet (a, b, c, d) they are those of its edges ab, bc, ca, ad, bd, cd, as in VTK.
 * The count is 0 for a mesh of order 1 (see lapd_params_set_order).
 *
 * Of the points those of the vertices come first, as many as lapd_counts.vertices tells; then
 * these nodes.
 *
 * The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
 * read. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_tet_mid_nodes(const lapd_mesh *mesh,
                                        const uint32_t **nodes,
                                        size_t *count);

/**
 * The nodes in the middles of the edges of the interface facets: `*nodes` is [count][3]; of a
 * facet (a, b, c) they are those of its edges ab, bc, ca. Otherwise as
 * lapd_mesh_get_tet_mid_nodes.
 *
 * The array belongs to the mesh and is valid until it is freed; with a count of 0 it must not be
 * read. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_facet_mid_nodes(const lapd_mesh *mesh,
                                          const uint32_t **nodes,
                                          size_t *count);

/**
 * Copies the points into a buffer of `capacity` values, 3 for each vertex and node. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
 */
lapd_status lapd_mesh_copy_points(const lapd_mesh *mesh, double *buffer, size_t capacity);

/**
 * Copies the tets into a buffer of `capacity` values, 4 for each tet. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
 */
lapd_status lapd_mesh_copy_tets(const lapd_mesh *mesh, uint32_t *buffer, size_t capacity);

/**
 * Copies the labels of the tets into a buffer of `capacity` values, 1 for each tet. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
 */
lapd_status lapd_mesh_copy_labels(const lapd_mesh *mesh, int32_t *buffer, size_t capacity);

/**
 * Copies the neighbours of the tets into a buffer of `capacity` values, 4 for each tet. Any
 * thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
 */
lapd_status lapd_mesh_copy_neighbors(const lapd_mesh *mesh, uint32_t *buffer, size_t capacity);

/**
 * Copies the interface facets into a buffer of `capacity` values, 3 for each facet. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
 */
lapd_status lapd_mesh_copy_facets(const lapd_mesh *mesh, uint32_t *buffer, size_t capacity);

/**
 * Copies the labels of the interface facets into a buffer of `capacity` values, 2 for each facet.
 * Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
 */
lapd_status lapd_mesh_copy_facet_labels(const lapd_mesh *mesh, int32_t *buffer, size_t capacity);

/**
 * Copies the tets beside the interface facets into a buffer of `capacity` values, 2 for each
 * facet. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL; LAPD_ERROR_BUFFER_TOO_SMALL.
 */
lapd_status lapd_mesh_copy_facet_tets(const lapd_mesh *mesh, uint32_t *buffer, size_t capacity);

/**
 * Writes a measure of every tet, a lapd_tet_measure, into a buffer of `capacity` values, one for
 * each tet. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or `measure` is no lapd_tet_measure;
 * LAPD_ERROR_BUFFER_TOO_SMALL.
 */
lapd_status lapd_mesh_copy_measure(const lapd_mesh *mesh,
                                   int32_t measure,
                                   double *buffer,
                                   size_t capacity);

/**
 * Checks that lapd_mesh_write knows the end of this name, so that another one can be refused
 * before a mesh is made for it. Nothing is opened: whether the file can be written is seen when it
 * is. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or no format has this ending.
 */
lapd_status lapd_mesh_check_path(lapd_context *context, const char *path);

/**
 * Writes a mesh to a file; the format is told by the end of its name:
 * - .vtu: VTK XML; .vtk: VTK legacy, binary; tets, then facets; cell arrays "label",
 *   "BoundaryLabels" and "boundary"; .vtkhdf: the same in HDF5, where lapd_features has "hdf5";
 * - .vtm: VTK multi-block; a .vtu file for each region and each boundary in the folder of the same
 *   name beside this file, "mesh" beside "mesh.vtm", which is the index of their names;
 * - .xdmf: XDMF with a .h5 file of the same name beside it, where lapd_features has "hdf5";
 * - .mesh: MEDIT; references of tets are labels, those of triangles number the boundaries;
 * - .node .ele .face: TetGen, always all three; first attribute and boundary marker likewise;
 * - .msh .msh4 .msh41: Gmsh MSH 4.1; .msh2 .msh22: MSH 2.2; both binary; a volume and a physical
 *   group for each region, a surface and a physical group for each boundary. Tags are labels where
 *   these are positive; labels of 0 and below get the numbers after the largest label, 0 first;
 *   boundaries those after these;
 * - .inp: Abaqus; an element set for each region, an element-based surface for each boundary;
 * - .exo .ex2 .e: Exodus II; an element block for each region, a side set for each boundary, and a
 *   second one for its other side where that is a region;
 * - .foam: OpenFOAM; the mesh is constant/polyMesh beside this file, which is empty; a zone of
 *   cells for each region, a patch for each boundary to the outside, a zone of faces for others;
 * - .mfem: MFEM mesh 1.3; .feb: FEBio 4.0; .bdf .nas: Nastran; .unv: I-DEAS universal file;
 *   attributes, element sets, properties or groups for regions and boundaries;
 * - .stl .ply .off: the interface facets alone, STL and PLY binary; PLY has properties first_label
 *   and second_label.
 *
 * A region is the tets of a label. It is called as the label is (lapd_mesh_get_label_name), or
 * "label_7". A boundary is the facets of two labels, "liver__spleen", the smaller label first, or
 * of one label and the outside, "liver__background". Where the image cuts a region off, each face
 * of the image's box is a boundary of its own, "liver__wall_x_min" (see lapd_wall). Names are made
 * of letters, digits, '_' and '-'; other characters become '_'.
 *
 * Meshes of order 2 are written with all their nodes: VTK's cell type 24, MEDIT's TetrahedraP2 and
 * TrianglesP2, Gmsh's types 11 and 9, C3D10, and the like. TetGen's, OpenFOAM's and MFEM's files
 * can't hold them; surfaces hold their flat facets.
 *
 * Where the image told what its world axes mean (lapd_image_get_world_axes) the file says so, as
 * SPACE=LPS, RAS or LAS: in the head of .vtk and .stl and in a comment of .ply, where 3D Slicer
 * looks for it, in comments of .mesh, .node, .ele, .face, .msh, .msh2, .inp, and in .vtu, .vtm and
 * .vtkhdf as the field array SPACE of character codes. .off and .unv have no place for it.
 *
 * `path` is UTF-8; on Unix any bytes that name a file are taken. An existing file is replaced. Any
 * thread; several may write the same mesh at once, to different files. The work is shared by as
 * many threads as the calling one may use processors; they are joined at return.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, no format has this ending, or the
 * format has no tets of the mesh's order; LAPD_ERROR_IO when the file cannot be written;
 * LAPD_ERROR_LIMIT_REACHED when the mesh has more vertices or tets than the format can number;
 * LAPD_ERROR_CANCELLED after lapd_context_cancel, which leaves an existing file as it is;
 * LAPD_ERROR_OUT_OF_MEMORY.
 */
lapd_status lapd_mesh_write(lapd_context *context, const lapd_mesh *mesh, const char *path);

/**
 * As lapd_mesh_write, with choices; NULL for `options` means the defaults.
 *
 * Any thread, as lapd_mesh_write; none may change `options` meanwhile.
 *
 * Errors: those of lapd_mesh_write; LAPD_ERROR_INVALID_ARGUMENT for measures in another file than
 * .vtu.
 */
lapd_status lapd_mesh_write_with(lapd_context *context,
                                 const lapd_mesh *mesh,
                                 const char *path,
                                 const lapd_write_options *options);

/**
 * Makes options, all of them as lapd_mesh_write has them.
 *
 * The caller owns `*options` and frees it with lapd_write_options_free. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when `options` is NULL.
 */
lapd_status lapd_write_options_create(lapd_write_options **options);

/**
 * Frees options. NULL is allowed and does nothing. Any thread; no call may be using them.
 */
void lapd_write_options_free(lapd_write_options *options);

/**
 * Whether a .vtu file gets a cell array (Float32) for each lapd_tet_measure: min_dihedral,
 * max_dihedral, scaled_jacobian, edge_ratio, radius_ratio, radius_edge; NaN for facets. 1 or 0,
 * the default. No other thread may use `options` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or `measures` is neither 0 nor 1.
 */
lapd_status lapd_write_options_set_measures(lapd_context *context,
                                            lapd_write_options *options,
                                            int32_t measures);

/**
 * Whether each connected part of a boundary, of facets that have edges in common, is a boundary of
 * its own: "vessel__wall_x_min_1", "vessel__wall_x_min_2", the one with most facets first. 1 or 0,
 * the default. No other thread may use `options` or the context meanwhile.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL or `parts` is neither 0 nor 1.
 */
lapd_status lapd_write_options_set_boundary_parts(lapd_context *context,
                                                  lapd_write_options *options,
                                                  int32_t parts);

/**
 * Gives regions nodes of their own at their interfaces, for contact and cohesive elements: nodes
 * on these interfaces are doubled, or made once for each region where more meet.
 *
 * `pairs` is [pair_count][2], the labels on both sides of the interfaces to split, in any order; a
 * `pair_count` of 0, with `pairs` NULL, means all interfaces between regions. Where only some of
 * the interfaces around a line are split, the line is where the cut ends, and its nodes stay one.
 *
 * The background is no region, even where it was kept. Facets of split interfaces become two, one
 * for each side, with nodes of that side and its label first; their tets are no neighbours any
 * more. In files they are two boundaries: "liver__spleen" and "spleen__liver". The report, the
 * certificate with it, speaks of the mesh before. Nodes that are copies stand behind the vertices,
 * or, on edges, behind all: lapd_mesh_get_node_pairs.
 *
 * Arrays got from the mesh before are invalid afterwards. No other thread may use the mesh
 * meanwhile, or the context but to cancel. The mesh stays as it is when the call fails.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL, two labels do not meet or are the
 * same, or interfaces were split before; LAPD_ERROR_LIMIT_REACHED for too many nodes;
 * LAPD_ERROR_CANCELLED after lapd_context_cancel; LAPD_ERROR_OUT_OF_MEMORY.
 */
lapd_status lapd_mesh_split_interfaces(lapd_context *context,
                                       lapd_mesh *mesh,
                                       const int32_t *pairs,
                                       size_t pair_count);

/**
 * The nodes that were made where interfaces were split: `*pairs` is [count][2], each one behind
 * the node that it is a copy of, as rows of the points. No rows where nothing was split.
 *
 * The array belongs to the mesh and is valid until it is freed or its interfaces are split; with a
 * count of 0 it must not be read. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_node_pairs(const lapd_mesh *mesh, const uint32_t **pairs, size_t *count);

/**
 * Makes a mesh of arrays that another program made, to certify it (lapd_mesh_certify) or to write
 * it: `points` is [point_count][3] in world coordinates, `tets` [tet_count][4], `labels`
 * [tet_count]; label 0 is background. The arrays are copied. Tets keep their order and their
 * vertices; neighbours and interface facets are found.
 *
 * Every tet (a, b, c, d) should have (b - a) x (c - a) . (d - a) > 0, as in VTK, Gmsh and MEDIT;
 * the certificate counts those that have not.
 *
 * What tells of a run is LAPD_ERROR_NOT_MEASURED for such a mesh: operations, improvement,
 * certificate, quality; lapd_counts has 0 for the whole triangulation.
 *
 * The caller owns `*mesh` and frees it with lapd_mesh_free. Any thread; the work is done on as
 * many threads as the calling one may use processors, joined at return.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when a pointer is NULL, a coordinate is not finite, a tet
 * has a vertex twice or one that is not there, a facet is one of more than two tets, or two
 * positive tets lie on the same side of a facet; LAPD_ERROR_LIMIT_REACHED for more tets than can
 * be numbered; LAPD_ERROR_CANCELLED after lapd_context_cancel; LAPD_ERROR_OUT_OF_MEMORY.
 */
lapd_status lapd_mesh_from_arrays(lapd_context *context,
                                  const double *points,
                                  size_t point_count,
                                  const uint32_t *tets,
                                  size_t tet_count,
                                  const int32_t *labels,
                                  lapd_mesh **mesh);

/**
 * Measures the certificate of a finished mesh, and its quality, against an image: of a mesh from
 * other arrays, of one whose run had no certificate, or to add what a level has more. They take
 * the place of what was measured before.
 *
 * Of `params` count: the certificate's level, threads, the time and memory limits; and what tells
 * which image the mesh is to be compared with, as it was told the run: labels merged, kept and of
 * the background, the fewest voxels, sigma, surface and border. With another image or others of
 * these the certificate tells how far the mesh is from that.
 *
 * A run counts facets that are not Delaunay before it improves the mesh, and rules that stay
 * unmet; these counts stay. Where a run had no certificate, or there was none, the facets are
 * counted now, unless the mesh was improved; what is not counted is LAPD_NOT_COUNTED, null in
 * JSON.
 *
 * Runs like lapd_mesh_image: callbacks are called on this thread, the work is done by threads that
 * are joined at return, `*mesh` stays as it is when the call fails. No other thread may use the
 * mesh meanwhile, or the context but to cancel, nor change `params`.
 *
 * Errors: those of lapd_mesh_image for an argument, an image and its labels;
 * LAPD_ERROR_INVALID_ARGUMENT for LAPD_CERTIFICATE_NONE and for a mesh whose interfaces were
 * split; LAPD_ERROR_EMPTY_IMAGE; LAPD_ERROR_CANCELLED; LAPD_ERROR_TIME_LIMIT;
 * LAPD_ERROR_MEMORY_LIMIT; LAPD_ERROR_OUT_OF_MEMORY; LAPD_ERROR_BUSY when the context is in use by
 * a run.
 */
lapd_status lapd_mesh_certify(lapd_context *context,
                              lapd_mesh *mesh,
                              const lapd_image *image,
                              const lapd_params *params);

/**
 * How large the mesh is. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
 * known version.
 */
lapd_status lapd_mesh_get_counts(const lapd_mesh *mesh, lapd_counts *counts);

/**
 * How long the run took. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
 * known version.
 */
lapd_status lapd_mesh_get_timings(const lapd_mesh *mesh, lapd_timings *timings);

/**
 * What refinement did, all threads together; lapd_mesh_get_thread_report tells what each of them
 * did. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
 * known version.
 */
lapd_status lapd_mesh_get_operations(const lapd_mesh *mesh, lapd_operations *operations);

/**
 * The quality of the mesh. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
 * known version; LAPD_ERROR_NOT_MEASURED when the mesh has no certificate.
 */
lapd_status lapd_mesh_get_quality(const lapd_mesh *mesh, lapd_quality *quality);

/**
 * The certificate of the mesh. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
 * known version; LAPD_ERROR_NOT_MEASURED when the mesh has none.
 */
lapd_status lapd_mesh_get_certificate(const lapd_mesh *mesh, lapd_certificate *certificate);

/**
 * The number of threads that refined. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_thread_count(const lapd_mesh *mesh, size_t *count);

/**
 * What thread `index` (from 0) of the refinement did, or, for LAPD_ALL_THREADS, the sum of what
 * all of them did. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, `index` is neither below the count
 * nor LAPD_ALL_THREADS, or struct_size is not that of a known version.
 */
lapd_status lapd_mesh_get_thread_report(const lapd_mesh *mesh,
                                        size_t index,
                                        lapd_thread_report *report);

/**
 * The number of rows that lapd_mesh_get_label_row has: one for each label that was meshed. Any
 * thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL; LAPD_ERROR_NOT_MEASURED when the
 * mesh has no certificate.
 */
lapd_status lapd_mesh_get_label_row_count(const lapd_mesh *mesh, size_t *count);

/**
 * Row `index` (from 0) of the table of labels. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, `index` is not below the count, or
 * struct_size is not that of a known version; LAPD_ERROR_NOT_MEASURED when the mesh has no
 * certificate.
 */
lapd_status lapd_mesh_get_label_row(const lapd_mesh *mesh, size_t index, lapd_label_row *row);

/**
 * The number of rows that lapd_mesh_get_component_row has: one for each component of the image
 * that has LAPD_MIN_COMPONENT_VOXELS or more. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL; LAPD_ERROR_NOT_MEASURED when the
 * mesh has no certificate.
 */
lapd_status lapd_mesh_get_component_row_count(const lapd_mesh *mesh, size_t *count);

/**
 * Row `index` (from 0) of the table of components. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, `index` is not below the count, or
 * struct_size is not that of a known version; LAPD_ERROR_NOT_MEASURED when the mesh has no
 * certificate.
 */
lapd_status lapd_mesh_get_component_row(const lapd_mesh *mesh,
                                        size_t index,
                                        lapd_component_row *row);

/**
 * The number of places that lapd_mesh_get_defect has. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL; LAPD_ERROR_NOT_MEASURED when the
 * mesh has no certificate.
 */
lapd_status lapd_mesh_get_defect_count(const lapd_mesh *mesh, size_t *count);

/**
 * Place `index` (from 0) where the topology of a label is at fault; they are in the order of
 * lapd_defect_kind. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, `index` is not below the count, or
 * struct_size is not that of a known version; LAPD_ERROR_NOT_MEASURED when the mesh has no
 * certificate.
 */
lapd_status lapd_mesh_get_defect(const lapd_mesh *mesh, size_t index, lapd_defect *defect);

/**
 * What the removal of slivers did. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
 * known version.
 */
lapd_status lapd_mesh_get_improvement(const lapd_mesh *mesh, lapd_improvement *improvement);

/**
 * The number of tets that lapd_mesh_get_left has. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL.
 */
lapd_status lapd_mesh_get_left_count(const lapd_mesh *mesh, size_t *count);

/**
 * Tet `index` (from 0) of those that are left below the target. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL, `index` is not below the count, or
 * struct_size is not that of a known version.
 */
lapd_status lapd_mesh_get_left(const lapd_mesh *mesh, size_t index, lapd_left *left);

/**
 * The nodes in the middles of edges, and where curving put them. Any thread.
 *
 * Errors: LAPD_ERROR_INVALID_ARGUMENT when an argument is NULL or struct_size is not that of a
 * known version.
 */
lapd_status lapd_mesh_get_second_order(const lapd_mesh *mesh, lapd_second_order *second_order);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* LAPD_H */
