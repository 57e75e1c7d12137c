/* store.c: named parameters in flat arrays of values and gradients. */
#include "autograd/autograd.h"
#include "autograd/random.h"

enum { PAD = 16 }; /* every parameter starts on a multiple of 16 numbers, so rows stay aligned */

struct lf_store {
    uint64_t seed;
    lf_parameter **parameter;
    int count, room;
    lf_real *value, *grad;
    long size, capacity;
};

lf_store *lf_store_create(uint64_t seed)
{
    lf_store *store = calloc(1, sizeof *store);
    LF_REQUIRE(store, "out of memory for a parameter store");
    store->seed = seed;
    return store;
}

void lf_store_free(lf_store *store)
{
    if (!store)
        return;
    for (int i = 0; i < store->count; i++)
        free(store->parameter[i]);
    free(store->parameter);
    free(store->value);
    free(store->grad);
    free(store);
}

/* Room to grow is not touched: the system gives no memory for it. */
static lf_real *regrow(lf_real *old, long used, long capacity)
{
    lf_real *grown = aligned_alloc(64, ((size_t)capacity * sizeof(lf_real) + 63) / 64 * 64);
    LF_REQUIRE(grown, "out of memory for %ld parameters", capacity);
    if (used)
        memcpy(grown, old, (size_t)used * sizeof(lf_real));
    free(old);
    return grown;
}

static void reserve(lf_store *store, long size)
{
    if (size <= store->capacity)
        return;
    long capacity = store->capacity ? store->capacity : 4096;
    while (capacity < size)
        capacity *= 2;
    store->value = regrow(store->value, store->size, capacity);
    store->grad = regrow(store->grad, store->size, capacity);
    store->capacity = capacity;
}

static void fill(lf_store *store, const lf_parameter *p, double mean, double deviation)
{
    lf_stream s = lf_stream_at(store->seed, LF_RANDOM_INIT, 0, lf_name_hash(p->name));
    for (long i = 0; i < p->size; i++)
        store->value[p->offset + i] =
            (lf_real)(deviation == 0 ? mean : mean + deviation * lf_normal(&s));
}

const lf_parameter *lf_store_add(lf_store *store, const char *name, int rank, const long *dim,
                                 double mean, double deviation, bool trainable)
{
    lf_parameter *p = calloc(1, sizeof *p);
    LF_REQUIRE(p && rank <= LF_MAX_RANK, "parameter %s of rank %d", name, rank);
    LF_REQUIRE(strlen(name) < sizeof p->name, "the name %s is too long", name);
    LF_REQUIRE(!lf_store_find(store, name), "two parameters are called %s", name);
    *p = (lf_parameter){
        .store = store, .rank = rank, .offset = store->size, .size = 1, .trainable = trainable};
    memcpy(p->name, name, strlen(name) + 1);
    for (int i = 0; i < rank; i++) {
        p->dim[i] = dim[i];
        p->size *= dim[i];
    }
    const long padded = (p->size + PAD - 1) / PAD * PAD;
    reserve(store, store->size + padded);
    memset(store->value + p->offset, 0, (size_t)padded * sizeof *store->value);
    memset(store->grad + p->offset, 0, (size_t)padded * sizeof *store->grad);
    store->size += padded;
    if (store->count == store->room) {
        store->room = store->room ? 2 * store->room : 64;
        store->parameter = realloc(store->parameter, (size_t)store->room * sizeof(lf_parameter *));
        LF_REQUIRE(store->parameter, "out of memory for %d parameters", store->room);
    }
    store->parameter[store->count++] = p;
    fill(store, p, mean, deviation);
    return p;
}

const lf_parameter *lf_store_find(const lf_store *store, const char *name)
{
    for (int i = 0; i < store->count; i++)
        if (strcmp(store->parameter[i]->name, name) == 0)
            return store->parameter[i];
    return NULL;
}

int lf_store_count(const lf_store *store)
{
    return store->count;
}

const lf_parameter *lf_store_at(const lf_store *store, int index)
{
    return store->parameter[index];
}

long lf_store_size(const lf_store *store)
{
    return store->size;
}

long lf_store_trainable(const lf_store *store)
{
    long n = 0;
    for (int i = 0; i < store->count; i++)
        n += store->parameter[i]->trainable ? store->parameter[i]->size : 0;
    return n;
}

lf_real *lf_store_values(const lf_store *store)
{
    return store->value;
}

lf_real *lf_store_grads(const lf_store *store)
{
    return store->grad;
}

lf_real *lf_values(const lf_parameter *p)
{
    return p->store->value + p->offset;
}

lf_real *lf_grads(const lf_parameter *p)
{
    return p->store->grad + p->offset;
}

void lf_store_zero_grads(lf_store *store)
{
    if (store->size)
        memset(store->grad, 0, (size_t)store->size * sizeof(lf_real));
}
