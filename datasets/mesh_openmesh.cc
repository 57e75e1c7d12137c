/* mesh_openmesh.cc: the thin wrapper around OpenMesh. No exception leaves it.
 *
 * OpenMesh's readers and writers are process-wide objects that keep state (materials, folders,
 * property tables) and write to std::cerr, so one lock guards them and their error stream is off
 * while they work.
 */
#include "datasets/mesh_file.h"

/* GCC 12 at -O3 sees this in OpenMesh's own property vectors. */
#ifndef __clang__
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

#include <OpenMesh/Core/IO/MeshIO.hh>
#include <OpenMesh/Core/IO/importer/BaseImporter.hh>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Core/System/omstream.hh>

#include <cmath>
#include <exception>
#include <fstream>
#include <mutex>
#include <sstream>
#include <string>
#include <vector>

namespace
{

using namespace OpenMesh;

std::mutex openmesh_lock;

/* Holds the lock and keeps OpenMesh's error and log streams quiet. */
class Quiet
{
  public:
    Quiet() : guard_(openmesh_lock)
    {
        omerr().disable();
        omlog().disable();
        omout().disable();
    }
    ~Quiet()
    {
        omerr().enable();
        omlog().enable();
        omout().enable();
    }
    Quiet(const Quiet &) = delete;
    Quiet &operator=(const Quiet &) = delete;

  private:
    std::lock_guard<std::mutex> guard_;
};

/* Receives vertices and faces as they stand in the file; polygons become fans. */
class SoupImporter : public IO::BaseImporter
{
  public:
    std::vector<Vec3d> vertex;
    std::vector<int> corner; /* three a triangle */
    std::vector<long> source;
    long faces = 0, polygons = 0;

    VertexHandle add_vertex(const Vec3d &p) override
    {
        vertex.push_back(p);
        return VertexHandle(static_cast<int>(vertex.size()) - 1);
    }
    VertexHandle add_vertex(const Vec3f &p) override
    {
        return add_vertex(Vec3d(p));
    }
    VertexHandle add_vertex() override
    {
        return add_vertex(Vec3d(0, 0, 0));
    }
    void set_point(VertexHandle v, const Vec3f &p) override
    {
        if (v.idx() >= 0 && static_cast<size_t>(v.idx()) < vertex.size())
            vertex[static_cast<size_t>(v.idx())] = Vec3d(p);
    }
    FaceHandle add_face(const VHandles &indices) override
    {
        for (size_t i = 2; i < indices.size(); i++) {
            corner.push_back(indices[0].idx());
            corner.push_back(indices[i - 1].idx());
            corner.push_back(indices[i].idx());
            source.push_back(faces);
        }
        polygons += indices.size() > 3;
        return FaceHandle(static_cast<int>(faces++));
    }
    size_t n_vertices() const override
    {
        return vertex.size();
    }
    size_t n_faces() const override
    {
        return static_cast<size_t>(faces);
    }
    size_t n_edges() const override
    {
        return 0;
    }

