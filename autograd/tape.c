/* tape.c: the arena, its tensors, the list of nodes and the walk back.
 *
 * The arena is one block; what does not fit goes to overflow blocks, and the next reset joins all
 * of them (also those that a release has freed) into one, so that a tape reaches its final size
 * once and then never allocates.
 */
#include <stdalign.h>
#include "autograd/profile_part.h"
#include "autograd/spare.h"
#include <sys/mman.h>

/* A sanitizer build sees what is read or written beside a piece of the arena. */
#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/asan_interface.h>
enum { GUARD = 64 }; /* bytes behind every piece */
#else
#define ASAN_POISON_MEMORY_REGION(at, size) ((void)(at), (void)(size))
#define ASAN_UNPOISON_MEMORY_REGION(at, size) ((void)(at), (void)(size))
enum { GUARD = 0 };
#endif

enum {
    ALIGNMENT = LF_SPARE_ALIGNMENT,
    FIRST_BLOCK = 1 << 20,
    LARGEST_GROWTH = 256 << 20,
    FIRST_NODES = 256
};

typedef struct block {
    struct block *next;
    size_t size;
    alignas(ALIGNMENT) char data[];
} block;

struct lf_tape {
    block *blocks; /* the newest first */
    size_t used;   /* bytes of the newest block */
    size_t older;  /* bytes of all older blocks */
    size_t peak;
    lf_node *nodes;
    long node_count, node_room;
    bool grad, check;
    lf_spares spares; /* of gradients that were used up, and of dropped values */
    lf_spares lent;   /* of these, to the backward that runs */
    bool walking;
    lf_real *lane;
    long lane_first;
    char nonfinite[64];
    lf_profile_part *part; /* of the profile that watches; or NULL */
};

/* From the system and back to it: malloc would keep joined blocks beside their successor. */
static void block_free(block *b)
{
    ASAN_UNPOISON_MEMORY_REGION(b->data, b->size);
    munmap(b, sizeof(block) + b->size);
}

static block *block_create(size_t size)
{
    block *b = mmap(NULL, sizeof(block) + size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS,
                    -1, 0);
    LF_REQUIRE(b != MAP_FAILED, "out of memory: %zu bytes for a tape", size);
    b->next = NULL;
    b->size = size;
    ASAN_POISON_MEMORY_REGION(b->data, size);
    return b;
}

lf_tape *lf_tape_create(void)
{
    lf_tape *tape = calloc(1, sizeof *tape);
    LF_REQUIRE(tape, "out of memory for a tape");
    tape->grad = true;
    return tape;
}

static void free_blocks(lf_tape *tape)
{
    while (tape->blocks) {
        block *next = tape->blocks->next;
        block_free(tape->blocks);
        tape->blocks = next;
    }
    tape->used = tape->older = 0;
}

void lf_tape_free(lf_tape *tape)
{
    if (!tape)
        return;
    free_blocks(tape);
    free(tape->nodes);
    free(tape);
}

/* What lies behind the newest piece belongs to nobody. */
static void guard_rest(const lf_tape *tape)
{
    if (tape->blocks)
        ASAN_POISON_MEMORY_REGION(tape->blocks->data + tape->used, tape->blocks->size - tape->used);
}

void lf_tape_reset(lf_tape *tape)
{
    const size_t total = tape->blocks ? tape->older + tape->blocks->size : 0;
    if (tape->blocks && (tape->blocks->next || total < tape->peak)) {
        free_blocks(tape);
        tape->blocks = block_create(total > tape->peak ? total : tape->peak);
    }
    tape->used = tape->older = 0;
    guard_rest(tape);
    tape->node_count = 0;
    tape->spares.count = 0;
    tape->nonfinite[0] = 0;
    if (tape->part)
        lf_part_reset(tape->part);
}

void lf_tape_set_grad(lf_tape *tape, bool on)
{
    tape->grad = on;
}

void lf_tape_set_check(lf_tape *tape, bool on)
{
    tape->check = on;
}

const char *lf_tape_nonfinite(const lf_tape *tape)
{
    return tape->nonfinite[0] ? tape->nonfinite : NULL;
}

