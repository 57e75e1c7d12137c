/* surface.c: a mesh handed to Embree, and rays.                              [surface.h says what]
 *
 * Embree sees the vertices as (x - centre) / diagonal in float, so that its rounding is 6e-8 of the
 * size wherever the mesh lies. It names the triangle that a ray meets; distance and normal are
 * computed again from the mesh in double.
 */
#include "datasets/surface_internal.h"

#include <math.h>

/* Twice the area of a face; the unit normal, zero if there is no area. */
static double face_normal(const lf_mesh *mesh, long face, double normal[3])
{
    const int32_t *f = mesh->face[face];
    double a[3], b[3];
    lf_subtract(mesh->vertex[f[1]], mesh->vertex[f[0]], a);
    lf_subtract(mesh->vertex[f[2]], mesh->vertex[f[0]], b);
    normal[0] = a[1] * b[2] - a[2] * b[1];
    normal[1] = a[2] * b[0] - a[0] * b[2];
    normal[2] = a[0] * b[1] - a[1] * b[0];
    const double n = sqrt(lf_dot(normal, normal));
    for (int i = 0; i < 3; i++)
        normal[i] = n > 0 ? normal[i] / n : 0;
    return n;
}

/* ---- opening and closing ------------------------------------------------------------------ */

static lf_status check_mesh(const lf_mesh *mesh, lf_error *err)
{
    if (mesh->faces < 1 || mesh->vertices < 1)
        return lf_fail(err, LF_BAD_INPUT, "the mesh is empty (%ld vertices, %ld faces)",
                       mesh->vertices, mesh->faces);
    if (mesh->faces > UINT32_MAX / 4 || mesh->vertices > INT32_MAX)
        return lf_fail(err, LF_BAD_INPUT, "the mesh has %ld faces, at most %ld are supported",
                       mesh->faces, (long)(UINT32_MAX / 4));
    for (long v = 0; v < mesh->vertices; v++)
        for (int i = 0; i < 3; i++)
            if (!(fabs(mesh->vertex[v][i]) <= LF_MESH_COORDINATE_MAX))
                return lf_fail(err, LF_BAD_INPUT,
                               "vertex %ld of the mesh is (%g, %g, %g); coordinates must be finite "
                               "and below %g",
                               v, mesh->vertex[v][0], mesh->vertex[v][1], mesh->vertex[v][2],
                               LF_MESH_COORDINATE_MAX);
    for (long f = 0; f < mesh->faces; f++)
        for (int i = 0; i < 3; i++)
            if (mesh->face[f][i] < 0 || mesh->face[f][i] >= mesh->vertices)
                return lf_fail(err, LF_BAD_INPUT,
                               "face %ld of the mesh names vertex %d; there are vertices 0 ... %ld",
                               f, mesh->face[f][i], mesh->vertices - 1);
    return LF_OK;
}

/* The faces that Embree gets, and the box round them. */
static lf_status choose_faces(lf_surface *s, const uint8_t *keep, lf_error *err)
{
    double normal[3], low[3] = {INFINITY, INFINITY, INFINITY};
    double high[3] = {-INFINITY, -INFINITY, -INFINITY};
    s->original = malloc((size_t)s->mesh->faces * sizeof *s->original);
    if (!s->original)
        return lf_fail(err, LF_FAILED, "no memory for %ld faces", s->mesh->faces);
    for (long f = 0; f < s->mesh->faces; f++) {
        if ((keep && !keep[f]) || !(face_normal(s->mesh, f, normal) > 0))
            continue;
        s->original[s->primitives++] = f;
        for (int k = 0; k < 9; k++) {
            const double x = s->mesh->vertex[s->mesh->face[f][k / 3]][k % 3];
            low[k % 3] = fmin(low[k % 3], x);
            high[k % 3] = fmax(high[k % 3], x);
        }
    }
    if (s->primitives == 0)
        return lf_fail(err, LF_BAD_INPUT, "no triangle of the mesh has an area");
    for (int i = 0; i < 3; i++) {
        s->centre[i] = (low[i] + high[i]) / 2;
        s->diagonal = hypot(s->diagonal, high[i] - low[i]);
    }
    return LF_OK;
}

