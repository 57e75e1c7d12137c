/* colour_map.c: two tables of nine colours. */
#include "eval/colour_map.h"

#include <math.h>

enum { LAST = 8 };

static const unsigned char table[][LAST + 1][3] = {[LF_COLOURS_HEAT] = {{0, 0, 4},
                                                                        {30, 14, 72},
                                                                        {86, 17, 108},
                                                                        {138, 35, 104},
                                                                        {188, 56, 84},
                                                                        {228, 92, 46},
                                                                        {248, 143, 14},
                                                                        {246, 200, 66},
                                                                        {253, 253, 214}},
                                                   [LF_COLOURS_SEA] = {{68, 2, 86},
                                                                       {72, 40, 120},
                                                                       {62, 74, 137},
                                                                       {48, 104, 142},
                                                                       {37, 131, 142},
                                                                       {32, 159, 134},
                                                                       {70, 187, 110},
                                                                       {148, 213, 62},
                                                                       {252, 231, 40}}};

void lf_colour_at(lf_colour_map map, double t, float out[3])
{
    if (isnan(t)) {
        out[0] = out[1] = out[2] = 0.5f;
        return;
    }
    const double x = LAST * fmin(1, fmax(0, t));
    const int i = x < LAST ? (int)x : LAST - 1;
    for (int c = 0; c < 3; c++)
        out[c] = (float)((table[map][i][c] * (i + 1 - x) + table[map][i + 1][c] * (x - i)) / 255);
}
