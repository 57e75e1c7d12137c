/* spare.h: memory of a tape's arena that nobody needs any more, for the next who asks; between
 * tape.c and spare.c. Pieces are cut to size and joined again with their neighbours. */
#ifndef LF_AUTOGRAD_SPARE_H
#define LF_AUTOGRAD_SPARE_H

#include <stdbool.h>
#include <stddef.h>

#include "autograd/real.h"

enum { LF_SPARES = 64, LF_SPARE_ALIGNMENT = 64 };

typedef struct lf_spare {
    lf_real *memory;
    long size; /* numbers, whole cache lines of them */
} lf_spare;

typedef struct lf_spares {
    lf_spare piece[LF_SPARES];
    int count;
} lf_spares;

/* Memory for `size` numbers, aligned, not cleared, from the smallest piece that is large enough;
 * NULL: there is none. */
lf_real *lf_spares_take(lf_spares *s, long size);
/* The memory of `size` numbers, which the arena rounds up to whole cache lines, is free. With
 * LF_SPARES pieces already it is forgotten. */
void lf_spares_give(lf_spares *s, lf_real *memory, long size);

#endif
