/* profile_rows.c: the tapes that a profile watches, and the sum of what they put down. */
#include "autograd/profile_part.h"

struct lf_profile {
    lf_profile_part *first, **last; /* in the order of watching */
};

lf_profile *lf_profile_create(void)
{
    lf_profile *p = calloc(1, sizeof *p);
    LF_REQUIRE(p, "out of memory for a profile");
    p->last = &p->first;
    return p;
}

void lf_profile_free(lf_profile *p)
{
    for (lf_profile_part *part = p ? p->first : NULL; part;) {
        lf_profile_part *next = part->next;
        lf_part_free(part);
        part = next;
    }
    free(p);
}

void lf_profile_watch(lf_profile *p, lf_tape *tape, int team)
{
    lf_profile_part *part = p ? lf_part_create(tape, team) : NULL;
    lf_tape_set_part(tape, part);
    if (!p)
        return;
    *p->last = part;
    p->last = &part->next;
}

void lf_profile_join(lf_profile *to, lf_profile *from)
{
    if (!from->first)
        return;
    *to->last = from->first;
    to->last = from->last;
    *from = (lf_profile){.last = &from->first};
}

/* ---- sums ---- */

typedef struct sums {
    lf_profile_row *row;
    int count, room;
} sums;

static bool same(const lf_profile_row *a, const lf_profile_row *b)
{
    return strcmp(a->scope, b->scope) == 0 &&
           (a->op == b->op || (a->op && b->op && strcmp(a->op, b->op) == 0));
}

/* Add to the row of the same scope and op, or as a new one. */
static void add_row(sums *s, const lf_profile_row *row)
{
    for (int i = 0; i < s->count; i++) {
        lf_profile_row *to = &s->row[i];
        if (!same(to, row))
            continue;
        to->calls += row->calls;
        to->unknown += row->unknown;
        to->forward += row->forward;
        to->backward += row->backward;
        to->products[0] += row->products[0];
        to->products[1] += row->products[1];
        to->bytes += row->bytes;
        return;
    }
    if (s->count == s->room) {
        s->room = s->room ? 2 * s->room : 64;
        s->row = realloc(s->row, (size_t)s->room * sizeof *s->row);
        LF_REQUIRE(s->row, "out of memory for %d rows of a profile", s->room);
    }
    s->row[s->count++] = *row;
}

static lf_profile_row row_of(const lf_profile_part *part, const lf_profile_entry *e)
{
    const double share = part->team ? 1 / (double)part->team : 1;
    lf_profile_row row = {.op = e->op,
                          .calls = e->calls,
                          .unknown = e->unknown,
                          .forward = share * e->seconds[0],
                          .backward = share * e->seconds[1],
                          .products = {e->products[0], e->products[1]},
                          .bytes = e->bytes};
    memcpy(row.scope, part->scope[e->scope].path, sizeof row.scope);
    return row;
}

static bool is_team(const lf_profile_row *row)
{
    return !row->op && strcmp(row->scope, LF_SCOPE_TEAM) == 0;
}

/* All rows of the teams' tapes; returns their seconds. */
static double add_teams(const lf_profile *p, sums *s)
{
    double seconds = 0;
    for (const lf_profile_part *part = p->first; part; part = part->next)
        for (int i = 0; part->team && i < part->entries; i++) {
            const lf_profile_row row = row_of(part, &part->entry[i]);
            seconds += row.forward + row.backward;
            add_row(s, &row);
        }
    return seconds;
}

/* By scope and op. The team's time on the step's tape becomes what no thread of it used. */
static sums add_parts(const lf_profile *p)
{
    sums s = {NULL, 0, 0};
    bool added = false;
    for (const lf_profile_part *part = p->first; part; part = part->next)
        for (int i = 0; !part->team && i < part->entries; i++) {
            lf_profile_row row = row_of(part, &part->entry[i]);
            if (is_team(&row) && !added) {
                row.forward -= add_teams(p, &s);
                added = true;
            }
            add_row(&s, &row);
        }
    if (!added)
        add_teams(p, &s);
    return s;
}

int lf_profile_rows(const lf_profile *p, lf_profile_by by, lf_profile_row **rows)
{
    sums both = add_parts(p), grouped = {NULL, 0, 0};
    for (int i = 0; by != LF_BY_BOTH && i < both.count; i++) {
        lf_profile_row row = both.row[i];
        if (by == LF_BY_SCOPE)
            row.op = NULL;
        else if (!is_team(&row))
            row.scope[0] = 0;
        add_row(&grouped, &row);
    }
    if (by == LF_BY_BOTH) {
        *rows = both.row;
        return both.count;
    }
    free(both.row);
    *rows = grouped.row;
    return grouped.count;
}
