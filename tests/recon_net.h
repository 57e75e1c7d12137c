/* recon_net.h: a small reconstruction model with random weights, for the tests of the whole model.
 */
#ifndef LF_TESTS_RECON_NET_H
#define LF_TESTS_RECON_NET_H

#include "autograd/random.h"
#include "models/recon.h"
#include "tests/close.h"

/* `more`: "key=value;key=value", or NULL. */
static inline lf_config *make_config(const char *more)
{
    static const char *const sets[] = {
        "data.image_size=33", "model.stages=1, 1", "model.fields=2, 4", "model.stem_fields=2",
        "model.features=4",   "model.scalars=8",   "model.vectors=4",   "model.mlp=16",
        "model.point=4, 8",   "model.global=6",    "model.grid=5",      "model.volume=1, 1"};
    lf_config *cfg;
    lf_error err = {""};
    if (lf_config_load(NULL, &cfg, &err) != LF_OK)
        fail_msg("%s", err.text);
    for (size_t i = 0; i < sizeof sets / sizeof *sets; i++)
        assert_int_equal(lf_config_set(cfg, sets[i], &err), LF_OK);
    for (const char *at = more; at && *at; at += strcspn(at, ";") + (strchr(at, ';') != NULL)) {
        char set[96];
        snprintf(set, sizeof set, "%.*s", (int)strcspn(at, ";"), at);
        if (lf_config_set(cfg, set, &err) != LF_OK)
            fail_msg("%s", err.text);
    }
    assert_int_equal(lf_config_check(cfg, &err), LF_OK);
    return cfg;
}

/* A model whose biases, norms and running statistics are not those of a new one. */
typedef struct net {
    lf_config *cfg;
    lf_store *store;
    lf_recon model;
} net;

static inline void open_net(net *n, const char *more)
{
    n->cfg = make_config(more);
    n->store = lf_store_create(11);
    const lf_recon_config config = lf_recon_config_from(n->cfg);
    lf_recon_init(&n->model, n->store, &config);
    for (int i = 0; i < lf_store_count(n->store); i++) {
        const lf_parameter *p = lf_store_at(n->store, i);
        lf_stream s = lf_stream_at(9, LF_RANDOM_TEST, 3, lf_name_hash(p->name));
        for (long k = 0; p->rank == 1 && k < p->size; k++)
            lf_values(p)[k] += (lf_real)(0.3 * lf_uniform(&s));
    }
}

static inline void close_net(net *n)
{
    lf_recon_free(&n->model);
    lf_store_free(n->store);
    lf_config_free(n->cfg);
}

#endif
