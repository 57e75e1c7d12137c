/* camera_path.c: see camera_path.h. Vectors are double[3]. */
#include "datasets/camera_path.h"
#include "datasets/scene_internal.h"

static const double pi = 3.14159265358979323846;

static const char *const names[LF_PATHS] = {"spiral", "orbit"};

const char *lf_path_kind_name(lf_path_kind kind)
{
    LF_REQUIRE(kind >= 0 && kind < LF_PATHS, "lf_path_kind_name: %d", (int)kind);
    return names[kind];
}

lf_status lf_path_kind_parse(const char *name, lf_path_kind *out, lf_error *err)
{
    for (int k = 0; k < LF_PATHS; k++)
        if (strcmp(name, names[k]) == 0) {
            *out = (lf_path_kind)k;
            return LF_OK;
        }
    return lf_fail(err, LF_BAD_INPUT, "path '%s' is unknown; known are spiral and orbit", name);
}

/* ---- vectors and means -------------------------------------------------------------------- */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* To length 1; returns the former length. A zero vector stays. */
static double normalise(double a[3])
{
    const double n = sqrt(dot(a, a));
    for (int i = 0; i < 3 && n > 0; i++)
        a[i] /= n;
    return n;
}

/* out = a - (a . unit) unit. */
static void across(const double a[3], const double unit[3], double out[3])
{
    const double along = dot(a, unit);
    for (int i = 0; i < 3; i++)
        out[i] = a[i] - along * unit[i];
}

/* Mean of column k of all rotations. */
static void mean_axis(const lf_scene *scene, int k, double out[3])
{
    memset(out, 0, 3 * sizeof *out);
    for (long v = 0; v < scene->views; v++)
        for (int i = 0; i < 3; i++)
            out[i] += scene->view[v].camera.rotation[3 * i + k] / (double)scene->views;
}

/* Mean of c_i - origin. */
static void mean_offset(const lf_scene *scene, const double origin[3], double out[3])
{
    memset(out, 0, 3 * sizeof *out);
    for (long v = 0; v < scene->views; v++)
        for (int i = 0; i < 3; i++)
            out[i] += (scene->view[v].camera.centre[i] - origin[i]) / (double)scene->views;
}