    /* What a soup does not keep. */
    HalfedgeHandle add_edge(VertexHandle, VertexHandle) override
    {
        return HalfedgeHandle();
    }
    FaceHandle add_face(HalfedgeHandle) override
    {
        return FaceHandle();
    }
    void add_face_texcoords(FaceHandle, VertexHandle, const std::vector<Vec2f> &) override
    {
    }
    void add_face_texcoords(FaceHandle, VertexHandle, const std::vector<Vec3f> &) override
    {
    }
    void set_face_texindex(FaceHandle, int) override
    {
    }
    void set_halfedge(VertexHandle, HalfedgeHandle) override
    {
    }
    void set_normal(VertexHandle, const Vec3f &) override
    {
    }
    void set_normal(VertexHandle, const Vec3d &) override
    {
    }
    void set_color(VertexHandle, const Vec3uc &) override
    {
    }
    void set_color(VertexHandle, const Vec4uc &) override
    {
    }
    void set_color(VertexHandle, const Vec3f &) override
    {
    }
    void set_color(VertexHandle, const Vec4f &) override
    {
    }
    void set_texcoord(VertexHandle, const Vec2f &) override
    {
    }
    void set_status(VertexHandle, const Attributes::StatusInfo &) override
    {
    }
    void set_next(HalfedgeHandle, HalfedgeHandle) override
    {
    }
    void set_face(HalfedgeHandle, FaceHandle) override
    {
    }
    void request_face_texcoords2D() override
    {
    }
    void set_texcoord(HalfedgeHandle, const Vec2f &) override
    {
    }
    void set_texcoord(VertexHandle, const Vec3f &) override
    {
    }
    void set_texcoord(HalfedgeHandle, const Vec3f &) override
    {
    }
    void set_status(HalfedgeHandle, const Attributes::StatusInfo &) override
    {
    }
    void set_color(EdgeHandle, const Vec3uc &) override
    {
    }
    void set_color(EdgeHandle, const Vec4uc &) override
    {
    }
    void set_color(EdgeHandle, const Vec3f &) override
    {
    }
    void set_color(EdgeHandle, const Vec4f &) override
    {
    }
    void set_status(EdgeHandle, const Attributes::StatusInfo &) override
    {
    }
    void set_normal(FaceHandle, const Vec3f &) override
    {
    }
    void set_normal(FaceHandle, const Vec3d &) override
    {
    }
    void set_color(FaceHandle, const Vec3uc &) override
    {
    }
    void set_color(FaceHandle, const Vec4uc &) override
    {
    }
    void set_color(FaceHandle, const Vec3f &) override
    {
    }
    void set_color(FaceHandle, const Vec4f &) override
    {
    }
    void set_status(FaceHandle, const Attributes::StatusInfo &) override
    {
    }
    void add_texture_information(int, std::string) override
    {
    }
};

/* The C arrays of what the importer received; at least one element each so that none is NULL. */
lf_status hand_over(const SoupImporter &in, lf_soup *out, lf_error *err)
{
    lf_soup s = {};
    s.vertices = static_cast<long>(in.vertex.size());
    s.triangles = static_cast<long>(in.source.size());
    s.faces = in.faces;
    s.polygons = in.polygons;
    s.vertex = static_cast<double(*)[3]>(malloc((in.vertex.size() + 1) * sizeof *s.vertex));
    s.face = static_cast<int32_t(*)[3]>(malloc((in.source.size() + 1) * sizeof *s.face));
    s.source = static_cast<long *>(malloc((in.source.size() + 1) * sizeof *s.source));
    if (!s.vertex || !s.face || !s.source) {
        lf_soup_free(&s);
        return lf_fail(err, LF_FAILED, "no memory for a mesh of %ld vertices", s.vertices);
    }
    for (size_t i = 0; i < in.vertex.size(); i++)
        for (unsigned j = 0; j < 3; j++)
            s.vertex[i][j] = in.vertex[i][j];
    for (size_t i = 0; i < in.source.size(); i++) {
        for (size_t j = 0; j < 3; j++)
            s.face[i][j] = in.corner[3 * i + j];
        s.source[i] = in.source[i];
    }
    *out = s;
    return LF_OK;
}

struct Traits : public DefaultTraits {
    typedef Vec3d Point;
    typedef Vec3d Normal;
    typedef Vec3uc Color;
    VertexAttributes(0);
    HalfedgeAttributes(Attributes::PrevHalfedge);
    EdgeAttributes(0);
    FaceAttributes(Attributes::Color);
};
using HalfEdges = TriMesh_ArrayKernelT<Traits>;

unsigned char byte(float c)
{
    return static_cast<unsigned char>(std::lround(255.0F * (c < 0 ? 0 : c > 1 ? 1 : c)));
}

/* False as soon as a face does not fit. */
bool build(const lf_mesh *mesh, HalfEdges &out)
{
    std::vector<VertexHandle> handle;
    for (long i = 0; i < mesh->vertices; i++)
        handle.push_back(
            out.add_vertex(Vec3d(mesh->vertex[i][0], mesh->vertex[i][1], mesh->vertex[i][2])));
    for (long i = 0; i < mesh->faces; i++) {
        const int32_t *f = mesh->face[i];
        if (f[0] == f[1] || f[1] == f[2] || f[2] == f[0])
            return false;
        const FaceHandle face =
            out.add_face(handle[static_cast<size_t>(f[0])], handle[static_cast<size_t>(f[1])],
                         handle[static_cast<size_t>(f[2])]);
        if (!face.is_valid())
            return false;
        const float *c = mesh->colour[i];
        out.set_color(face, Vec3uc(byte(c[0]), byte(c[1]), byte(c[2])));
    }
    return true;
}

} // namespace

extern "C" void lf_soup_free(lf_soup *soup)
{
    free(soup->vertex);
    free(soup->face);
    free(soup->source);
    *soup = lf_soup{};
}

extern "C" lf_status lf_openmesh_read(const char *path, const char *ending, lf_bytes file,
                                      bool binary, lf_soup *out, lf_error *err)
{
    try {
        SoupImporter importer;
        bool done;
        {
            const Quiet quiet;
            std::istringstream in(std::string(file.data, file.size), std::ios::binary);
            IO::Options options;
            if (binary)
                options += IO::Options::Binary;
            done = IO::IOManager().read(in, ending, importer, options);
        }
        if (!done)
            return lf_fail(err, LF_BAD_INPUT, "%s: OpenMesh's %s reader refuses the file", path,
                           ending);
        return hand_over(importer, out, err);
    } catch (const std::exception &e) {
        return lf_fail(err, LF_FAILED, "%s: reading failed: %s", path, e.what());
    } catch (...) {
        return lf_fail(err, LF_FAILED, "%s: reading failed", path);
    }
}

extern "C" bool lf_openmesh_manifold(const lf_mesh *mesh)
{
    try {
        const Quiet quiet;
        HalfEdges half;
        return build(mesh, half);
    } catch (...) {
        return false;
    }
}

extern "C" lf_status lf_openmesh_write_ply(const char *path, const lf_mesh *mesh, bool *taken,
                                           lf_error *err)
{
    try {
        const Quiet quiet;
        HalfEdges half;
        *taken = build(mesh, half);
        if (!*taken)
            return LF_OK;
        std::ofstream out(path, std::ios::binary);
        IO::Options options(IO::Options::Binary | IO::Options::FaceColor);
        const bool done = out && IO::write_mesh(half, out, ".ply", options);
        out.close();
        if (!done || out.fail())
            return lf_fail(err, LF_FAILED, "%s: cannot be written", path);
        return LF_OK;
    } catch (const std::exception &e) {
        return lf_fail(err, LF_FAILED, "%s: writing failed: %s", path, e.what());
    } catch (...) {
        return lf_fail(err, LF_FAILED, "%s: writing failed", path);
    }
}
