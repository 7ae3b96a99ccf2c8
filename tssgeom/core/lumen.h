/* The wall of a lumen. */
#pragma once
#include "core.h"

/** Find the nearest point of a wall of triangles for each point; docs/model.md (144).

Parameters: points [n][3] and the corners of the triangles [f][3][3], in m. Boxes around the triangles in a
complete binary tree, the children of box k being 2k + 1 and 2k + 2: lower and upper corners [b][3], infinite
where a box is empty, and the numbers of the triangles in the boxes of the lowest row [g], -1 for none.
Returns the nearest points [n][3] and their distances [n] in m; the side [n], +1 where the normal of the wall
points towards the point and -1 where it points away; and whether the nearest point is on the rim of the wall,
where the side is undefined [n]. */
ENTRY status tss_nearest_on_wall(
    int64_t n, int64_t f, int64_t g, int64_t b, const double points[n][3], const double corners[f][3][3],
    const int64_t order[g], const double low[b][3], const double high[b][3],
    OUT double position[n][3], OUT double distance[n], OUT double side[n], OUT uint8_t on_rim[n]);