static void *room(long count, size_t size)
{
    void *p = malloc((size_t)count * size);
    LF_REQUIRE(p, "out of memory for %ld times %zu bytes", count, size);
    return p;
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Sorts x[n]; linear between order statistics. */
static double quantile(double *x, long n, double q)
{
    qsort(x, (size_t)n, sizeof *x, by_value);
    const double at = q * (double)(n - 1);
    const long i = (long)at < n - 1 ? (long)at : n - 1, next = i + 1 < n ? i + 1 : i;
    return x[i] + (at - (double)i) * (x[next] - x[i]);
}

static lf_camera median_camera(const lf_scene *scene)
{
    double *fx = room(scene->views, sizeof *fx);
    for (long v = 0; v < scene->views; v++)
        fx[v] = scene->view[v].camera.fx;
    qsort(fx, (size_t)scene->views, sizeof *fx, by_value);
    const double median = fx[(scene->views - 1) / 2];
    free(fx);
    long v = 0;
    while (scene->view[v].camera.fx != median)
        v++;
    return scene->view[v].camera;
}

static void set_pose(lf_camera *camera, const double centre[3], const double right[3],
                     const double forward[3])
{
    double down[3];
    cross(forward, right, down);
    for (int i = 0; i < 3; i++) {
        camera->centre[i] = centre[i];
        camera->rotation[3 * i] = right[i];
        camera->rotation[3 * i + 1] = down[i];
        camera->rotation[3 * i + 2] = forward[i];
    }
}

/* ---- orbit -------------------------------------------------------------------------------- */

typedef struct circle {
    double axis[3], start[3]; /* unit, orthogonal: up; from the focus to the first frame */
    double distance, elevation;
} circle;

/* The minimiser of mean (a . right_i)^2 + 0.001 |a - u|^2, of length 1: Cramer's rule for
 * (mean right right' + 0.001) a = u. False: no mean up u. */
static bool find_axis(const lf_scene *scene, double axis[3])
{
    double m[9] = {0}, u[3];
    mean_axis(scene, 1, u);
    if (!(normalise(u) > 1e-3))
        return false;
    for (int i = 0; i < 3; i++)
        m[4 * i] = 1e-3;
    for (long v = 0; v < scene->views; v++)
        for (int i = 0; i < 9; i++) {
            const double *r = scene->view[v].camera.rotation;
            m[i] += r[i / 3 * 3] * r[i % 3 * 3] / (double)scene->views;
        }
    for (int k = 0; k < 3; k++) {
        double c[9];
        memcpy(c, m, sizeof c);
        for (int i = 0; i < 3; i++)
            c[3 * i + k] = -u[i];
        axis[k] = lf_determinant(c);
    }
    return normalise(axis) > 0;
}

/* Direction of the mean offset across the axis, or of the first offset that has one. */
static bool find_start(const lf_scene *scene, const double focus[3], circle *c)
{
    double offset[3];
    for (long v = -1; v < scene->views; v++) {
        mean_offset(scene, focus, offset);
        for (int i = 0; i < 3 && v >= 0; i++)
            offset[i] = scene->view[v].camera.centre[i] - focus[i];
        across(offset, c->axis, c->start);
        if (normalise(c->start) > 1e-6 * c->distance)
            return true;
    }
    return false;
}

static lf_status find_circle(const lf_scene *scene, const double focus[3], circle *c, lf_error *err)
{
    if (!find_axis(scene, c->axis))
        return lf_fail(err, LF_BAD_INPUT, "%s: the cameras' ups cancel: an orbit has no axis",
                       scene->folder);
    for (long v = 0; v < scene->views; v++) {
        double o[3], flat[3];
        for (int i = 0; i < 3; i++)
            o[i] = scene->view[v].camera.centre[i] - focus[i];
        across(o, c->axis, flat);
        c->distance += sqrt(dot(o, o)) / (double)scene->views;
        c->elevation += atan2(dot(o, c->axis), sqrt(dot(flat, flat))) / (double)scene->views;
    }
    if (!find_start(scene, focus, c))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: all cameras stand at the focus or on the axis of the orbit; it needs "
                       "one beside it",
                       scene->folder);
    return LF_OK;
}

static void orbit_frame(const circle *c, const double focus[3], double p, lf_camera *out)
{
    double side[3], right[3], forward[3], centre[3];
    cross(c->axis, c->start, side);
    for (int i = 0; i < 3; i++) {
        const double radial = cos(p) * c->start[i] + sin(p) * side[i];
        right[i] = cos(p) * side[i] - sin(p) * c->start[i];
        forward[i] = -cos(c->elevation) * radial - sin(c->elevation) * c->axis[i];
        centre[i] = focus[i] - c->distance * forward[i];
    }
    set_pose(out, centre, right, forward);
}

/* ---- spiral ------------------------------------------------------------------------------- */

typedef struct spiral {
    double mean[9], centre[3]; /* the mean pose */
    double radius[3], target[3];
} spiral;

static lf_status mean_pose(const lf_scene *scene, spiral *s, lf_error *err)
{
    double down[3], right[3], forward[3];
    const double *first = scene->view[0].camera.centre;
    mean_offset(scene, first, s->centre);
    for (int i = 0; i < 3; i++)
        s->centre[i] += first[i];
    mean_axis(scene, 1, down);
    mean_axis(scene, 2, forward);
    const double ahead = normalise(forward);
    cross(down, forward, right);
    if (!(ahead > 1e-3 && normalise(right) > 1e-3))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the cameras' directions cancel, they do not face forward; take an "
                       "orbit instead of a spiral",
                       scene->folder);
    lf_camera pose;
    set_pose(&pose, s->centre, right, forward);
    memcpy(s->mean, pose.rotation, sizeof s->mean);
    return LF_OK;
}

static void find_radii(const lf_scene *scene, spiral *s)
{
    double *size = room(scene->views, sizeof *size);
    for (int k = 0; k < 3; k++) {
        for (long v = 0; v < scene->views; v++) {
            double q[3];
            for (int i = 0; i < 3; i++)
                q[i] = scene->view[v].camera.centre[i] - s->centre[i];
            lf_rotation_apply_transposed(s->mean, q, q);
            size[v] = fabs(q[k]);
        }
        s->radius[k] = 0.7 * quantile(size, scene->views, 0.9);
    }
    free(size);
}

