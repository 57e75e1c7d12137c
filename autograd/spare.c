/* spare.c: see spare.h. */
#include "autograd/spare.h"

static long rounded(long size)
{
    const long line = LF_SPARE_ALIGNMENT / (long)sizeof(lf_real);
    return (size + line - 1) / line * line;
}

lf_real *lf_spares_take(lf_spares *s, long size)
{
    size = rounded(size);
    int best = -1;
    for (int i = 0; i < s->count; i++)
        if (s->piece[i].size >= size && (best < 0 || s->piece[i].size < s->piece[best].size))
            best = i;
    if (best < 0)
        return NULL;
    lf_spare *piece = &s->piece[best];
    lf_real *memory = piece->memory;
    piece->memory += size;
    piece->size -= size;
    if (piece->size == 0)
        *piece = s->piece[--s->count];
    return memory;
}

void lf_spares_give(lf_spares *s, lf_real *memory, long size)
{
    lf_spare given = {memory, rounded(size)};
    for (int i = 0; i < s->count;) {
        const lf_spare other = s->piece[i];
        const bool before = other.memory + other.size == given.memory;
        if (!before && given.memory + given.size != other.memory) {
            i++;
            continue;
        }
        given = (lf_spare){before ? other.memory : given.memory, given.size + other.size};
        s->piece[i] = s->piece[--s->count];
    }
    if (s->count < LF_SPARES && given.size > 0)
        s->piece[s->count++] = given;
}