void lf_tape_set_part(lf_tape *tape, lf_profile_part *part)
{
    tape->part = part;
}

lf_profile_part *lf_tape_part(const lf_tape *tape)
{
    return tape->part;
}

void lf_tape_set_lane(lf_tape *tape, lf_real *lane, long first)
{
    tape->lane = lane;
    tape->lane_first = first;
}

size_t lf_tape_bytes(const lf_tape *tape)
{
    return tape->older + tape->used;
}

size_t lf_tape_peak(const lf_tape *tape)
{
    return tape->peak;
}

void *lf_alloc(lf_tape *tape, size_t bytes)
{
    const size_t whole = (bytes + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    bytes = whole + GUARD;
    if (!tape->blocks || bytes > tape->blocks->size - tape->used) {
        const size_t doubled = tape->blocks ? 2 * tape->blocks->size : FIRST_BLOCK;
        const size_t grown = doubled < LARGEST_GROWTH ? doubled : LARGEST_GROWTH;
        block *b = block_create(grown > bytes ? grown : bytes);
        b->next = tape->blocks;
        tape->older += tape->blocks ? tape->blocks->size : 0;
        tape->blocks = b;
        tape->used = 0;
    }
    void *p = tape->blocks->data + tape->used;
    ASAN_UNPOISON_MEMORY_REGION(p, whole);
    tape->used += bytes;
    if (lf_tape_bytes(tape) > tape->peak)
        tape->peak = lf_tape_bytes(tape);
    return p;
}

lf_mark lf_tape_mark(const lf_tape *tape)
{
    return (lf_mark){tape->blocks, tape->used};
}

void lf_tape_release(lf_tape *tape, lf_mark mark)
{
    while (tape->blocks != mark.block) {
        block *newest = tape->blocks;
        tape->blocks = newest->next;
        tape->older -= tape->blocks ? tape->blocks->size : 0;
        block_free(newest);
    }
    tape->used = mark.used;
    guard_rest(tape);
}

lf_real *lf_alloc_reals(lf_tape *tape, long n)
{
    LF_REQUIRE(n >= 0, "%ld numbers asked of a tape", n);
    return lf_alloc(tape, (size_t)n * sizeof(lf_real));
}

static lf_tensor *shape_only(lf_tape *tape, int rank, const long *dim)
{
    LF_REQUIRE(rank >= 0 && rank <= LF_MAX_RANK, "rank %d", rank);
    lf_tensor *t = lf_alloc(tape, sizeof *t);
    *t = (lf_tensor){.rank = rank, .size = 1};
    for (int i = 0; i < rank; i++) {
        LF_REQUIRE(dim[i] >= 0, "axis %d of a tensor has length %ld", i, dim[i]);
        t->dim[i] = dim[i];
        t->size *= dim[i];
    }
    return t;
}

static lf_real *take_spare(lf_tape *tape, long size)
{
    lf_real *spare = lf_spares_take(&tape->spares, size);
    if (spare)
        ASAN_UNPOISON_MEMORY_REGION(spare, (size_t)size * sizeof *spare);
    return spare;
}

static void give_spare(lf_tape *tape, lf_real *memory, long size)
{
    ASAN_POISON_MEMORY_REGION(memory, (size_t)size * sizeof *memory);
    lf_spares_give(&tape->spares, memory, size);
}

/* Spare memory, or else new. */
static lf_real *room(lf_tape *tape, long size)
{
    lf_real *spare = take_spare(tape, size);
    return spare ? spare : lf_alloc_reals(tape, size);
}

lf_tensor *lf_tensor_new(lf_tape *tape, int rank, const long *dim)
{
    lf_tensor *t = shape_only(tape, rank, dim);
    t->value = room(tape, t->size);
    return t;
}

lf_tensor *lf_tensor_like(lf_tape *tape, const lf_tensor *shape)
{
    return lf_tensor_new(tape, shape->rank, shape->dim);
}

lf_tensor *lf_tensor_cols(lf_tape *tape, const lf_tensor *x, long cols)
{
    LF_REQUIRE(x->rank >= 1, "a tensor of rank 0 has no last axis");
    long dim[LF_MAX_RANK];
    for (int i = 0; i < x->rank; i++)
        dim[i] = x->dim[i];
    dim[x->rank - 1] = cols;
    return lf_tensor_new(tape, x->rank, dim);
}

lf_tensor *lf_leaf(lf_tape *tape, int rank, const long *dim, lf_real *value, lf_real *grad)
{
    lf_tensor *t = shape_only(tape, rank, dim);
    t->value = value;
    t->grad = tape->grad ? grad : NULL;
    t->wants = t->grad != NULL;
    return t;
}

lf_tensor *lf_view(lf_tape *tape, lf_tensor *x, long offset, int rank, const long *dim)
{
    lf_tensor *t = shape_only(tape, rank, dim);
    LF_REQUIRE(offset >= 0 && offset + t->size <= x->size, "a view of %ld numbers from %ld of %ld",
               t->size, offset, x->size);
    t->value = x->value + offset;
    t->wants = tape->grad && x->wants;
    t->grad = t->wants && x->grad ? x->grad + offset : NULL;
    t->of = x;
    t->offset = offset;
    return t;
}

/* ---- gradients ---- */

lf_real *lf_scratch_reals(lf_tape *tape, long n)
{
    lf_real *spare = NULL;
    if (tape->walking && tape->lent.count < LF_SPARES)
        spare = take_spare(tape, n);
    if (!spare)
        return lf_alloc_reals(tape, n);
    lf_spares_give(&tape->lent, spare, n);
    return spare;
}

static void take_back(lf_tape *tape)
{
    for (int i = 0; i < tape->lent.count; i++)
        give_spare(tape, tape->lent.piece[i].memory, tape->lent.piece[i].size);
    tape->lent.count = 0;
}

static lf_real *zeroed(lf_tape *tape, long size)
{
    lf_real *memory = room(tape, size);
    memset(memory, 0, (size_t)size * sizeof *memory);
    return memory;
}

lf_real *lf_grad(lf_tape *tape, lf_tensor *t)
{
    if (t->of && t->wants) /* found anew: an earlier walk may have given the tensor's away */
        return t->grad = lf_grad(tape, t->of) + t->offset;
    if (!t->wants || t->grad)
        return t->grad;
    return t->grad = zeroed(tape, t->size);
}

lf_real *lf_grad_in_place(lf_tape *tape, lf_tensor *t)
{
    (void)tape;
    LF_REQUIRE(!t->of && !t->grad, "a gradient in the place of %s", t->of ? "a view" : "values");
    return t->grad = t->wants ? t->value : NULL;
}

/* ---- values that are made again ---- */

void lf_made_again_by(lf_tape *tape, lf_tensor *t, lf_backward_fn *again)
{
    t->node = t->wants ? tape->node_count : 0;
    t->passing = t->wants || !tape->grad;
    if (t->wants)
        tape->nodes[tape->node_count - 1].again = again;
}

void lf_drop(lf_tape *tape, lf_tensor *t)
{
    if (!t->passing || !t->value)
        return;
    t->dropped = true;
    give_spare(tape, t->value, t->size);
    t->value = NULL;
}

static void restore(lf_tape *tape, lf_tensor *t)
{
    if (t->of) {
        restore(tape, t->of);
        t->value = t->of->value + t->offset;
    } else if (!t->value) {
        const lf_node *node = &tape->nodes[t->node - 1];
        for (int i = 0; i < node->n_in; i++)
            if (node->in[i])
                restore(tape, node->in[i]);
        t->value = room(tape, t->size);
        node->again(node);
    }
}

/* The node that made t has run: nobody asks for t's gradient any more, nor for values that were
 * dropped once. */
static void give_back(lf_tape *tape, lf_tensor *t)
{
    if (t->grad)
        give_spare(tape, t->grad, t->size);
    t->grad = NULL;
    if (t->dropped)
        lf_drop(tape, t);
}

lf_tensor *lf_param(lf_tape *tape, const lf_parameter *p)
{
    lf_real *grad = NULL;
    if (p->trainable)
        grad = tape->lane ? tape->lane + (p->offset - tape->lane_first) : lf_grads(p);
    return lf_leaf(tape, p->rank, p->dim, lf_values(p), grad);
}

static bool all_finite(const lf_real *x, long n)
{
    lf_real sum = 0; /* 0 * x is NaN exactly for NaN and infinities */
    for (long i = 0; i < n; i++)
        sum += 0 * x[i];
    return sum == 0;
}

static void note_nonfinite(lf_tape *tape, const char *direction, const char *op)
{
    if (!tape->nonfinite[0])
        snprintf(tape->nonfinite, sizeof tape->nonfinite, "%s of %s", direction, op);
}

static void push(lf_tape *tape, const lf_node *node)
{
    if (tape->node_count == tape->node_room) {
        tape->node_room = tape->node_room ? 2 * tape->node_room : FIRST_NODES;
        tape->nodes = realloc(tape->nodes, (size_t)tape->node_room * sizeof *tape->nodes);
        LF_REQUIRE(tape->nodes, "out of memory for %ld nodes", tape->node_room);
    }
    tape->nodes[tape->node_count++] = *node;
}

void lf_record(lf_tape *tape, const char *op, lf_backward_fn *backward, void *saved, int n_in,
               lf_tensor *const *in, int n_out, lf_tensor *const *out)
{
    LF_REQUIRE(n_in <= LF_MAX_IN && n_out <= LF_MAX_OUT, "%s: %d inputs, %d outputs", op, n_in,
               n_out);
    lf_node node = {op, backward, NULL, tape, saved, n_in, n_out, {NULL}, {NULL}};
    bool wanted = false;
    for (int i = 0; i < n_in; i++) {
        node.in[i] = in[i];
        wanted = wanted || (in[i] && in[i]->wants);
    }
    for (int i = 0; i < n_out; i++) {
        node.out[i] = out[i];
        if (tape->check && !all_finite(out[i]->value, out[i]->size))
            note_nonfinite(tape, "forward", op);
        out[i]->wants = wanted && tape->grad;
    }
    const bool kept = wanted && tape->grad;
    if (kept)
        push(tape, &node);
    if (tape->part)
        lf_part_op(tape->part, op, kept ? tape->node_count - 1 : -1);
}

static void check_gradients(lf_tape *tape, const lf_node *node)
{
    for (int i = 0; i < node->n_in; i++)
        if (node->in[i] && node->in[i]->grad && !all_finite(node->in[i]->grad, node->in[i]->size))
            note_nonfinite(tape, "backward", node->op);
}

/* Run one node if anything reached its outputs; false: nothing did. */
static bool walk(lf_tape *tape, const lf_node *node)
{
    bool reached = false;
    for (int i = 0; i < node->n_out; i++)
        reached = reached || node->out[i]->grad;
    if (!reached)
        return false;
    for (int i = 0; i < node->n_out; i++) {
        restore(tape, node->out[i]);
        lf_grad(tape, node->out[i]);
    }
    for (int i = 0; i < node->n_in; i++)
        if (node->in[i]) {
            restore(tape, node->in[i]);
            lf_grad(tape, node->in[i]);
        }
    const lf_mark mark = lf_tape_mark(tape); /* what a backward allocates is scratch */
    tape->walking = true;
    node->backward(node);
    tape->walking = false;
    lf_tape_release(tape, mark);
    take_back(tape);
    if (tape->check)
        check_gradients(tape, node);
    for (int i = 0; i < node->n_out; i++)
        give_back(tape, node->out[i]);
    return true;
}

void lf_backward_from(lf_tape *tape)
{
    if (tape->part)
        lf_part_other(tape->part);
    for (long n = tape->node_count - 1; n >= 0; n--)
        if (walk(tape, &tape->nodes[n]) && tape->part)
            lf_part_backward(tape->part, n);
}

void lf_backward(lf_tape *tape, lf_tensor *loss, lf_real seed)
{
    LF_REQUIRE(loss->size == 1, "lf_backward: the loss has %ld elements, needs 1", loss->size);
    if (!loss->wants)
        return;
    lf_grad(tape, loss)[0] += seed;
    lf_backward_from(tape);
}
