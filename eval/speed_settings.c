/* speed_settings.c: see speed_settings.h. */
#include "eval/speed_settings.h"

enum { MOST_SETTINGS = 64, LF_SPEED_VIEWS = 8 /* of an object */ };

typedef struct list {
    const lf_config *cfg;
    lf_speed_setting *setting;
    long count;
} list;

static lf_speed_setting *add(list *l, const char *saving, const char *name)
{
    LF_REQUIRE(l->count < MOST_SETTINGS, "more than %d settings", (int)MOST_SETTINGS);
    lf_speed_setting *s = &l->setting[l->count++];
    *s = (lf_speed_setting){.saving = saving};
    snprintf(s->name, sizeof s->name, "%s", name);
    return s;
}

LF_PRINTF(2, 3)
static void set(lf_speed_setting *s, const char *format, ...)
{
    LF_REQUIRE(s->keys < LF_SPEED_KEYS, "more than %d keys", (int)LF_SPEED_KEYS);
    va_list args;
    va_start(args, format);
    vsnprintf(s->key[s->keys++], LF_SPEED_KEY, format, args);
    va_end(args);
}

lf_speed_setting lf_speed_join(const lf_speed_setting *a, const lf_speed_setting *b)
{
    lf_speed_setting both = *a;
    snprintf(both.name, sizeof both.name, "%.94s + %.94s", a->name, b->name);
    both.saving = "combination";
    both.f64 = a->f64 || b->f64;
    for (int i = 0; i < b->keys; i++)
        set(&both, "%s", b->key[i]);
    return both;
}

/* ---- what both families have ------------------------------------------------------------------
 */

/* 1, 2, 4, ... source views, fewer than `used`. */
static void add_views(list *l, long used)
{
    char name[LF_SPEED_NAME];
    for (long n = 1; n < used; n *= 2) {
        snprintf(name, sizeof name, "%ld source view%s", n, n > 1 ? "s" : "");
        set(add(l, "source views", name), "eval.sources=%ld", n);
    }
}

static void add_double(list *l)
{
    add(l, "precision", "in double")->f64 = true;
}

/* ---- reconstruction ---------------------------------------------------------------------------
 */

static void add_grids(list *l)
{
    const long fine = lf_config_int(l->cfg, "eval.resolution");
    const long coarse = lf_config_int(l->cfg, "eval.coarse");
    char name[LF_SPEED_NAME];
    for (long n = fine; n >= 4 && n > fine / 32; n /= 2) {
        if (n != coarse) {
            snprintf(name, sizeof name, n == fine ? "dense grid" : "coarse grid %ld", n);
            set(add(l, "coarse to fine", name), "eval.coarse=%ld", n);
        }
        if (n % 2)
            break;
    }
    for (long n = fine / 2; n >= 8 && n >= fine / 4 && fine % n == 0; n /= 2) {
        snprintf(name, sizeof name, "grid of %ld cells an edge", n);
        lf_speed_setting *s = add(l, "resolution", name);
        set(s, "eval.resolution=%ld", n);
        if (coarse > n)
            set(s, "eval.coarse=%ld", n);
    }
}

/* How steep a field may be that coarse to fine misses nothing of. */
static void add_slopes(list *l)
{
    static const char *const slope[] = {"0.5", "1", "2"};
    const double now = lf_config_real(l->cfg, "eval.lipschitz");
    char name[LF_SPEED_NAME];
    for (int i = 0; i < 3; i++) {
        const double x = strtod(slope[i], NULL);
        if (!(x < now) && !(x > now))
            continue;
        snprintf(name, sizeof name, "slope %s trusted", slope[i]);
        set(add(l, "slope", name), "eval.lipschitz=%s", slope[i]);
    }
}

/* Views of 3/4, 1/2 and 1/4 of the size, as 32 k + 1 from 33 on; without any of those, of half of
 * it, odd. */
static void add_image_sizes(list *l)
{
    const long size = lf_config_int(l->cfg, "data.image_size");
    long last = size;
    char name[LF_SPEED_NAME];
    for (long quarters = 3; quarters >= 1; quarters--) {
        const long n = (quarters * size + 64) / 128 * 32 + 1;
        if (n < 33 || n >= last)
            continue;
        last = n;
        snprintf(name, sizeof name, "views of %ld pixels", n);
        set(add(l, "image size", name), "data.image_size=%ld", n);
    }
    if (last == size && size / 2 >= 3) {
        snprintf(name, sizeof name, "views of %ld pixels", size / 2 | 1);
        set(add(l, "image size", name), "data.image_size=%ld", size / 2 | 1);
    }
}

static void list_reconstruction(list *l)
{
    const long fine = lf_config_int(l->cfg, "eval.resolution");
    const long coarse = lf_config_int(l->cfg, "eval.coarse");
    const long sources = lf_config_int(l->cfg, "eval.sources");
    const bool all = sources == 0 || sources == LF_SPEED_VIEWS;
    lf_speed_setting *s = add(l, "reference", "exact: double, dense, all views");
    s->f64 = true;
    set(s, "eval.coarse=%ld", fine);
    set(s, "eval.sources=0");
    add(l, "none", "as configured");
    if (!all || coarse == fine) {
        s = add(l, "all", "exact savings only");
        set(s, "eval.coarse=%ld", coarse < fine || fine % 4 ? coarse : fine / 4);
        set(s, "eval.sources=0");
    }
    add_grids(l);
    add_slopes(l);
    if (!all)
        set(add(l, "source views", "all source views"), "eval.sources=0");
    add_views(l, all ? LF_SPEED_VIEWS : sources);
    add_image_sizes(l);
    add_double(l);
}

/* ---- rendering --------------------------------------------------------------------------------
 */

