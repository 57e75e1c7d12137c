/* picture_grid.c: see picture_grid.h. */
#include "eval/picture_grid.h"

#include "eval/image_resize.h"

enum { GAP = 8, LINES = 4, LETTER_ROWS = 8 }; /* pixels between things; most lines of a head */

static const float black[3] = {0, 0, 0}, white[3] = {1, 1, 1}, grey[3] = {0.35f, 0.35f, 0.35f};

/* ---- texts -------------------------------------------------------------------------------- */

/* A head as lines: where each begins, and its letters. */
typedef struct broken {
    int lines;
    const char *from[LINES];
    int letters[LINES];
} broken;

/* The end of the word at `text`, with its hyphen. */
static const char *word_end(const char *text)
{
    while (*text && *text != ' ' && *text != '-')
        text++;
    return text + (*text == '-');
}

/* Break between words into lines of at most `most` letters; a longer word has a line of its own.
 * What does not fit into LINES lines goes on in the last one. */
static broken break_head(const char *text, int most)
{
    broken b = {0};
    while (*text) {
        const char *end = word_end(text);
        const long grown = b.lines ? end - b.from[b.lines - 1] : most + 1;
        if (grown > most && b.lines < LINES)
            b.from[b.lines++] = text;
        b.letters[b.lines - 1] = (int)(end - b.from[b.lines - 1]);
        text = end + (*end == ' ');
    }
    return b;
}

/* What all heads share. */
typedef struct heads {
    int scale, most, lines; /* of the font; letters a line; of the longest head */
} heads;

static bool heads_fit(const lf_picture_grid *g, heads *h)
{
    bool fit = true;
    h->most = g->cell / lf_image_text_width(1, h->scale);
    h->lines = 0;
    for (int c = 0; c < g->columns; c++) {
        const broken b = break_head(g->head[c], h->most);
        h->lines = b.lines > h->lines ? b.lines : h->lines;
        for (int i = 0; i < b.lines; i++)
            fit = fit && b.letters[i] <= h->most;
    }
    return fit;
}

static heads heads_of(const lf_picture_grid *g)
{
    heads h = {.scale = 2};
    if (!heads_fit(g, &h)) {
        h.scale = 1;
        heads_fit(g, &h);
    }
    return h;
}

static void draw_text(lf_image *canvas, const char *text, int letters, int left, int top, int scale,
                      const float *colour)
{
    char part[256];
    snprintf(part, sizeof part, "%.*s", letters, text);
    lf_image_text(canvas, part, left, top, scale, colour);
}

/* ---- layout ------------------------------------------------------------------------------- */

static int column_left(const lf_picture_grid *g, int column)
{
    return GAP + column * (g->cell + GAP);
}

static int line_height(int scale)
{
    return LETTER_ROWS * scale + GAP / 2;
}

/* Large letters where the widest note of the table fits its cell in them. */
static int note_scale(const lf_picture_grid *g)
{
    size_t widest = 0;
    for (long r = 0; r < g->rows; r++)
        for (int c = 0; c < g->columns; c++) {
            const char *note = g->row[r].cell[c].note;
            const size_t letters = note ? strlen(note) : 0;
            widest = letters > widest ? letters : widest;
        }
    return lf_image_text_width((int)widest, 2) <= g->cell ? 2 : 1;
}

static int caption_scale(const lf_picture_grid *g)
{
    size_t widest = 0;
    for (long r = 0; r < g->rows; r++) {
        const size_t letters = g->row[r].caption ? strlen(g->row[r].caption) : 0;
        widest = letters > widest ? letters : widest;
    }
    return lf_image_text_width((int)widest, 2) <= column_left(g, g->columns) - GAP ? 2 : 1;
}

static int picture_height(const lf_grid_row *row, const lf_picture_grid *g)
{
    int tallest = 0;
    for (int c = 0; c < g->columns; c++) {
        int width, height = 0;
        const lf_image *image = row->cell[c].image;
        if (image)
            lf_image_fit(image->width, image->height, g->cell, g->cell, &width, &height);
        tallest = height > tallest ? height : tallest;
    }
    return tallest;
}

