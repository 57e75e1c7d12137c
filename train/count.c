/* count.c: see count.h. */
#include <jansson.h>

#include "autograd/atomic_file.h"
#include "train/count.h"
#include "train/task.h"

enum { WHOLE_STEP = 3 }; /* a backward takes two products where the forward takes one */

static double mega(double macs)
{
    return 2e-6 * macs;
}

static void print_cost(const lf_cost *c, const char *type, long parameters, FILE *out)
{
    fprintf(out, "%s\n%-12s %12s %14s  of\n", type, "part", "parameters", "MFLOP forward");
    for (int i = 0; i < c->parts; i++)
        fprintf(out, "%-12s %12ld %14.6g  %s\n", c->part[i].name, c->part[i].parameters,
                mega(c->part[i].macs), c->part[i].of);
    fprintf(out, "%-12s %12ld %14.6g  a training step: %s\n", "all", parameters, mega(c->step_macs),
            c->step);
    fprintf(out, "%-12s %12s %14.6g  the same with its backward, by three\n", "", "",
            WHOLE_STEP * mega(c->step_macs));
}

static json_t *cost_json(const lf_cost *c, const char *type, long parameters)
{
    json_t *parts = json_array();
    for (int i = 0; i < c->parts; i++)
        json_array_append_new(parts,
                              json_pack("{s:s, s:I, s:f, s:s}", "part", c->part[i].name,
                                        "parameters", (json_int_t)c->part[i].parameters,
                                        "flop_forward", 2 * c->part[i].macs, "of", c->part[i].of));
    return json_pack("{s:s, s:s, s:I, s:o, s:{s:s, s:f, s:f}}", "experiment", "count", "model",
                     type, "parameters", (json_int_t)parameters, "parts", parts, "step", "of",
                     c->step, "flop_forward", 2 * c->step_macs, "flop",
                     2 * WHOLE_STEP * c->step_macs);
}

static lf_status write_cost(const char *path, json_t *json, lf_error *err)
{
    char *text = json ? json_dumps(json, JSON_INDENT(2) | JSON_REAL_PRECISION(9)) : NULL;
    json_decref(json);
    LF_REQUIRE(text, "%s: the JSON could not be made", path);
    const lf_bytes pieces[] = {{text, strlen(text)}, {"\n", 1}};
    const lf_status status = lf_atomic_write(path, pieces, 2, NULL, err);
    free(text);
    return status;
}

lf_status lf_count(const lf_config *cfg, FILE *out, const char *json, lf_error *err)
{
    const lf_task_options options = {.quiet = true};
    const char *type = lf_config_choice(cfg, "model.type");
    lf_task task;
    lf_task_create(cfg, &options, &task);
    lf_cost cost = {0};
    task.count(task.self, &cost);
    const long parameters = lf_store_trainable(task.store);
    lf_status status = LF_OK;
    if (out)
        print_cost(&cost, type, parameters, out);
    if (json)
        status = write_cost(json, cost_json(&cost, type, parameters), err);
    lf_task_free(&task);
    return status;
}

/* ---- for the tasks ---- */

void lf_cost_add(lf_cost *cost, const char *name, long parameters, double macs, const char *of)
{
    LF_REQUIRE(cost->parts < LF_COST_PARTS, "more than %d parts", LF_COST_PARTS);
    lf_cost_part *p = &cost->part[cost->parts++];
    *p = (lf_cost_part){.name = name, .parameters = parameters, .macs = macs};
    snprintf(p->of, sizeof p->of, "%s", of);
}

long lf_trainable_in(const lf_store *store, const char *prefix)
{
    long n = 0;
    for (int i = 0; i < lf_store_count(store); i++) {
        const lf_parameter *p = lf_store_at(store, i);
        if (p->trainable && strncmp(p->name, prefix, strlen(prefix)) == 0)
            n += p->size;
    }
    return n;
}
