/* same_arrays.c: "same_arrays A B": exit code 0 if two safetensors files hold the same arrays, else
 * 1 and what differs. For test_programs.sh. */
#include "tests/same_arrays.h"

int main(int argc, char **argv)
{
    lf_error text = {""};
    if (argc != 3) {
        fprintf(stderr, "same_arrays A.safetensors B.safetensors\n");
        return 2;
    }
    const char *found = different_arrays(argv[1], argv[2], &text);
    if (found)
        printf("%s, %s: %s\n", argv[1], argv[2], found);
    return found ? 1 : 0;
}