static bool has_notes(const lf_grid_row *row, int columns)
{
    for (int c = 0; c < columns; c++)
        if (row->cell[c].note)
            return true;
    return false;
}

static int row_height(const lf_grid_row *row, const lf_picture_grid *g)
{
    return (row->caption ? line_height(caption_scale(g)) : 0) + picture_height(row, g) +
           (has_notes(row, g->columns) ? GAP / 2 + line_height(note_scale(g)) : 0) + GAP;
}

static lf_status check(const lf_picture_grid *g, const heads *h, int *height, lf_error *err)
{
    if (g->cell < 32 || g->cell > 1024 || g->columns < 1 || g->rows < 1)
        return lf_fail(
            err, LF_BAD_INPUT,
            "picture: cells of %d pixels (32 to 1024), %d columns, %ld rows (1 at least)", g->cell,
            g->columns, g->rows);
    long total = GAP + h->lines * line_height(h->scale) + GAP;
    for (long r = 0; r < g->rows && total <= LF_IMAGE_SIZE_MAX; r++)
        total += row_height(&g->row[r], g);
    const long width = (long)g->columns * (g->cell + GAP) + GAP;
    if (total > LF_IMAGE_SIZE_MAX || width > LF_IMAGE_SIZE_MAX)
        return lf_fail(err, LF_BAD_INPUT,
                       "picture: %d columns and %ld rows of %d pixels are more than %d pixels",
                       g->columns, g->rows, g->cell, LF_IMAGE_SIZE_MAX);
    *height = (int)total;
    return LF_OK;
}

/* ---- drawing ------------------------------------------------------------------------------ */

/* Heads stand on one ground line. */
static void draw_heads(lf_image *canvas, const lf_picture_grid *g, const heads *h)
{
    for (int c = 0; c < g->columns; c++) {
        const broken b = break_head(g->head[c], h->most);
        for (int i = 0; i < b.lines; i++)
            draw_text(canvas, b.from[i], b.letters[i], column_left(g, c),
                      GAP + (h->lines - b.lines + i) * line_height(h->scale), h->scale, black);
    }
}

static void draw_picture(lf_image *canvas, const lf_image *image, int cell, int left, int top)
{
    int width, height;
    lf_image_fit(image->width, image->height, cell, cell, &width, &height);
    lf_image *opaque = lf_image_over_white(image);
    lf_image *fitted = lf_image_resize(opaque, width, height);
    lf_image_paste(canvas, fitted, left + (cell - width) / 2, top, 1);
    lf_image_free(fitted);
    lf_image_free(opaque);
}

static void draw_row(lf_image *canvas, const lf_grid_row *row, const lf_picture_grid *g, int top)
{
    if (row->caption) {
        lf_image_text(canvas, row->caption, GAP, top, caption_scale(g), grey);
        top += line_height(caption_scale(g));
    }
    const int below = top + picture_height(row, g) + GAP / 2;
    for (int c = 0; c < g->columns; c++) {
        const lf_grid_cell *cell = &row->cell[c];
        if (cell->image)
            draw_picture(canvas, cell->image, g->cell, column_left(g, c), top);
        if (cell->note)
            lf_image_text(canvas, cell->note, column_left(g, c), below, note_scale(g), black);
    }
}

lf_status lf_picture_grid_draw(const lf_picture_grid *g, lf_image **out, lf_error *err)
{
    int height = 0;
    const heads h = heads_of(g);
    LF_TRY(check(g, &h, &height, err));
    lf_image *canvas = lf_image_create(column_left(g, g->columns), height, 3);
    lf_image_fill(canvas, white);
    draw_heads(canvas, g, &h);
    int top = GAP + h.lines * line_height(h.scale) + GAP;
    for (long r = 0; r < g->rows; r++) {
        draw_row(canvas, &g->row[r], g, top);
        top += row_height(&g->row[r], g);
    }
    *out = canvas;
    return LF_OK;
}

lf_status lf_picture_grid_write(const char *path, const lf_picture_grid *grid, lf_error *err)
{
    lf_image *image = NULL;
    LF_TRY(lf_picture_grid_draw(grid, &image, err));
    const lf_status status = lf_image_write_png(path, image, err);
    lf_image_free(image);
    return status;
}
