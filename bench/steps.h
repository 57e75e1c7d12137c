/* steps.h: a training step or an evaluation of any config at given sizes, on made-up data: for the
 * tables of steps.c and render_steps.c, and for growth.c.
 *
 * An evaluation is what comes after the maps of the pictures, which are made once: distances at
 * points, or colours of rays. Work owns its data; the config is not used once it is open.
 */
#ifndef LF_BENCH_STEPS_H
#define LF_BENCH_STEPS_H

#include "bench/bench.h"
#include "configs/configs.h"

/* The schema's defaults (the tiny recipe) with the changes of sets[0 .. count), as of --set; they
 * must be right. The caller's. */
lf_config *lf_bench_config(const char *const *sets, int count);

typedef struct lf_bench_recon {
    long objects, views, points; /* points of all objects */
    long tile, channels;         /* points of a tile, channels of an image */
    bool predict;                /* distances alone; else a training step */
} lf_bench_recon;

/* images and points of a reconstruction model (steps.c) */
lf_bench_work *lf_bench_recon_open(const lf_config *cfg, const lf_bench_recon *sizes);

typedef struct lf_bench_render {
    long rays, width, height; /* of the source pictures */
    bool picture;             /* colours alone; else a training step */
} lf_bench_render;

/* pictures and rays of a renderer (render_steps.c) */
lf_bench_work *lf_bench_render_open(const lf_config *cfg, const lf_bench_render *sizes);

#endif
