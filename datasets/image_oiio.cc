/* image_oiio.cc: the thin wrapper around OpenImageIO. No exception leaves it. */
#include "datasets/image.h"

#include <OpenImageIO/imagebuf.h>
#include <OpenImageIO/imagebufalgo.h>
#include <OpenImageIO/imageio.h>

#include <cmath>
#include <exception>
#include <fstream>
#include <memory>
#include <string>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

namespace
{

using namespace OIIO;

struct Free {
    void operator()(lf_image *image) const
    {
        lf_image_free(image);
    }
};

/* Orientations 5 to 8 of EXIF exchange columns and rows. */
bool lies_on_its_side(const ImageSpec &spec)
{
    return spec.get_int_attribute("Orientation", 1) > 4;
}

lf_status check_spec(const char *path, const ImageSpec &spec, lf_error *err)
{
    const std::string space = spec.get_string_attribute("oiio:ColorSpace");
    if (spec.width < 1 || spec.height < 1 || spec.width > LF_IMAGE_SIZE_MAX ||
        spec.height > LF_IMAGE_SIZE_MAX)
        return lf_fail(err, LF_BAD_INPUT, "%s: the picture is %d x %d, allowed are 1 to %d", path,
                       spec.width, spec.height, static_cast<int>(LF_IMAGE_SIZE_MAX));
    if (space == "CMYK" || (spec.nchannels >= 1 && spec.channelnames.size() >= 1 &&
                            (spec.channelnames[0] == "C" || spec.channelnames[0] == "Cyan")))
        return lf_fail(err, LF_BAD_INPUT, "%s: the picture is CMYK; save it as RGB", path);
    if (spec.nchannels < 1 || spec.nchannels > 4)
        return lf_fail(err, LF_BAD_INPUT, "%s: the picture has %d channels, allowed are 1 to 4",
                       path, spec.nchannels);
    if (spec.deep || spec.depth > 1)
        return lf_fail(err, LF_BAD_INPUT, "%s: a deep or volume picture cannot be used", path);
    return LF_OK;
}

/* OpenImageIO's own message, without its line ends. */
std::string last_message()
{
    std::string text = geterror();
    while (!text.empty() && (text.back() == '\n' || text.back() == '.'))
        text.pop_back();
    return text.empty() ? "no known format" : text;
}

unsigned long big_endian(const unsigned char *b)
{
    return static_cast<unsigned long>(b[0]) << 24 | static_cast<unsigned long>(b[1]) << 16 |
           static_cast<unsigned long>(b[2]) << 8 | static_cast<unsigned long>(b[3]);
}

/* Whether the chunks of a PNG follow one another up to IEND; other formats pass. libpng would
 * complain of a file cut short on stderr and leak. */
bool png_is_whole(const char *path)
{
    static const unsigned char signature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    std::ifstream in(path, std::ios::binary);
    unsigned char head[8];
    in.read(reinterpret_cast<char *>(head), 8);
    if (in.gcount() < 4 || memcmp(head, signature, 4) != 0)
        return true;
    in.seekg(0, std::ios::end);
    const long size = static_cast<long>(in.tellg());
    for (long at = 8; at + 12 <= size;) {
        in.seekg(at);
        if (!in.read(reinterpret_cast<char *>(head), 8))
            return false;
        at += 12 + static_cast<long>(big_endian(head));
        if (memcmp(head + 4, "IEND", 4) == 0)
            return at <= size;
    }
    return false;
}

lf_status check_file(const char *path, lf_error *err)
{
    struct stat info;
    if (access(path, R_OK) != 0 || stat(path, &info) != 0)
        return lf_fail(err, LF_BAD_INPUT, "%s: cannot be opened: %s", path, strerror(errno));
    if (!S_ISREG(info.st_mode) || info.st_size == 0)
        return lf_fail(err, LF_BAD_INPUT, "%s: %s", path,
                       S_ISREG(info.st_mode) ? "the file is empty" : "is not a regular file");
    if (!png_is_whole(path))
        return lf_fail(err, LF_BAD_INPUT, "%s: the picture is damaged or cut short: no IEND", path);
    return LF_OK;
}

/* Copy into *image, cut to 0..1. */
lf_status take_pixels(const char *path, const ImageBuf &buffer, lf_image *image, lf_error *err)
{
    const size_t count = static_cast<size_t>(image->width) * static_cast<size_t>(image->height) *
                         static_cast<size_t>(image->channels);
    if (!buffer.get_pixels(get_roi(buffer.spec()), TypeDesc::FLOAT, image->pixel))
        return lf_fail(err, LF_BAD_INPUT, "%s: %s", path, buffer.geterror().c_str());
    for (size_t i = 0; i < count; i++) {
        float &v = image->pixel[i];
        if (!std::isfinite(v))
            return lf_fail(err, LF_BAD_INPUT, "%s: pixel %zu has the value %g", path,
                           i / static_cast<size_t>(image->channels), static_cast<double>(v));
        v = v < 0 ? 0 : v > 1 ? 1 : v;
    }
    return LF_OK;
}

/* Make alpha straight. OpenImageIO multiplies colours by alpha where the format does not store them
 * so, but for those readers that heed the wish of read_buffer and then say so. */
lf_status straighten(const char *path, const std::string &format, ImageBuf &buffer, lf_error *err)
{
    const ImageSpec &spec = buffer.spec();
    if (spec.alpha_channel < 0 || spec.get_int_attribute("oiio:UnassociatedAlpha") != 0)
        return LF_OK;
    if (format == "webp" || format == "jpeg2000")
        return lf_fail(err, LF_BAD_INPUT,
                       "%s: the alpha of a %s picture cannot be read exactly; save it as PNG", path,
                       format.c_str());
    if (format != "openexr" && format != "tiff")
        return LF_OK; /* stored straight, and passed on as stored */
    const size_t channels = static_cast<size_t>(spec.nchannels);
    const size_t alpha = static_cast<size_t>(spec.alpha_channel);
    float *at = static_cast<float *>(buffer.localpixels());
    for (size_t i = 0; i < static_cast<size_t>(spec.image_pixels()); i++, at += channels)
        for (size_t c = 0; c < channels; c++)
            if (c != alpha && at[alpha] > 0)
                at[c] /= at[alpha];
    return LF_OK;
}

/* The whole picture as float, not oriented. ImageInput reports a file that is cut short. */
lf_status read_buffer(const char *path, ImageBuf &out, lf_error *err)
{
    ImageSpec wish;
    wish.attribute("oiio:UnassociatedAlpha", 1); /* alpha stays straight */
    const std::unique_ptr<ImageInput> in = ImageInput::open(path, &wish);
    if (!in)
        return lf_fail(err, LF_BAD_INPUT, "%s: is not a picture: %s", path, last_message().c_str());
    ImageSpec spec = in->spec();
    LF_TRY(check_spec(path, spec, err));
    spec.set_format(TypeDesc::FLOAT);
    out.reset(spec, InitializePixels::Yes);
    if (!in->read_image(0, 0, 0, spec.nchannels, TypeDesc::FLOAT, out.localpixels()) ||
        in->has_error())
        return lf_fail(err, LF_BAD_INPUT, "%s: the picture is damaged or cut short: %s", path,
                       in->geterror().c_str());
    return straighten(path, in->format_name(), out, err);
}

lf_status read_image(const char *path, lf_image **out, lf_error *err)
{
    LF_TRY(check_file(path, err));
    ImageBuf raw;
    LF_TRY(read_buffer(path, raw, err));
    const ImageBuf upright = ImageBufAlgo::reorient(raw, 1);
    if (upright.has_error())
        return lf_fail(err, LF_BAD_INPUT, "%s: cannot be turned upright: %s", path,
                       upright.geterror().c_str());
    const ImageSpec &spec = upright.spec();
    std::unique_ptr<lf_image, Free> image(lf_image_create(spec.width, spec.height, spec.nchannels));
    LF_TRY(take_pixels(path, upright, image.get(), err));
    *out = image.release();
    return LF_OK;
}

lf_status write_file(const std::string &path, const lf_image *image, lf_error *err)
{
    const std::unique_ptr<ImageOutput> out = ImageOutput::create("png");
    if (!out)
        return lf_fail(err, LF_FAILED, "%s: OpenImageIO cannot write PNG: %s", path.c_str(),
                       last_message().c_str());
    ImageSpec spec(image->width, image->height, image->channels, TypeDesc::UINT8);
    spec.attribute("oiio:UnassociatedAlpha", 1);
    const size_t count = static_cast<size_t>(image->width) * static_cast<size_t>(image->height) *
                         static_cast<size_t>(image->channels);
    std::vector<unsigned char> bytes(count);
    for (size_t i = 0; i < count; i++) {
        const float v = image->pixel[i];
        bytes[i] = static_cast<unsigned char>(
            std::lround(255.0F * (v > 0 ? (v < 1 ? v : 1) : 0))); /* NaN fails v > 0 */
    }
    const bool done = out->open(path, spec) && out->write_image(TypeDesc::UINT8, bytes.data());
    if (!out->close() || !done)
        return lf_fail(err, LF_FAILED, "%s: cannot be written: %s", path.c_str(),
                       out->geterror().c_str());
    return LF_OK;
}

lf_status write_png(const char *path, const lf_image *image, lf_error *err)
{
    const size_t length = strlen(path);
    if (length < 5 || strcasecmp(path + length - 4, ".png") != 0)
        return lf_fail(err, LF_BAD_INPUT, "%s: the name must end in .png", path);
    const std::string temporary =
        std::string(path) + ".part." + std::to_string(static_cast<long>(getpid()));
    lf_status status = write_file(temporary, image, err);
    if (status == LF_OK && rename(temporary.c_str(), path) != 0)
        status = lf_fail(err, LF_FAILED, "%s: cannot be renamed from %s: %s", path,
                         temporary.c_str(), strerror(errno));
    if (status != LF_OK)
        remove(temporary.c_str());
    return status;
}

lf_status read_size(const char *path, int *width, int *height, int *channels, lf_error *err)
{
    LF_TRY(check_file(path, err));
    const std::unique_ptr<ImageInput> in = ImageInput::open(path);
    if (!in)
        return lf_fail(err, LF_BAD_INPUT, "%s: is not a picture: %s", path, last_message().c_str());
    const ImageSpec &spec = in->spec();
    LF_TRY(check_spec(path, spec, err));
    *width = lies_on_its_side(spec) ? spec.height : spec.width;
    *height = lies_on_its_side(spec) ? spec.width : spec.height;
    *channels = spec.nchannels;
    return LF_OK;
}

/* Run `work`; an exception becomes LF_FAILED. */
template <typename Work>
lf_status guarded(const char *path, lf_error *err, Work work)
{
    try {
        return work();
    } catch (const std::exception &e) {
        return lf_fail(err, LF_FAILED, "%s: %s", path, e.what());
    } catch (...) {
        return lf_fail(err, LF_FAILED, "%s: OpenImageIO failed", path);
    }
}

} // namespace

extern "C" lf_status lf_image_read(const char *path, lf_image **out, lf_error *err)
{
    return guarded(path, err, [=] { return read_image(path, out, err); });
}

extern "C" lf_status lf_image_read_size(const char *path, int *width, int *height, int *channels,
                                        lf_error *err)
{
    return guarded(path, err, [=] { return read_size(path, width, height, channels, err); });
}

extern "C" lf_status lf_image_write_png(const char *path, const lf_image *image, lf_error *err)
{
    return guarded(path, err, [=] { return write_png(path, image, err); });
}
