/* scene_pictures.c: the pictures of a scene in memory, bounded in bytes; the one that was not asked
 * for the longest goes first. */
#include "datasets/scene_internal.h"

#include <pthread.h>

#include "datasets/image.h"

typedef struct picture {
    uint8_t *rgb, *alpha;
    long holders;
    uint64_t used; /* the clock when it was last asked for */
    size_t bytes;
    int factor;
    bool given; /* not from a file: never dropped */
} picture;

struct lf_scene_pictures {
    pthread_mutex_t lock;
    picture *picture;
    long count;
    size_t bytes, most;
    uint64_t clock;
};

struct lf_scene_pictures *lf_pictures_create(size_t bytes)
{
    struct lf_scene_pictures *p = calloc(1, sizeof *p);
    LF_REQUIRE(p, "out of memory");
    pthread_mutex_init(&p->lock, NULL);
    p->most = bytes;
    return p;
}

void lf_pictures_free(struct lf_scene_pictures *p, long views)
{
    if (!p)
        return;
    for (long i = 0; i < views && i < p->count; i++) {
        free(p->picture[i].rgb);
        free(p->picture[i].alpha);
    }
    pthread_mutex_destroy(&p->lock);
    free(p->picture);
    free(p);
}

void lf_pictures_append(lf_scene *scene, int factor)
{
    struct lf_scene_pictures *p = scene->pictures;
    p->picture = realloc(p->picture, (size_t)(p->count + 1) * sizeof *p->picture);
    LF_REQUIRE(p->picture, "out of memory");
    p->picture[p->count++] = (picture){.factor = factor};
}

void lf_pictures_give(lf_scene *scene, long view, uint8_t *rgb, uint8_t *alpha)
{
    struct lf_scene_pictures *p = scene->pictures;
    const lf_camera *c = &scene->view[view].camera;
    p->picture[view] = (picture){
        rgb, alpha, 0, 0, (size_t)c->width * (size_t)c->height * (alpha ? 4 : 3), 1, true};
    p->bytes += p->picture[view].bytes;
}

static void drop(struct lf_scene_pictures *p, picture *victim)
{
    free(victim->rgb);
    free(victim->alpha);
    p->bytes -= victim->bytes;
    victim->rgb = victim->alpha = NULL;
    victim->bytes = 0;
}

/* Make room for so many bytes, as far as unheld pictures go. */
static void make_room(struct lf_scene_pictures *p, size_t bytes)
{
    while (p->bytes + bytes > p->most) {
        picture *oldest = NULL;
        for (long i = 0; i < p->count; i++) {
            picture *q = &p->picture[i];
            if (q->rgb && !q->given && !q->holders && (!oldest || q->used < oldest->used))
                oldest = q;
        }
        if (!oldest)
            return;
        drop(p, oldest);
    }
}

/* Mean of a channel over a block of factor x factor pixels; colours are over white. */
static double block_mean(const lf_image *image, int column, int row, int factor, int channel)
{
    const bool colour = image->channels >= 3, has_alpha = image->channels % 2 == 0;
    double sum = 0;
    for (int j = 0; j < factor; j++)
        for (int i = 0; i < factor; i++) {
            const float *at = lf_image_at(image, column * factor + i, row * factor + j);
            const double alpha = has_alpha ? (double)at[image->channels - 1] : 1;
            sum += channel == 3 ? alpha : (double)at[colour ? channel : 0] * alpha + 1 - alpha;
        }
    return sum / (factor * factor);
}

static void reduce(const lf_image *image, const lf_camera *camera, picture *out)
{
    for (int j = 0; j < camera->height; j++)
        for (int i = 0; i < camera->width; i++) {
            const size_t at = (size_t)j * (size_t)camera->width + (size_t)i;
            for (int c = 0; c < 3; c++)
                out->rgb[3 * at + (size_t)c] =
                    (uint8_t)(255 * block_mean(image, i, j, out->factor, c) + 0.5);
            if (out->alpha)
                out->alpha[at] = (uint8_t)(255 * block_mean(image, i, j, out->factor, 3) + 0.5);
        }
}

/* The file may have changed since the scene was opened. */
static lf_status check_image(const lf_scene_view *view, int factor, const lf_image *image,
                             lf_error *err)
{
    const bool alpha = image->channels % 2 == 0;
    if (image->width / factor == view->camera.width &&
        image->height / factor == view->camera.height && alpha == view->alpha)
        return LF_OK;
    return lf_fail(err, LF_BAD_INPUT,
                   "%s: is %d x %d pixels with %d channels now; it was another picture when the "
                   "scene was opened",
                   view->path, image->width, image->height, image->channels);
}

static lf_status load(struct lf_scene_pictures *p, const lf_scene_view *view, picture *out,
                      lf_error *err)
{
    lf_image *image;
    LF_TRY(lf_image_read(view->path, &image, err));
    lf_status status = check_image(view, out->factor, image, err);
    if (status == LF_OK) {
        const size_t pixels = (size_t)view->camera.width * (size_t)view->camera.height;
        const size_t bytes = pixels * (view->alpha ? 4 : 3);
        make_room(p, bytes);
        out->rgb = malloc(3 * pixels);
        out->alpha = view->alpha ? malloc(pixels) : NULL;
        LF_REQUIRE(out->rgb && (out->alpha || !view->alpha), "no memory for %s", view->path);
        out->bytes = bytes;
        p->bytes += bytes;
        reduce(image, &view->camera, out);
    }
    lf_image_free(image);
    return status;
}

lf_status lf_scene_hold(const lf_scene *scene, long view, lf_pixels *out, lf_error *err)
{
    LF_REQUIRE(view >= 0 && view < scene->views, "view %ld of %ld", view, scene->views);
    struct lf_scene_pictures *p = scene->pictures;
    const lf_camera *camera = &scene->view[view].camera;
    lf_status status = LF_OK;
    pthread_mutex_lock(&p->lock);
    picture *q = &p->picture[view];
    if (!q->rgb)
        status = load(p, &scene->view[view], q, err);
    if (status == LF_OK) {
        q->holders++;
        q->used = ++p->clock;
        *out = (lf_pixels){camera->width, camera->height, q->rgb, q->alpha};
    }
    pthread_mutex_unlock(&p->lock);
    return status;
}

void lf_scene_release(const lf_scene *scene, long view)
{
    LF_REQUIRE(view >= 0 && view < scene->views, "view %ld of %ld", view, scene->views);
    struct lf_scene_pictures *p = scene->pictures;
    pthread_mutex_lock(&p->lock);
    LF_REQUIRE(p->picture[view].holders > 0, "view %ld is released more often than held", view);
    p->picture[view].holders--;
    make_room(p, 0);
    pthread_mutex_unlock(&p->lock);
}

size_t lf_scene_bytes(const lf_scene *scene)
{
    pthread_mutex_lock(&scene->pictures->lock);
    const size_t bytes = scene->pictures->bytes;
    pthread_mutex_unlock(&scene->pictures->lock);
    return bytes;
}
