/* safetensors_format.h: what writing and reading share. Internal to autograd/. */
#ifndef LF_AUTOGRAD_SAFETENSORS_FORMAT_H
#define LF_AUTOGRAD_SAFETENSORS_FORMAT_H

#include <xxhash.h>

#include "autograd/safetensors.h"

#define LF_CHECKSUM_KEY "xxh3_128"
#define LF_METADATA_KEY "__metadata__"

/* The checksum of bytes added so far, as 32 hexadecimal digits. */
static inline void lf_checksum_text(const XXH3_state_t *state, char text[33])
{
    const XXH128_hash_t h = XXH3_128bits_digest(state);
    snprintf(text, 33, "%016llx%016llx", (unsigned long long)h.high64, (unsigned long long)h.low64);
}

#endif
