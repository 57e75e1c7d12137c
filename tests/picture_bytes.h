/* picture_bytes.h: pictures that elf reads and does not write: 16-bit PNG and EXR, as small files
 * without compression, from their specifications (RFC 2083, RFC 1950; OpenEXR file layout). */
#ifndef LF_TESTS_PICTURE_BYTES_H
#define LF_TESTS_PICTURE_BYTES_H

#include <stdint.h>
#include <stdio.h>
#include <string.h>

typedef struct file_bytes {
    size_t count;
    uint8_t byte[1 << 16];
} file_bytes;

static inline void put_big(file_bytes *b, uint32_t x, int count)
{
    for (int i = count - 1; i >= 0; i--)
        b->byte[b->count++] = (uint8_t)(x >> 8 * i);
}

static inline void put_little(file_bytes *b, uint64_t x, int count)
{
    for (int i = 0; i < count; i++)
        b->byte[b->count++] = (uint8_t)(x >> 8 * i);
}

static inline void put_all(file_bytes *b, const void *from, size_t count)
{
    memcpy(b->byte + b->count, from, count);
    b->count += count;
}

/* ---- PNG ---- */

static inline uint32_t crc_of(const uint8_t *at, size_t count)
{
    uint32_t crc = 0xffffffff;
    for (size_t i = 0; i < count; i++) {
        crc ^= at[i];
        for (int k = 0; k < 8; k++)
            crc = crc & 1 ? crc >> 1 ^ 0xedb88320 : crc >> 1;
    }
    return ~crc;
}

static inline void put_chunk(file_bytes *b, const char *name, const file_bytes *data)
{
    put_big(b, (uint32_t)data->count, 4);
    const size_t from = b->count;
    put_all(b, name, 4);
    put_all(b, data->byte, data->count);
    put_big(b, crc_of(b->byte + from, b->count - from), 4);
}

/* One stored block of the zlib format. */
static inline void put_stored(file_bytes *b, const file_bytes *raw)
{
    uint32_t a = 1, c = 0;
    for (size_t i = 0; i < raw->count; i++) {
        a = (a + raw->byte[i]) % 65521;
        c = (c + a) % 65521;
    }
    put_big(b, 0x7801, 2);
    put_little(b, 1, 1);
    put_little(b, raw->count, 2);
    put_little(b, ~raw->count & 0xffff, 2);
    put_all(b, raw->byte, raw->count);
    put_big(b, c << 16 | a, 4);
}

/* RGBA of 16 bits; value [height][width][4]. */
static inline void png16(file_bytes *out, int width, int height, const uint16_t *value)
{
    static file_bytes header, raw, packed, nothing;
    header.count = raw.count = packed.count = nothing.count = out->count = 0;
    put_all(out, "\x89PNG\r\n\x1a\n", 8);
    put_big(&header, (uint32_t)width, 4);
    put_big(&header, (uint32_t)height, 4);
    put_all(&header, "\x10\x06\0\0\0", 5);
    for (int row = 0; row < height; row++) {
        put_little(&raw, 0, 1); /* no filter */
        for (int i = 0; i < 4 * width; i++)
            put_big(&raw, value[4 * width * row + i], 2);
    }
    put_stored(&packed, &raw);
    put_chunk(out, "IHDR", &header);
    put_chunk(out, "IDAT", &packed);
    put_chunk(out, "IEND", &nothing);
}

/* ---- EXR ---- */

static inline void put_attribute(file_bytes *b, const char *name, const char *type,
                                 const void *value, size_t size)
{
    put_all(b, name, strlen(name) + 1);
    put_all(b, type, strlen(type) + 1);
    put_little(b, size, 4);
    put_all(b, value, size);
}

/* RGBA in floats, as stored: colours multiplied by alpha; value [height][width][4]. */
static inline void exr(file_bytes *out, int width, int height, const float *value)
{
    static file_bytes channels;
    const int32_t window[4] = {0, 0, width - 1, height - 1};
    const float one = 1, zero[2] = {0, 0};
    channels.count = out->count = 0;
    for (int c = 0; c < 4; c++) { /* by name: A, B, G, R */
        const char name[2] = {"ABGR"[c], 0};
        put_all(&channels, name, 2);
        put_little(&channels, 2, 4); /* float */
        put_little(&channels, 0, 4);
        put_little(&channels, 1, 4);
        put_little(&channels, 1, 4);
    }
    put_little(&channels, 0, 1);
    put_all(out, "\x76\x2f\x31\x01\2\0\0\0", 8);
    put_attribute(out, "channels", "chlist", channels.byte, channels.count);
    put_attribute(out, "compression", "compression", "", 1);
    put_attribute(out, "dataWindow", "box2i", window, sizeof window);
    put_attribute(out, "displayWindow", "box2i", window, sizeof window);
    put_attribute(out, "lineOrder", "lineOrder", "", 1);
    put_attribute(out, "pixelAspectRatio", "float", &one, sizeof one);
    put_attribute(out, "screenWindowCenter", "v2f", zero, sizeof zero);
    put_attribute(out, "screenWindowWidth", "float", &one, sizeof one);
    put_little(out, 0, 1);
    const size_t line = (size_t)width * 16, data = out->count + (size_t)height * 8;
    for (int row = 0; row < height; row++)
        put_little(out, data + (size_t)row * (line + 8), 8);
    for (int row = 0; row < height; row++) {
        put_little(out, (uint64_t)row, 4);
        put_little(out, line, 4);
        for (int c = 3; c >= 0; c--)
            for (int i = 0; i < width; i++)
                put_all(out, value + 4 * (row * width + i) + c, sizeof(float));
    }
}

#endif
