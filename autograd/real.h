/* real.h: the scalar of tensors, float or double by the build (LF_DOUBLE), and its functions. */
#ifndef LF_AUTOGRAD_REAL_H
#define LF_AUTOGRAD_REAL_H

#include <math.h>

#ifdef LF_DOUBLE
typedef double lf_real;
#define LF_REAL_NAME "f64"
#define LF_EXP exp
#define LF_SQRT sqrt
#define LF_FABS fabs
#else
typedef float lf_real;
#define LF_REAL_NAME "f32"
#define LF_EXP expf
#define LF_SQRT sqrtf
#define LF_FABS fabsf
#endif

#endif
