/* transformer.c: one block of the ray -> point transformer                        [method.md 5a.5]
 *
 *   1. rays    r <- W2 act(W1 [r ; F] + b)      per type; W1 [r ; F] = W1r r + W1F F, and the
 * second product is made once a point and not once a ray
 *   2. point   k, v = TFN kernels of r along d;  q = B F;  o = attention
 *              F <- F + W o     or, with skip_linear,  F <- o + W F
 */
#include "layers/layers.h"

void lf_transformer_block_init(lf_store *store, lf_transformer_block *block, const char *prefix,
                               const lf_transformer_config *config, long ray0, long ray1)
{
    const long c0 = config->scalars, c1 = config->vectors;
    char name[96];
    *block = (lf_transformer_block){.config = *config, .has_vector = c1 > 0};
    snprintf(name, sizeof name, "%s.from_ray", prefix);
    lf_self_interaction_init(store, &block->from_ray, name, ray0, ray1, c0, c1);
    snprintf(name, sizeof name, "%s.from_point", prefix);
    lf_self_interaction_init(store, &block->from_point, name, c0, c1, c0, c1);
    snprintf(name, sizeof name, "%s.nonlinear", prefix);
    lf_nonlinear_init(store, &block->nonlinear, name, config->nonlinearity, c0, c1);
    snprintf(name, sizeof name, "%s.out_ray", prefix);
    lf_self_interaction_init(store, &block->out_ray, name, c0, c1, c0, c1);
    snprintf(name, sizeof name, "%s.keys_values0", prefix);
    lf_linear_init(store, &block->keys_values0, name, c0 + c1, 2 * c0, false, 1);
    if (c1) {
        snprintf(name, sizeof name, "%s.keys_values1", prefix);
        const long paths = c0 + (config->degree2 ? 3 : 2) * c1;
        lf_linear_init(store, &block->keys_values1, name, paths, 2 * c1, false, 1);
    }
    snprintf(name, sizeof name, "%s.query", prefix);
    lf_self_interaction_init(store, &block->query, name, c0, c1, c0, c1);
    snprintf(name, sizeof name, "%s.mix", prefix);
    lf_self_interaction_init(store, &block->mix, name, c0, c1, c0, c1);
}

/* [Q, ..] added to every view of [Q, V, ..], per type; a side may lack vectors. */
static lf_field add_point(lf_tape *tape, lf_field rays, lf_field point, const lf_ray_geometry *g)
{
    lf_field sum = {lf_add_group(tape, rays.scalar, point.scalar), rays.vector};
    if (!point.vector)
        return sum;
    if (!rays.vector) { /* rays of the first block carry no vectors yet */
        const long c = lf_cols(point.vector);
        lf_tensor *zero = lf_tensor_new(tape, 4, LF_DIMS(g->points, g->views, 3, c));
        memset(zero->value, 0, (size_t)zero->size * sizeof(lf_real));
        sum.vector = lf_add_group(tape, zero, point.vector);
    } else {
        sum.vector = lf_add_group(tape, rays.vector, point.vector);
    }
    return sum;
}

void lf_transformer_block_apply(lf_tape *tape, const lf_transformer_block *block, lf_field *rays,
                                lf_field *point, const lf_ray_geometry *geometry)
{
    const lf_transformer_config *c = &block->config;
    lf_scope(tape, "rays");
    lf_field hidden =
        add_point(tape, lf_self_interaction_apply(tape, &block->from_ray, *rays),
                  lf_self_interaction_apply(tape, &block->from_point, *point), geometry);
    hidden = lf_nonlinear_apply(tape, &block->nonlinear, hidden);
    *rays = lf_self_interaction_apply(tape, &block->out_ray, hidden);
    lf_scope_end(tape);

    lf_scope(tape, "attention");
    const lf_field paths = lf_tfn_paths(tape, *rays, geometry, c->degree2);
    lf_field kv = {lf_linear_apply(tape, &block->keys_values0, paths.scalar, LF_IDENTITY), NULL};
    if (block->has_vector)
        kv.vector = lf_linear_apply(tape, &block->keys_values1, paths.vector, LF_IDENTITY);
    const lf_field query = lf_self_interaction_apply(tape, &block->query, *point);
    const lf_field heard = lf_ray_attention(tape, query, kv, geometry, c->heads);

    const lf_field mixed =
        lf_self_interaction_apply(tape, &block->mix, c->skip_linear ? *point : heard);
    const lf_field kept = c->skip_linear ? heard : *point;
    point->scalar = lf_add(tape, kept.scalar, mixed.scalar);
    if (block->has_vector)
        point->vector = lf_add(tape, kept.vector, mixed.vector);
    lf_scope_end(tape);
}