static void add_samples(list *l)
{
    const long samples = lf_config_int(l->cfg, "render.samples");
    const long fine = lf_config_int(l->cfg, "render.fine_samples");
    char name[LF_SPEED_NAME];
    for (long quarters = 1; quarters <= 8; quarters *= 2) {
        const long n = samples * quarters / 4, more = fine * quarters / 4;
        if (quarters == 4 || n < 2 || n > 1024 || more > 1024 || (fine > 0 && more < 1))
            continue;
        snprintf(name, sizeof name, fine > 0 ? "%ld + %ld samples" : "%ld samples", n, more);
        lf_speed_setting *s = add(l, "samples", name);
        set(s, "render.samples=%ld", n);
        if (n <= lf_config_int(l->cfg, "train.seen_samples")) /* means nothing here, is checked */
            set(s, "train.seen_samples=%ld", n - 1);
        if (fine > 0)
            set(s, "render.fine_samples=%ld", more);
    }
}

static void add_switch(list *l, const char *key)
{
    const bool on = lf_config_bool(l->cfg, key);
    char name[LF_SPEED_NAME];
    snprintf(name, sizeof name, "%s %s", key + strlen("eval."), on ? "off" : "on");
    set(add(l, key + strlen("eval."), name), "%s=%s", key, on ? "false" : "true");
}

/* Thresholds other than the config's; `off` where it has one. */
static void add_thresholds(list *l, const char *key, const char *off, int count,
                           const char *const *value)
{
    const double now = lf_config_real(l->cfg, key), nothing = strtod(off, NULL);
    char name[LF_SPEED_NAME];
    if (now > nothing) {
        snprintf(name, sizeof name, "%s off", key + strlen("eval."));
        set(add(l, key + strlen("eval."), name), "%s=%s", key, off);
    }
    for (int i = 0; i < count; i++) {
        const double x = strtod(value[i], NULL);
        if (!(x < now) && !(x > now))
            continue;
        snprintf(name, sizeof name, "%s %s", key + strlen("eval."), value[i]);
        set(add(l, key + strlen("eval."), name), "%s=%s", key, value[i]);
    }
}

/* Everything that may be left out is computed; eval.skip_unseen means nothing to IBRNet. */
static void leave_out_nothing(lf_speed_setting *s)
{
    set(s, "eval.skip_unseen=false");
    set(s, "eval.skip_outside=false");
    set(s, "eval.stop=0");
    set(s, "eval.empty=-1");
    set(s, "eval.shrink=1");
}

/* How many of the inexact savings the config has on. */
static int inexact_savings(const lf_config *cfg)
{
    return lf_config_bool(cfg, "eval.skip_outside") + (lf_config_real(cfg, "eval.stop") > 0) +
           (lf_config_real(cfg, "eval.empty") >= 0) + (lf_config_int(cfg, "eval.shrink") > 1);
}

static void list_rendering(list *l)
{
    static const char *const some[] = {"0.002", "0.02"};
    const bool equivariant = lf_config_is(l->cfg, "model.type", "renderer");
    const bool unseen = equivariant && lf_config_bool(l->cfg, "eval.skip_unseen");
    const long sources = lf_config_int(l->cfg, "eval.sources");
    const long shrink = lf_config_int(l->cfg, "eval.shrink");
    const int inexact = inexact_savings(l->cfg);
    char name[LF_SPEED_NAME];
    lf_speed_setting *s = add(l, "reference", "exact: double, nothing left out");
    s->f64 = true;
    leave_out_nothing(s);
    add(l, "none", "as configured");
    if (inexact || unseen)
        leave_out_nothing(add(l, "all", "nothing left out"));
    if (equivariant && inexact) {
        s = add(l, "all", "exact savings only");
        leave_out_nothing(s);
        set(s, "eval.skip_unseen=true");
    }
    add_samples(l);
    add_views(l, sources ? sources : lf_config_int(l->cfg, "render.sources"));
    if (lf_config_int(l->cfg, "render.fine_samples") > 0) {
        add_thresholds(l, "eval.stop", "0", 2, some);
        add_thresholds(l, "eval.empty", "-1", 2, some);
    }
    add_switch(l, "eval.skip_outside");
    if (equivariant)
        add_switch(l, "eval.skip_unseen");
    if (shrink <= 8) {
        snprintf(name, sizeof name, "pictures at 1/%ld", 2 * shrink);
        set(add(l, "image size", name), "eval.shrink=%ld", 2 * shrink);
    }
    add_double(l);
}

/* ---- the list ---------------------------------------------------------------------------------
 */

bool lf_speed_allowed(const lf_config *cfg, const lf_speed_setting *s)
{
    lf_config *changed;
    char *text = lf_config_text(cfg);
    lf_status status = lf_config_parse_text(text, "a config", &changed, NULL);
    free(text);
    LF_REQUIRE(status == LF_OK, "a config does not survive being written");
    for (int i = 0; status == LF_OK && i < s->keys; i++)
        status = lf_config_set(changed, s->key[i], NULL);
    if (status == LF_OK)
        status = lf_config_check(changed, NULL);
    lf_config_free(changed);
    return status == LF_OK;
}

lf_speed_setting *lf_speed_settings(const lf_config *cfg, long *count)
{
    list l = {cfg, calloc(MOST_SETTINGS, sizeof *l.setting), 0};
    LF_REQUIRE(l.setting, "out of memory for settings");
    if (lf_config_renders(cfg))
        list_rendering(&l);
    else
        list_reconstruction(&l);
    *count = 0;
    for (long i = 0; i < l.count; i++)
        if (i < LF_SPEED_FIRST || lf_speed_allowed(cfg, &l.setting[i]))
            l.setting[(*count)++] = l.setting[i];
    return l.setting;
}