static lf_status find_spiral(const lf_scene *scene, const double focus[3], spiral *s, lf_error *err)
{
    double q[3];
    LF_TRY(mean_pose(scene, s, err));
    find_radii(scene, s);
    for (int i = 0; i < 3; i++)
        q[i] = focus[i] - s->centre[i];
    lf_rotation_apply_transposed(s->mean, q, q);
    if (!(q[2] > s->radius[2]))
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the focus is at depth %g of the mean camera, not in front of a spiral "
                       "of half depth %g; take an orbit",
                       scene->folder, q[2], s->radius[2]);
    for (int i = 0; i < 3; i++)
        s->target[i] = s->centre[i] + q[2] * s->mean[3 * i + 2];
    return LF_OK;
}

static void spiral_frame(const spiral *s, double p, lf_camera *out)
{
    double centre[3] = {s->radius[0] * cos(p), s->radius[1] * sin(p), s->radius[2] * sin(p / 2)};
    const double down[3] = {s->mean[1], s->mean[4], s->mean[7]};
    double forward[3], right[3];
    lf_rotation_apply(s->mean, centre, centre);
    for (int i = 0; i < 3; i++) {
        centre[i] += s->centre[i];
        forward[i] = s->target[i] - centre[i];
    }
    normalise(forward);
    cross(down, forward, right);
    normalise(right);
    set_pose(out, centre, right, forward);
}

/* ---- both --------------------------------------------------------------------------------- */

lf_status lf_camera_path(lf_path_kind kind, const lf_scene *scene, const double focus[3],
                         long frames, lf_camera *out, lf_error *err)
{
    LF_REQUIRE(kind >= 0 && kind < LF_PATHS && frames >= 1, "lf_camera_path: kind %d, %ld frames",
               (int)kind, frames);
    circle c = {0};
    spiral s = {0};
    if (scene->views < 1)
        return lf_fail(err, LF_BAD_INPUT, "%s: a path needs cameras", scene->folder);
    if (kind == LF_PATH_ORBIT)
        LF_TRY(find_circle(scene, focus, &c, err));
    else
        LF_TRY(find_spiral(scene, focus, &s, err));
    const lf_camera lens = median_camera(scene);
    for (long k = 0; k < frames; k++) {
        const double turn = 2 * pi * (double)k / (double)frames;
        out[k] = lens;
        if (kind == LF_PATH_ORBIT)
            orbit_frame(&c, focus, turn, &out[k]);
        else
            spiral_frame(&s, 2 * turn, &out[k]);
    }
    return LF_OK;
}

/* ---- the video ---------------------------------------------------------------------------- */

typedef struct text {
    char *line;
    size_t size, used; /* used may exceed size: counted, not written */
} text;

static void put(text *t, char c)
{
    if (t->used < t->size)
        t->line[t->used] = c;
    t->used++;
}

static void put_all(text *t, const char *s)
{
    while (*s)
        put(t, *s++);
}

/* '<folder>/<name>' in single quotes; "./" keeps a name from being read as option or protocol. */
static void put_path(text *t, const char *folder, const char *name, bool pattern)
{
    put(t, '\'');
    if (*folder != '/' && *folder != '.')
        put_all(t, "./");
    for (const char *c = folder; *c; c++) {
        if (*c == '\'')
            put_all(t, "'\\'");
        if (*c == '%' && pattern)
            put(t, '%');
        put(t, *c);
    }
    put(t, '/');
    put_all(t, name);
    put(t, '\'');
}

size_t lf_camera_path_ffmpeg(char *line, size_t size, const char *folder, int fps)
{
    char head[96];
    text t = {line, size, 0};
    snprintf(head, sizeof head, "ffmpeg -y -framerate %d -start_number 0 -i ", fps);
    put_all(&t, head);
    put_path(&t, folder, "frame-%04d.png", true);
    put_all(&t, " -vf 'pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white' -c:v libx264 -crf 18"
                " -pix_fmt yuv420p ");
    put_path(&t, folder, "video.mp4", false);
    if (size)
        line[t.used < size ? t.used : 0] = 0;
    return t.used;
}
