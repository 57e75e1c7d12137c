/* raw_results.c: see raw_results.h. */
#include "eval/raw_results.h"

#include "autograd/safetensors.h"

#define FORMAT "elf-raw-1"
#define WHOLE "of the whole process"
#define EACH "of each item"

enum { NAME = 48, PARTS = 8 };

lf_raw *lf_raw_create(long items)
{
    lf_raw *raw = calloc(1, sizeof *raw);
    LF_REQUIRE(raw && items >= 0, "out of memory");
    raw->items = items;
    raw->item = calloc((size_t)items + 1, sizeof *raw->item);
    LF_REQUIRE(raw->item, "out of memory for %ld items", items);
    return raw;
}

void lf_raw_free(lf_raw *raw)
{
    for (long i = 0; raw && i < raw->items; i++) {
        free(raw->item[i].number);
        lf_mesh_free(raw->item[i].mesh);
    }
    if (raw)
        free(raw->item);
    free(raw);
}

/* ---- writing ----------------------------------------------------------------------------------
 */

typedef struct writer {
    lf_array *array;
    char (*name)[NAME];
    int64_t **face; /* owned */
    int arrays;
} writer;

static void add(writer *w, long item, const char *what, lf_dtype dtype, int rank, long rows,
                long columns, const void *data)
{
    snprintf(w->name[w->arrays], NAME, "%ld.%s", item, what);
    w->array[w->arrays] = (lf_array){.name = w->name[w->arrays],
                                     .dtype = dtype,
                                     .rank = rank,
                                     .dim = {rows, columns},
                                     .data = data};
    w->arrays++;
}

static int64_t *wide_faces(const lf_mesh *mesh)
{
    int64_t *face = malloc((size_t)mesh->faces * 3 * sizeof *face + 1);
    LF_REQUIRE(face, "out of memory for %ld faces", mesh->faces);
    for (long i = 0; i < 3 * mesh->faces; i++)
        face[i] = mesh->face[i / 3][i % 3];
    return face;
}

static void add_item(writer *w, long i, const lf_raw_item *item)
{
    add(w, i, "seconds", LF_F64, 0, 0, 0, &item->seconds);
    add(w, i, "cpu_seconds", LF_F64, 0, 0, 0, &item->cpu_seconds);
    add(w, i, "before_mb", LF_F64, 0, 0, 0, &item->before_mb);
    add(w, i, "peak_mb", LF_F64, 0, 0, 0, &item->peak_mb);
    add(w, i, "work", LF_F64, 0, 0, 0, &item->work);
    add(w, i, "numbers", LF_F64, 1, item->numbers, 0, item->number);
    if (!item->mesh)
        return;
    w->face[i] = wide_faces(item->mesh);
    add(w, i, "vertices", LF_F64, 2, item->mesh->vertices, 3, item->mesh->vertex);
    add(w, i, "faces", LF_I64, 2, item->mesh->faces, 3, w->face[i]);
}

lf_status lf_raw_write(const char *path, const lf_raw *raw, lf_error *err)
{
    const size_t most = (size_t)raw->items * PARTS + 1;
    writer w = {calloc(most, sizeof *w.array), calloc(most, sizeof *w.name),
                calloc((size_t)raw->items + 1, sizeof *w.face), 0};
    LF_REQUIRE(w.array && w.name && w.face, "out of memory for %ld items", raw->items);
    char items[24];
    snprintf(items, sizeof items, "%ld", raw->items);
    for (long i = 0; i < raw->items; i++)
        add_item(&w, i, &raw->item[i]);
    const lf_meta meta[] = {{"format", FORMAT},
                            {"precision", raw->precision},
                            {"items", items},
                            {"memory", raw->whole_process ? WHOLE : EACH}};
    const lf_status status = lf_safetensors_write(path, w.array, w.arrays, meta,
                                                  (int)(sizeof meta / sizeof *meta), NULL, err);
    for (long i = 0; i < raw->items; i++)
        free(w.face[i]);
    free(w.array);
    free(w.name);
    free(w.face);
    return status;
}

/* ---- reading ----------------------------------------------------------------------------------
 */

typedef struct reader {
    const lf_safetensors *file;
    const char *path;
} reader;

