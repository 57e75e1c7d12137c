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

typedef struct lf_step_profile {
    const char *model; /* model.type */
    long warm_up, steps;
    int threads;
    double limit;      /* multiply-add limit of all threads, operations a second */
    lf_step_times sum; /* of all steps */
    double fastest;    /* seconds of the fastest step */
    size_t tapes;      /* bytes of tapes and lanes at their largest */
    double rss_mb;
    const lf_profile *profile; /* of all steps */
} lf_step_profile;

/* Two tables, by part of the model and by op, and the totals; all of one step. */
void lf_step_profile_print(FILE *out, const lf_step_profile *p);

/* The same numbers, and those by part and op, into the file `path`; keys in docs/formats.md. */
lf_status lf_step_profile_write(const char *path, const lf_step_profile *p, lf_error *err);

#endif
