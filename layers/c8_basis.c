/* c8_basis.c: ring harmonics sampled on a filter's pixels, turned analytically. [c8.h; method.md
 * 5a.1]
 *
 * Everything is computed in double and rounded once.
 */
#include "layers/c8.h"

static const double PI = 3.14159265358979323846, ALIASED = 1e-2;

static int highest_frequency(lf_c8_cutoff cutoff, int ring, int rings)
{
    if (cutoff == LF_C8_REDET)
        return 3 * ring;
    if (ring == 0)
        return 0;
    const int limit = ring == rings - 1 ? 2 : 2 * ring - (ring + 1) % 2;
    return 2 * ring < limit ? 2 * ring : limit;
}

static double ring_width(int ring, int rings)
{
    if (ring == 0)
        return 0.005;
    return ring == rings - 1 ? 0.4 : 0.6;
}

/* One member at pixel (row, col) in rotation a. Rows run downwards, so y = -row. */
static double member(int size, int ring, int frequency, bool sine, int row, int col, int a)
{
    const double half = (size - 1) / 2.0, x = col - half, y = half - row;
    if (frequency > 0 && x == 0 && y == 0)
        return 0;
    const double d = (hypot(x, y) - ring) / ring_width(ring, (size + 1) / 2);
    const double angle = frequency * (atan2(y, x) - 2 * PI * a / LF_C8);
    return exp(-0.5 * d * d) * (sine ? sin(angle) : cos(angle));
}

/* Energy that the member is scaled by: see c8.h. */
static double energy(int size, lf_c8_cutoff cutoff, int ring, int frequency, bool sine)
{
    const int rotations = cutoff == LF_C8_E2CNN ? LF_C8 : 1;
    double sum = 0;
    for (int a = 0; a < rotations; a++)
        for (int p = 0; p < size * size; p++) {
            const double b = member(size, ring, frequency, sine, p / size, p % size, a);
            sum += b * b;
        }
    return sum / rotations;
}

typedef struct harmonic {
    int ring, frequency;
    bool sine;
    double scale;
} harmonic;

/* The members kept, in the order ring, frequency, cos before sin; `list` holds enough for all. */
static int list_members(int size, lf_c8_cutoff cutoff, harmonic *list)
{
    const int rings = (size + 1) / 2;
    int count = 0;
    for (int ring = 0; ring < rings; ring++)
        for (int m = 0; m <= highest_frequency(cutoff, ring, rings); m++)
            for (int sine = 0; sine <= (m > 0); sine++) {
                const double e = energy(size, cutoff, ring, m, sine);
                if (e > ALIASED)
                    list[count++] = (harmonic){ring, m, sine, 1 / sqrt(e)};
            }
    return count;
}

void lf_c8_basis_init(lf_c8_basis *basis, int size, lf_c8_cutoff cutoff)
{
    enum { LARGEST = 15, MOST = 8 * (1 + 2 * 3 * 7) };
    LF_REQUIRE(size >= 1 && size % 2 == 1 && size <= LARGEST, "a C8 filter of size %d", size);
    harmonic list[MOST];
    const int count = list_members(size, cutoff, list);
    const size_t numbers = (size_t)(size * size * count * LF_C8);
    *basis = (lf_c8_basis){.size = size, .count = count};
    basis->table = aligned_alloc(64, (numbers * sizeof(lf_real) + 63) / 64 * 64);
    LF_REQUIRE(basis->table, "out of memory for a basis of %zu numbers", numbers);
    for (int p = 0; p < size * size; p++)
        for (int b = 0; b < count; b++)
            for (int a = 0; a < LF_C8; a++)
                basis->table[(p * count + b) * LF_C8 + a] =
                    (lf_real)(list[b].scale * member(size, list[b].ring, list[b].frequency,
                                                     list[b].sine, p / size, p % size, a));
}

void lf_c8_basis_free(lf_c8_basis *basis)
{
    free(basis->table);
    *basis = (lf_c8_basis){0};
}
