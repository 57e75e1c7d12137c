/* colour_map.h: numbers as colours whose lightness grows evenly with the number.
 *
 * A scale is nine colours at t = 0, 1/8, ..., 1, joined linearly in display values. Their lightness
 * (CIE L*) grows in about equal steps, so that equal differences look equal and a grey copy of the
 * picture still reads.
 */
#ifndef LF_EVAL_COLOUR_MAP_H
#define LF_EVAL_COLOUR_MAP_H

#ifdef __cplusplus
extern "C" {
#endif

typedef enum lf_colour_map {
    LF_COLOURS_HEAT, /* black, violet, red, orange, nearly white: errors */
    LF_COLOURS_SEA   /* dark violet, blue, green, yellow: depths */
} lf_colour_map;

/* The colour of t, cut to 0..1; NaN is the middle grey. */
void lf_colour_at(lf_colour_map map, double t, float out[3]);

#ifdef __cplusplus
}
#endif
#endif
