/* test_checkpoint.c: a model's checkpoint: every bit back, and what does not fit refused. */
#include <sys/stat.h>
#include <unistd.h>

#include "autograd/random.h"
#include "models/checkpoint.h"
#include "tests/close.h"
#include "tests/recon_net.h"

typedef struct saved {
    char folder[64], path[96];
    net net;
    lf_adam adam;
    lf_training_state state;
} saved;

static void fill(lf_real *x, long n, uint64_t item)
{
    lf_stream s = lf_stream_at(21, LF_RANDOM_TEST, 0, item);
    for (long i = 0; i < n; i++)
        x[i] = (lf_real)lf_normal(&s);
}

static void open_saved(saved *c)
{
    static const lf_adam_config adam = {0.9, 0.999, 1e-8, 0, false};
    lf_error err;
    snprintf(c->folder, sizeof c->folder, "/tmp/elf-test-recon-XXXXXX");
    assert_non_null(mkdtemp(c->folder));
    snprintf(c->path, sizeof c->path, "%s/a.safetensors", c->folder);
    open_net(&c->net, NULL);
    lf_adam_init(&c->adam, &adam, c->net.store);
    fill(c->adam.m, c->adam.size, 1);
    fill(c->adam.v, c->adam.size, 2);
    c->adam.steps = 1234567;
    c->state = (lf_training_state){
        .step = 1234570, .skipped = 3, .bad_in_a_row = 2, .seconds = 0.1 + 1e-9};
    assert_int_equal(
        lf_checkpoint_write(c->path, c->net.store, &c->adam, &c->state, c->net.cfg, NULL, &err),
        LF_OK);
}

static void close_saved(saved *c)
{
    unlink(c->path);
    assert_int_equal(rmdir(c->folder), 0); /* nothing else was left there */
    lf_adam_free(&c->adam);
    close_net(&c->net);
}

static void checkpoint_keeps_every_bit(void **state)
{
    (void)state;
    saved c;
    open_saved(&c);
    lf_error err;
    lf_config *cfg;
    lf_training_state where;
    assert_int_equal(lf_checkpoint_config(c.path, &cfg, &where, &err), LF_OK);
    char *a = lf_config_text(cfg), *b = lf_config_text(c.net.cfg);
    assert_string_equal(a, b);
    free(a);
    free(b);
    assert_true(where.step == c.state.step && where.skipped == 3 && where.bad_in_a_row == 2 &&
                where.seconds == c.state.seconds);
    lf_store *store = lf_store_create(99);
    lf_recon model;
    const lf_recon_config config = lf_recon_config_from(cfg);
    lf_recon_init(&model, store, &config);
    lf_adam adam;
    lf_adam_init(&adam, &c.adam.config, store);
    assert_int_equal(lf_checkpoint_read(c.path, store, &adam, &err), LF_OK);
    assert_int_equal(adam.steps, c.adam.steps);
    for (int i = 0; i < lf_store_count(store); i++) {
        const lf_parameter *p = lf_store_at(store, i), *q = lf_store_at(c.net.store, i);
        const size_t bytes = (size_t)p->size * sizeof(lf_real);
        assert_memory_equal(lf_values(p), lf_values(q), bytes);
        if (!p->trainable)
            continue;
        assert_memory_equal(adam.m + p->offset, c.adam.m + q->offset, bytes);
        assert_memory_equal(adam.v + p->offset, c.adam.v + q->offset, bytes);
    }
    lf_adam_free(&adam);
    lf_recon_free(&model);
    lf_store_free(store);
    lf_config_free(cfg);
    close_saved(&c);
}

/* Reading `path` fails with this in its message; store and optimiser stay as they were. */
static void assert_refused(saved *c, const char *path, const char *words)
{
    const size_t bytes = (size_t)c->adam.size * sizeof(lf_real);
    lf_real *before = malloc(2 * bytes);
    assert_non_null(before);
    fill(lf_store_values(c->net.store), c->adam.size, 5);
    memcpy(before, lf_store_values(c->net.store), bytes);
    memcpy(before + c->adam.size, c->adam.m, bytes);
    lf_error err = {""};
    assert_int_equal(lf_checkpoint_read(path, c->net.store, &c->adam, &err), LF_BAD_INPUT);
    if (!strstr(err.text, words) || !strstr(err.text, path))
        fail_msg("\"%s\" should name the file and hold \"%s\"", err.text, words);
    assert_memory_equal(lf_store_values(c->net.store), before, bytes);
    assert_memory_equal(c->adam.m, before + c->adam.size, bytes);
    assert_int_equal(c->adam.steps, 1234567);
    free(before);
}

static void truncated_checkpoint(void **state)
{
    (void)state;
    static const int parts[] = {0, 1, 8, 50, 99};
    saved c;
    open_saved(&c);
    struct stat st;
    assert_int_equal(stat(c.path, &st), 0);
    for (int i = 4; i >= 0; i--) {
        assert_int_equal(truncate(c.path, st.st_size * parts[i] / 100), 0);
        assert_refused(&c, c.path, "");
        lf_config *cfg = NULL;
        lf_error err;
        assert_int_equal(lf_checkpoint_config(c.path, &cfg, NULL, &err), LF_BAD_INPUT);
        assert_null(cfg);
    }
    close_saved(&c);
}

