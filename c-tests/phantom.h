/* Images that are easy to reason about, checks of the meshes made from them, and a clock. */
#ifndef LAPD_PHANTOM_H
#define LAPD_PHANTOM_H

#include <lapd.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* n^3 voxels, x fastest: label 7 in a ball of this radius (in voxels) about the centre. The caller
 * frees them. */
uint8_t *ball_voxels(size_t n, double radius);

/* The same ball, cut into label 3 (x below the centre), 300 (y below it), and -5 (the rest): they
 * meet in a line. */
int16_t *three_label_voxels(size_t n, double radius);

/* An image of bytes at the world's origin, unit spacing; ends the test when it cannot be made. */
lapd_image *unit_image(lapd_context *context, const uint8_t *voxels, size_t n);

/* Parameters with this delta, and size twice as large; ends the test when they cannot be made. */
lapd_params *params_with_delta(lapd_context *context, double delta);

/*
 * Checks with nothing but plain C that the arrays of a mesh fit each other: indices in range,
 * volumes positive, neighbours mutual, every facet between two labels listed once, with the right
 * labels, tets and direction, every vertex used, the report's volumes those of the tets.
 */
void check_mesh(const lapd_mesh *mesh, bool background);

/* The volume of a label's tets. */
double label_volume(const lapd_mesh *mesh, int32_t label);

/* Whether two meshes have the same bytes. */
bool same_mesh(const lapd_mesh *a, const lapd_mesh *b);

/* Seconds of a clock that only goes forward. */
double now(void);

#endif
