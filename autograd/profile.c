/* profile.c: what a watched tape puts down, event by event. See profile.h; profile_rows.c reads. */
#include "autograd/profile_part.h"

#include <stdarg.h>
#include <time.h>

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Room for number `n` of an array of items of `size` bytes, the new ones zero. */
static void *with_room(void *array, long n, long *room, size_t size)
{
    if (n < *room)
        return array;
    const long more = n < 32 ? 64 : 2 * n;
    char *grown = realloc(array, (size_t)more * size);
    LF_REQUIRE(grown, "out of memory for %ld entries of a profile", more);
    memset(grown + (size_t)*room * size, 0, (size_t)(more - *room) * size);
    *room = more;
    return grown;
}

/* ---- where things are put down ---- */

static bool same_op(const char *a, const char *b)
{
    return a == b || (a && b && strcmp(a, b) == 0);
}

static int entry_of(lf_profile_part *p, const char *op)
{
    for (int i = 0; i < p->entries; i++)
        if (p->entry[i].scope == p->at && same_op(p->entry[i].op, op))
            return i;
    long room = p->entry_room;
    p->entry = with_room(p->entry, p->entries, &room, sizeof *p->entry);
    p->entry_room = (int)room;
    p->entry[p->entries] = (lf_profile_entry){.scope = p->at, .op = op};
    return p->entries++;
}

static int scope_of(lf_profile_part *p, const char *name)
{
    lf_profile_scope s = {.parent = p->at};
    const char *above = p->scope[p->at].path;
    const int n = snprintf(s.path, sizeof s.path, "%s%s%s", above, above[0] ? "/" : "", name);
    LF_REQUIRE(n >= 0 && n < (int)sizeof s.path, "a scope's name is too long: %s/%s", above, name);
    for (int i = 1; i < p->scopes; i++)
        if (strcmp(p->scope[i].path, s.path) == 0)
            return i;
    long room = p->scope_room;
    p->scope = with_room(p->scope, p->scopes, &room, sizeof *p->scope);
    p->scope_room = (int)room;
    p->scope[p->scopes] = s;
    return p->scopes++;
}

/* Time and bytes since the last event, to an entry, or to nobody (NULL). */
static void passed(lf_profile_part *p, lf_profile_entry *e)
{
    const double t = now();
    const size_t bytes = lf_tape_bytes(p->tape);
    if (e) {
        e->seconds[0] += t - p->clock;
        e->held = e->span == p->span ? e->held : 0;
        e->span = p->span;
        e->held += bytes > p->bytes ? bytes - p->bytes : 0;
        e->bytes = e->held > e->bytes ? e->held : e->bytes;
    }
    p->clock = t;
    p->bytes = bytes;
}

/* ---- beginning and end ---- */

lf_profile_part *lf_part_create(const lf_tape *tape, int team)
{
    lf_profile_part *p = calloc(1, sizeof *p);
    LF_REQUIRE(p, "out of memory for a profile");
    p->tape = tape;
    p->team = team;
    p->scope = calloc(1, sizeof *p->scope);
    LF_REQUIRE(p->scope, "out of memory for a profile");
    p->scopes = p->scope_room = 1;
    p->clock = now();
    p->bytes = lf_tape_bytes(tape);
    return p;
}

void lf_part_free(lf_profile_part *p)
{
    free(p->entry);
    free(p->scope);
    free(p->node);
    free(p);
}

/* ---- events ---- */

void lf_part_other(lf_profile_part *p)
{
    passed(p, p->at ? &p->entry[entry_of(p, NULL)] : NULL);
}

void lf_part_reset(lf_profile_part *p)
{
    lf_part_other(p);
    p->span++;
}

void lf_part_op(lf_profile_part *p, const char *op, long node)
{
    const int number = entry_of(p, op);
    lf_profile_entry *e = &p->entry[number];
    passed(p, e);
    e->calls++;
    e->unknown += !p->said;
    e->products[0] += p->said ? p->expect[0] : 0;
    if (node >= 0) {
        p->node = with_room(p->node, node, &p->node_room, sizeof *p->node);
        p->node[node] = (lf_profile_node){number, p->said ? p->expect[1] : 0};
    }
    p->said = false;
}

/* Gradients that the walk makes are not counted as kept: their memory is used again. */
void lf_part_backward(lf_profile_part *p, long node)
{
    const double t = now();
    lf_profile_entry *e = &p->entry[p->node[node].entry];
    e->seconds[1] += t - p->clock;
    e->products[1] += p->node[node].products;
    p->clock = t;
    p->bytes = lf_tape_bytes(p->tape);
}

/* ---- what models and ops say ---- */

void lf_scope(lf_tape *tape, const char *format, ...)
{
    lf_profile_part *p = lf_tape_part(tape);
    if (!p)
        return;
    char name[LF_PROFILE_NAME];
    va_list args;
    va_start(args, format);
    vsnprintf(name, sizeof name, format, args);
    va_end(args);
    lf_part_other(p);
    p->at = scope_of(p, name);
}

void lf_scope_end(lf_tape *tape)
{
    lf_profile_part *p = lf_tape_part(tape);
    if (!p)
        return;
    LF_REQUIRE(p->at, "the end of a scope without a beginning");
    lf_part_other(p);
    p->at = p->scope[p->at].parent;
}

bool lf_profiled(const lf_tape *tape)
{
    return lf_tape_part(tape) != NULL;
}

void lf_products(lf_tape *tape, double forward, double backward)
{
    lf_profile_part *p = lf_tape_part(tape);
    if (!p)
        return;
    p->said = true;
    p->expect[0] = forward;
    p->expect[1] = backward;
}

void lf_products_of(lf_tape *tape, double products, const lf_tensor *a, const lf_tensor *b)
{
    lf_products(tape, products, products * (a->wants + b->wants));
}

double lf_present(long n, const lf_real *mask)
{
    double present = 0;
    for (long i = 0; i < n; i++)
        present += mask[i] > 0;
    return present;
}