/* The file written again with a change: array `skip` left out, array `reshape` flat, one added. */
static void rewrite(const saved *c, const char *skip, const char *reshape, const char *add,
                    const char *drop_meta)
{
    static const char *const keys[] = {"format",  "step",         "adam_steps", "seconds",
                                       "skipped", "bad_in_a_row", "config"};
    lf_safetensors *file;
    lf_error err;
    if (lf_safetensors_open(c->path, &file, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_array array[1024];
    const float number = 1;
    int n = 0, metas = 0;
    for (int i = 0; i < lf_safetensors_count(file); i++) {
        array[n] = *lf_safetensors_at(file, i);
        if (skip && strcmp(array[n].name, skip) == 0)
            continue;
        if (reshape && strcmp(array[n].name, reshape) == 0) {
            assert_int_equal(array[n].rank, 2);
            array[n].dim[0] *= array[n].dim[1];
            array[n].rank = 1;
        }
        n++;
    }
    if (add)
        array[n++] = (lf_array){.name = add, .dtype = LF_F32, .data = &number};
    lf_meta meta[16];
    for (int k = 0; k < 7; k++)
        if (!drop_meta || strcmp(keys[k], drop_meta) != 0)
            meta[metas++] = (lf_meta){keys[k], lf_safetensors_meta(file, keys[k])};
    if (lf_safetensors_write(c->path, array, n, meta, metas, NULL, &err) != LF_OK)
        fail_msg("%s", err.text);
    lf_safetensors_close(file);
}

static void checkpoints_that_do_not_fit(void **state)
{
    (void)state;
    static const struct {
        const char *skip, *reshape, *add, *drop_meta, *words;
    } cases[] = {
        {NULL, NULL, NULL, "format", "not a checkpoint of elf"},
        {NULL, NULL, NULL, "step", "not a checkpoint of elf"},
        {"head.0.weight", NULL, NULL, NULL, "head.0.weight"},
        {"adam.m.head.0.weight", NULL, NULL, NULL, "adam.m.head.0.weight"},
        {"adam.v.head.0.bias", NULL, NULL, NULL, "adam.v.head.0.bias"},
        {NULL, "head.0.weight", NULL, NULL, "head.0.weight"},
        {NULL, "adam.v.head.1.weight", NULL, NULL, "adam.v.head.1.weight"},
        {NULL, NULL, "block7.query.scalar.weight", NULL, "another model"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        saved c;
        open_saved(&c);
        rewrite(&c, cases[i].skip, cases[i].reshape, cases[i].add, cases[i].drop_meta);
        assert_refused(&c, c.path, cases[i].words);
        close_saved(&c);
    }
}

static void checkpoint_of_another_model(void **state)
{
    (void)state;
    static const char *const others[] = {"model.blocks=1", "model.blocks=3", "model.scalars=12",
                                         "model.backbone=plain", "model.nonlinearity=gated"};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
        saved c;
        open_saved(&c);
        net other;
        lf_adam adam;
        open_net(&other, others[i]);
        lf_adam_init(&adam, &c.adam.config, other.store);
        lf_error err;
        assert_int_equal(
            lf_checkpoint_write(c.path, other.store, &adam, &c.state, other.cfg, NULL, &err),
            LF_OK);
        assert_refused(&c, c.path, "");
        lf_adam_free(&adam);
        close_net(&other);
        close_saved(&c);
    }
}

static void numbers_out_of_range(void **state)
{
    (void)state;
    static const lf_training_state bad[] = {
        {.step = -1}, {.step = 1, .skipped = -5}, {.step = 1, .seconds = NAN}, {.seconds = -1}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        saved c;
        lf_error err;
        lf_config *cfg = NULL;
        open_saved(&c);
        lf_checkpoint_write(c.path, c.net.store, &c.adam, &bad[i], c.net.cfg, NULL, &err);
        assert_refused(&c, c.path, "not a checkpoint of elf");
        assert_int_equal(lf_checkpoint_config(c.path, &cfg, NULL, &err), LF_BAD_INPUT);
        close_saved(&c);
    }
}

static int refuse(void *user, const char *call)
{
    return strcmp(user, call) ? 0 : 28; /* ENOSPC */
}

static void a_full_disk_keeps_the_old_file(void **state)
{
    (void)state;
    static const char *const calls[] = {"open", "write", "fsync", "close", "rename"};
    saved c;
    open_saved(&c);
    for (int i = 0; i < 5; i++) {
        const lf_fault fault = {refuse, (void *)(uintptr_t)calls[i]};
        const lf_training_state later = {.step = 2000000};
        lf_error err = {""};
        assert_int_equal(
            lf_checkpoint_write(c.path, c.net.store, &c.adam, &later, c.net.cfg, &fault, &err),
            LF_FAILED);
        assert_non_null(strstr(err.text, "No space left"));
        lf_config *cfg;
        lf_training_state where;
        assert_int_equal(lf_checkpoint_config(c.path, &cfg, &where, &err), LF_OK);
        assert_int_equal(where.step, c.state.step);
        lf_config_free(cfg);
    }
    close_saved(&c); /* no temporary file stays */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(checkpoint_keeps_every_bit),
        cmocka_unit_test(truncated_checkpoint),
        cmocka_unit_test(checkpoints_that_do_not_fit),
        cmocka_unit_test(checkpoint_of_another_model),
        cmocka_unit_test(numbers_out_of_range),
        cmocka_unit_test(a_full_disk_keeps_the_old_file),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