/* Every corner of every kept face is a vertex of Embree's own: no index map is needed. */
static lf_status fill_scene(lf_surface *s, lf_error *err)
{
    RTCGeometry geometry = rtcNewGeometry(s->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    const size_t corners = 3 * (size_t)s->primitives;
    float *vertex = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                            3 * sizeof(float), corners);
    unsigned *index = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                              3 * sizeof(unsigned), (size_t)s->primitives);
    if (!vertex || !index) {
        rtcReleaseGeometry(geometry);
        return lf_fail(err, LF_FAILED, "Embree has no memory for %ld faces", s->primitives);
    }
    for (size_t c = 0; c < corners; c++) {
        const int32_t v = s->mesh->face[s->original[c / 3]][c % 3];
        lf_surface_local(s, s->mesh->vertex[v], vertex + 3 * c);
        index[c] = (unsigned)c;
    }
    rtcSetGeometryMask(geometry, ~0u);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(s->scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcSetSceneFlags(s->scene, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(s->scene, RTC_BUILD_QUALITY_MEDIUM);
    rtcCommitScene(s->scene);
    const enum RTCError code = rtcGetDeviceError(s->device);
    if (code != RTC_ERROR_NONE)
        return lf_fail(err, LF_FAILED, "Embree could not index the mesh of %ld faces (error %d)",
                       s->primitives, (int)code);
    return LF_OK;
}

/* Some builds of Embree let every ray miss without a word. The ray goes straight through the middle
 * of the largest face; that one is found or something before it. */
static lf_status check_hits(const lf_surface *s, lf_error *err)
{
    double normal[3], best = -1;
    long face = 0;
    for (long k = 0; k < s->primitives; k++) {
        const double area = face_normal(s->mesh, s->original[k], normal);
        if (area > best) {
            best = area;
            face = s->original[k];
        }
    }
    double origin[3], back[3];
    face_normal(s->mesh, face, normal);
    for (int i = 0; i < 3; i++) {
        const int32_t *f = s->mesh->face[face];
        const double middle =
            (s->mesh->vertex[f[0]][i] + s->mesh->vertex[f[1]][i] + s->mesh->vertex[f[2]][i]) / 3;
        origin[i] = middle + s->diagonal * normal[i];
        back[i] = -normal[i];
    }
    lf_hit hit;
    if (!lf_surface_first_hit(s, origin, back, 0, INFINITY, &hit) ||
        !lf_surface_any_hit(s, origin, back, 0, INFINITY))
        return lf_fail(err, LF_FAILED,
                       "Embree's rays miss a triangle that they must hit; this build of Embree "
                       "cannot be used (is it built with ray masks for another version?)");
    return LF_OK;
}

static lf_status build(lf_surface *s, const uint8_t *keep, lf_error *err)
{
    LF_TRY(choose_faces(s, keep, err));
    s->device = rtcNewDevice("threads=1");
    if (!s->device)
        return lf_fail(err, LF_FAILED, "Embree does not start (error %d)",
                       (int)rtcGetDeviceError(NULL));
    s->scene = rtcNewScene(s->device);
    if (!s->scene)
        return lf_fail(err, LF_FAILED, "Embree makes no scene (error %d)",
                       (int)rtcGetDeviceError(s->device));
    LF_TRY(fill_scene(s, err));
    return check_hits(s, err);
}

lf_status lf_surface_open_part(const lf_mesh *mesh, const uint8_t *keep, lf_surface **out,
                               lf_error *err)
{
    LF_TRY(check_mesh(mesh, err));
    lf_surface *s = calloc(1, sizeof *s);
    if (!s)
        return lf_fail(err, LF_FAILED, "no memory for a surface");
    s->mesh = lf_mesh_copy(mesh);
    const lf_status status = build(s, keep, err);
    if (status != LF_OK) {
        lf_surface_close(s);
        return status;
    }
    *out = s;
    return LF_OK;
}

lf_status lf_surface_open(const lf_mesh *mesh, lf_surface **out, lf_error *err)
{
    return lf_surface_open_part(mesh, NULL, out, err);
}

void lf_surface_close(lf_surface *s)
{
    if (!s)
        return;
    if (s->scene)
        rtcReleaseScene(s->scene);
    if (s->device)
        rtcReleaseDevice(s->device);
    free(s->original);
    lf_mesh_free(s->mesh);
    free(s);
}

const lf_mesh *lf_surface_mesh(const lf_surface *s)
{
    return s->mesh;
}

void lf_surface_centre(const lf_surface *s, double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = s->centre[i];
}

double lf_surface_diagonal(const lf_surface *s)
{
    return s->diagonal;
}

/* ---- rays --------------------------------------------------------------------------------- */

static struct RTCRay make_ray(const lf_surface *s, const double origin[3],
                              const double direction[3], double from, double to)
{
    float o[3];
    lf_surface_local(s, origin, o);
    struct RTCRay ray = {.org_x = o[0], .org_y = o[1], .org_z = o[2], .mask = ~0u};
    ray.dir_x = (float)direction[0];
    ray.dir_y = (float)direction[1];
    ray.dir_z = (float)direction[2];
    ray.tnear = (float)(from / s->diagonal);
    ray.tfar = (float)(to / s->diagonal);
    return ray;
}

static void intersect(RTCScene scene, struct RTCRayHit *query)
{
#ifdef LF_EMBREE4
    rtcIntersect1(scene, query, NULL);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene, &context, query);
#endif
}

