/* command_line.c: see command_line.h. */
#include "bench/command_line.h"

#include <unistd.h>

#include "bench/bench.h"

lf_status lf_bench_positive(const char *option, const char *text, int *value, lf_error *err)
{
    char *end;
    const long n = strtol(text, &end, 10);
    if (*end || end == text || n < 1 || n > 1024)
        return lf_fail(err, LF_BAD_INPUT, "%s %s: a number from 1 to 1024 is needed", option, text);
    *value = (int)n;
    return LF_OK;
}

lf_status lf_bench_check_file(const char *path, lf_error *err)
{
    char folder[4096];
    const char *slash = strrchr(path, '/');
    snprintf(folder, sizeof folder, "%.*s", slash ? (int)(slash - path + 1) : 1,
             slash ? path : ".");
    return access(folder, W_OK) == 0
               ? LF_OK
               : lf_fail(err, LF_BAD_INPUT, "%s: its folder does not exist or refuses files", path);
}

lf_status lf_bench_check_picture(const char *path, lf_error *err)
{
    if (sizeof(lf_real) == sizeof(double))
        return lf_fail(err, LF_BAD_INPUT, "--picture: elf-bench draws it, the program in float");
    const size_t length = strlen(path);
    if (length < 4 || strcmp(path + length - 4, ".png") != 0)
        return lf_fail(err, LF_BAD_INPUT, "--picture %s: a name that ends in .png", path);
    return lf_bench_check_file(path, err);
}
