/* profile_report.h: where the time of training steps went, as tables and as JSON. [docs/profile.md]
 */
#ifndef LF_TRAIN_PROFILE_REPORT_H
#define LF_TRAIN_PROFILE_REPORT_H

#include "autograd/profile.h"

/* Seconds of a step. */
typedef struct lf_step_times {
    double data;    /* making the batch */
    double compute; /* forward and backward */
    double update;  /* norm of the gradient, clipping, optimiser */
    double all;     /* the whole step */
} lf_step_times;

/* One step; the profile is owned. */
typedef struct lf_measured_step {
    lf_step_times seconds;
    lf_profile *profile;
} lf_measured_step;

/* What is reported: the fastest quarter of the steps. Others' work on the machine makes steps only
 * slower. */
typedef struct lf_step_profile {
    const char *model; /* model.type */
    long warm_up, all; /* steps before, and measured */
    int threads;
    double limit; /* multiply-add limit of all threads, operations a second */
    size_t tapes; /* bytes of tapes and lanes at their largest */
    double rss_mb;
    /* set by lf_step_profile_choose */
    double mean, fastest;      /* seconds of a step: of all, the fastest */
    long steps;                /* of the fastest quarter, at least 1 */
    lf_step_times sum;         /* of these */
    const lf_profile *profile; /* of these; the first step's */
} lf_step_profile;

/* Pick the steps that count out of p->all; sorts them and joins their profiles. */
void lf_step_profile_choose(lf_step_profile *p, lf_measured_step *step);

/* Two tables, by part of the model and by op, and the totals; all of one step. */
void lf_step_profile_print(FILE *out, const lf_step_profile *p);

/* The same numbers, and those by part and op, into the file `path`; keys in docs/formats.md. */
lf_status lf_step_profile_write(const char *path, const lf_step_profile *p, lf_error *err);

#endif
