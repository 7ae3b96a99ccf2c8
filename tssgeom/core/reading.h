/* Coordinates straight from their text. */
#pragma once
#include "core.h"

/** Read `[[x,y,z],null,…]` of JSON: points, a row of NaN for a null.

Parameters: the text [n]; memory for the points [most][3], in the text's unit; most = n / 5 + 1 is enough.
Returns how many points there are: 0 where the text is anything else, or has a number that is hard to round.
Each number is the nearest float64, as the JSON library gives it. */
ENTRY int64_t tss_read_points(int64_t n, const char text[n], int64_t most, INOUT double points[most][3]);