/* The array "item.what" of that type and rank, whose rows have three numbers if the rank is 2. */
static lf_status find(const reader *r, long item, const char *what, lf_dtype dtype, int rank,
                      const lf_array **out, lf_error *err)
{
    char name[NAME];
    snprintf(name, sizeof name, "%ld.%s", item, what);
    *out = lf_safetensors_find(r->file, name);
    if (*out && (*out)->dtype == dtype && (*out)->rank == rank && (rank < 2 || (*out)->dim[1] == 3))
        return LF_OK;
    return lf_fail(err, LF_BAD_INPUT, "%s: no %s of the wanted form: not written by --measure",
                   r->path, name);
}

static lf_status read_number(const reader *r, long item, const char *what, double *out,
                             lf_error *err)
{
    const lf_array *a;
    LF_TRY(find(r, item, what, LF_F64, 0, &a, err));
    memcpy(out, a->data, sizeof *out);
    return LF_OK;
}

static lf_status read_mesh(const reader *r, long i, lf_raw_item *item, lf_error *err)
{
    const lf_array *vertices, *faces;
    LF_TRY(find(r, i, "vertices", LF_F64, 2, &vertices, err));
    LF_TRY(find(r, i, "faces", LF_I64, 2, &faces, err));
    item->mesh = lf_mesh_create(vertices->dim[0], faces->dim[0]);
    memcpy(item->mesh->vertex, vertices->data, (size_t)vertices->dim[0] * 3 * sizeof(double));
    for (long k = 0; k < 3 * faces->dim[0]; k++) {
        int64_t vertex;
        memcpy(&vertex, (const char *)faces->data + (size_t)k * sizeof vertex, sizeof vertex);
        if (vertex < 0 || vertex >= vertices->dim[0])
            return lf_fail(err, LF_BAD_INPUT, "%s: a face of item %ld has no such vertex", r->path,
                           i);
        item->mesh->face[k / 3][k % 3] = (int32_t)vertex;
    }
    return LF_OK;
}

static lf_status read_item(const reader *r, long i, lf_raw_item *item, lf_error *err)
{
    const lf_array *numbers;
    char name[NAME];
    LF_TRY(read_number(r, i, "seconds", &item->seconds, err));
    LF_TRY(read_number(r, i, "cpu_seconds", &item->cpu_seconds, err));
    LF_TRY(read_number(r, i, "before_mb", &item->before_mb, err));
    LF_TRY(read_number(r, i, "peak_mb", &item->peak_mb, err));
    LF_TRY(read_number(r, i, "work", &item->work, err));
    LF_TRY(find(r, i, "numbers", LF_F64, 1, &numbers, err));
    item->numbers = numbers->dim[0];
    item->number = malloc((size_t)item->numbers * sizeof *item->number + 1);
    LF_REQUIRE(item->number, "out of memory for %ld numbers", item->numbers);
    memcpy(item->number, numbers->data, (size_t)item->numbers * sizeof *item->number);
    snprintf(name, sizeof name, "%ld.vertices", i);
    return lf_safetensors_find(r->file, name) ? read_mesh(r, i, item, err) : LF_OK;
}

static lf_status read_items(const reader *r, lf_raw **out, lf_error *err)
{
    const char *format = lf_safetensors_meta(r->file, "format");
    const char *precision = lf_safetensors_meta(r->file, "precision");
    const char *items = lf_safetensors_meta(r->file, "items");
    const char *memory = lf_safetensors_meta(r->file, "memory");
    const long count = items ? strtol(items, NULL, 10) : -1;
    /* every item has some arrays, which bounds the number before anything is allocated */
    if (!format || strcmp(format, FORMAT) != 0 || !precision || !memory || count < 0 ||
        count > lf_safetensors_count(r->file))
        return lf_fail(err, LF_BAD_INPUT, "%s: not written by elf-eval --measure", r->path);
    lf_raw *raw = lf_raw_create(count);
    snprintf(raw->precision, sizeof raw->precision, "%s", precision);
    raw->whole_process = strcmp(memory, WHOLE) == 0;
    for (long i = 0; i < count; i++) {
        const lf_status status = read_item(r, i, &raw->item[i], err);
        if (status != LF_OK) {
            lf_raw_free(raw);
            return status;
        }
    }
    *out = raw;
    return LF_OK;
}

lf_status lf_raw_read(const char *path, lf_raw **out, lf_error *err)
{
    lf_safetensors *file;
    LF_TRY(lf_safetensors_open(path, &file, err));
    const reader r = {file, path};
    const lf_status status = read_items(&r, out, err);
    lf_safetensors_close(file);
    return status;
}
