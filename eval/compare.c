/* compare.c: the figures of two mesh files. */
#include "eval/compare.h"
#include "eval/report.h"

typedef struct pair {
    lf_mesh *predicted, *truth;
} pair;

lf_compare_options lf_compare_defaults(void)
{
    return (lf_compare_options){.metric = lf_metric_defaults()};
}

static lf_status read_pair(const char *predicted, const char *truth, bool normalise, pair *meshes,
                           lf_error *err)
{
    lf_status status = lf_mesh_read(predicted, &meshes->predicted, NULL, err);
    if (status != LF_OK)
        return status;
    status = lf_mesh_read(truth, &meshes->truth, NULL, err);
    if (status != LF_OK || !normalise)
        return status;
    status = lf_mesh_normalise(meshes->predicted, err);
    if (status != LF_OK)
        return lf_error_context(err, status, "%s", predicted);
    status = lf_mesh_normalise(meshes->truth, err);
    return status == LF_OK ? LF_OK : lf_error_context(err, status, "%s", truth);
}

/* The occupancy used, or JSON null where an empty prediction needed none. */
static const char *occupancy_text(const lf_score *s, lf_occupancy occupancy)
{
    return s->empty ? NULL : lf_occupancy_name(occupancy);
}

/* The definitions, with what --normalise changes in them. */
static json_t *definitions(const lf_compare_options *options)
{
    json_t *metric = lf_metric_json(&options->metric);
    if (options->normalise)
        json_object_set_new(
            json_object_get(metric, "iou"), "normalisation",
            json_string("each mesh is first moved and scaled: box centred, box diagonal 1"));
    return metric;
}

static json_t *pair_json(const char *predicted, const char *truth, const pair *meshes,
                         const lf_compare_options *options, const lf_score *s)
{
    return json_pack("{s:s,s:s, s:f,s:f,s:f,s:f, s:b,s:b,s:f, s:I,s:I, s:s?,s:s, s:o}", /**/
                     "predicted", predicted, "truth", truth, "iou", s->iou, "chamfer_l1",
                     LF_CHAMFER_FACTOR * s->chamfer_l1, "accuracy", LF_CHAMFER_FACTOR * s->accuracy,
                     "completeness", LF_CHAMFER_FACTOR * s->completeness, "empty", (int)s->empty,
                     "normalised", (int)options->normalise, "longest_edge", s->edge,
                     "faces_predicted", (json_int_t)meshes->predicted->faces, "faces_truth",
                     (json_int_t)meshes->truth->faces, "occupancy_predicted",
                     occupancy_text(s, s->occupancy_predicted), "occupancy_truth",
                     lf_occupancy_name(s->occupancy_truth), "metric", definitions(options));
}

static lf_status put_json(const json_t *json, const char *path, FILE *out, lf_error *err)
{
    if (out && (json_dumpf(json, out, JSON_INDENT(2) | JSON_REAL_PRECISION(9)) ||
                fputc('\n', out) == EOF || fflush(out) == EOF))
        return lf_fail(err, LF_FAILED, "the figures could not be written");
    return path ? lf_json_write(path, json, err) : LF_OK;
}

static lf_status print_pair(const char *predicted, const char *truth, const pair *meshes,
                            const lf_compare_options *options, FILE *out, lf_error *err)
{
    lf_score score;
    const lf_status status =
        lf_score_meshes(meshes->predicted, meshes->truth, NULL, &options->metric, &score, err);
    if (status != LF_OK)
        return lf_error_context(err, status, "%s against %s", predicted, truth);
    json_t *json = pair_json(predicted, truth, meshes, options, &score);
    if (!json)
        return lf_fail(err, LF_BAD_INPUT, "a file name that is not UTF-8 cannot stand in JSON");
    const lf_status written = put_json(json, options->json, out, err);
    json_decref(json);
    return written;
}

lf_status lf_compare_meshes(const char *predicted, const char *truth,
                            const lf_compare_options *options, FILE *out, lf_error *err)
{
    pair meshes = {NULL, NULL};
    lf_status status = read_pair(predicted, truth, options->normalise, &meshes, err);
    if (status == LF_OK)
        status = print_pair(predicted, truth, &meshes, options, out, err);
    lf_mesh_free(meshes.predicted);
    lf_mesh_free(meshes.truth);
    return status;
}
