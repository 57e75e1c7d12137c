/* profile.h: where time, operations and memory of tapes go.                    [docs/profile.md]
 *
 * Models name their parts by scopes and ops say what they compute (autograd.h, "what a profile is
 * told"); a profile that watches the tapes of a workspace sums both by (scope, op).
 *
 * Time      of a forward is what passes between two events of its tape (a recorded op, a scope's
 *           beginning or end, a reset) and belongs to the op that ends it, or to none; that of a
 *           backward is measured node by node. What passes outside all scopes and ends with no op
 *           is nobody's.
 * Teams     a step has one tape whose clock is the step's, and may have tapes of a team of threads
 *           that work at the same time: their seconds are divided by the number of threads. While
 *           they work, the step's tape stands in the scope LF_SCOPE_TEAM, in which it is counted
 *           as waiting: what of that time no thread of the team has used.
 * Products  multiply-adds as the ops' formulas have them, of what is needed: not of masked views
 *           where the op knows them, not of gradients that nobody wants. A multiply-add is two
 *           operations. Ops that do not say (activations, norms, copies) count as unknown.
 * Bytes     that a forward leaves on its tape: the most between two resets, over all tapes, and
 *           over all joined profiles.
 *
 * Threads: a tape's events are put down by the thread that uses it. Watching and reading are for
 * times when no watched tape is in use.
 */
#ifndef LF_AUTOGRAD_PROFILE_H
#define LF_AUTOGRAD_PROFILE_H

#include "autograd/autograd.h"

typedef struct lf_profile lf_profile;

lf_profile *lf_profile_create(void);
/* Take it off its tapes first, or free them first. */
void lf_profile_free(lf_profile *profile);

/* Put down from now on what happens on `tape`; NULL: no longer. team: 0 for the step's own tape,
 * else the threads of the team to which this tape's thread belongs. */
void lf_profile_watch(lf_profile *profile, lf_tape *tape, int team);

/* Add all that `from`, which watches no tape any more, has put down to `to`; from becomes empty. */
void lf_profile_join(lf_profile *to, lf_profile *from);

#define LF_SCOPE_TEAM "team"

enum { LF_PROFILE_NAME = 96 };

typedef struct lf_profile_row {
    char scope[LF_PROFILE_NAME]; /* "backbone/stage1"; "": outside all */
    const char *op;              /* "conv2d"; NULL: no op, or all of a scope */
    long calls;                  /* ops recorded */
    long unknown;                /* those of them that do not say what they compute */
    double forward, backward;    /* seconds */
    double products[2];          /* multiply-adds, forward and backward */
    size_t bytes;
} lf_profile_row;

typedef enum lf_profile_by { LF_BY_BOTH, LF_BY_SCOPE, LF_BY_OP } lf_profile_by;

/* All that was put down, in the order in which it appeared first, a team's behind that of the
 * step's tape before the team; returns the number of rows, which the caller frees. By op, the time
 * without an op keeps the scope LF_SCOPE_TEAM where it is waiting, and has "" elsewhere. */
int lf_profile_rows(const lf_profile *profile, lf_profile_by by, lf_profile_row **rows);

#endif
