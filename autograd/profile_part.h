/* profile_part.h: what one watched tape puts down; between tape.c and profile.c. */
#ifndef LF_AUTOGRAD_PROFILE_PART_H
#define LF_AUTOGRAD_PROFILE_PART_H

#include "autograd/profile.h"

typedef struct lf_profile_entry {
    int scope;      /* number in the part's list */
    const char *op; /* NULL: none */
    long calls, unknown;
    double seconds[2], products[2]; /* forward, backward */
    size_t bytes, held;             /* the most between two resets; since the last one */
    long span;                      /* resets before `held` began */
} lf_profile_entry;

typedef struct lf_profile_scope {
    int parent;
    char path[LF_PROFILE_NAME];
} lf_profile_scope;

/* What the backward of a node will be put down as. */
typedef struct lf_profile_node {
    int entry;
    double products;
} lf_profile_node;

typedef struct lf_profile_part lf_profile_part;
struct lf_profile_part {
    lf_profile_part *next;
    const lf_tape *tape;
    int team;
    lf_profile_entry *entry;
    lf_profile_scope *scope; /* 0: outside all */
    lf_profile_node *node;   /* as the tape's nodes */
    int entries, entry_room, scopes, scope_room;
    long node_room;
    int at;           /* scope */
    long span;        /* resets */
    double clock;     /* of the last event */
    size_t bytes;     /* of the tape then */
    bool said;        /* the next op has said what it computes: */
    double expect[2]; /* its products */
};

lf_profile_part *lf_part_create(const lf_tape *tape, int team);
void lf_part_free(lf_profile_part *part);

lf_profile_part *lf_tape_part(const lf_tape *tape); /* NULL: not watched */
void lf_tape_set_part(lf_tape *tape, lf_profile_part *part);

/* Events. `node` is the number of the op's node, or -1 if none was kept. */
void lf_part_reset(lf_profile_part *part);
void lf_part_op(lf_profile_part *part, const char *op, long node);
void lf_part_other(lf_profile_part *part); /* what passed belongs to no op */
void lf_part_backward(lf_profile_part *part, long node);

#endif