bool lf_surface_first_hit(const lf_surface *s, const double origin[3], const double direction[3],
                          double from, double to, lf_hit *out)
{
    struct RTCRayHit query = {.ray = make_ray(s, origin, direction, from, to)};
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    intersect(s->scene, &query);
    out->face = -1;
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return false;
    out->face = s->original[query.hit.primID];
    face_normal(s->mesh, out->face, out->normal);
    double to_plane[3];
    lf_subtract(s->mesh->vertex[s->mesh->face[out->face][0]], origin, to_plane);
    const double slope = lf_dot(direction, out->normal), seen = query.ray.tfar * s->diagonal;
    const double exact = lf_dot(to_plane, out->normal) / slope;
    /* a ray along the plane has no intersection to compute: Embree's own stands */
    const double slack = 1e-5 * (s->diagonal + seen);
    out->distance = fabs(exact - seen) <= slack ? exact : seen;
    return true;
}

bool lf_surface_any_hit(const lf_surface *s, const double origin[3], const double direction[3],
                        double from, double to)
{
    struct RTCRay ray = make_ray(s, origin, direction, from, to);
#ifdef LF_EMBREE4
    rtcOccluded1(s->scene, &ray, NULL);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(s->scene, &context, &ray);
#endif
    return ray.tfar < 0; /* Embree's sign of a hit */
}

unsigned lf_surface_any_hit8(const lf_surface *s, const double origin[3],
                             const float direction[3][8])
{
    static const int valid[8] __attribute__((aligned(32))) = {-1, -1, -1, -1, -1, -1, -1, -1};
    struct RTCRay8 ray;
    float o[3];
    lf_surface_local(s, origin, o);
    for (int k = 0; k < 8; k++) {
        ray.org_x[k] = o[0];
        ray.org_y[k] = o[1];
        ray.org_z[k] = o[2];
        ray.dir_x[k] = direction[0][k];
        ray.dir_y[k] = direction[1][k];
        ray.dir_z[k] = direction[2][k];
        ray.tnear[k] = ray.time[k] = 0;
        ray.tfar[k] = INFINITY;
        ray.mask[k] = ~0u;
        ray.id[k] = ray.flags[k] = 0;
    }
#ifdef LF_EMBREE4
    rtcOccluded8(valid, s->scene, &ray, NULL);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded8(valid, s->scene, &context, &ray);
#endif
    unsigned bits = 0;
    for (int k = 0; k < 8; k++)
        bits |= (unsigned)(ray.tfar[k] < 0) << k;
    return bits;
}
