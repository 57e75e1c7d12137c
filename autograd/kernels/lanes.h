/* lanes.h: how the gradient of a filter is summed over images: in a number of lanes that depends on
 * the shape alone. Lane l takes images l, l + lanes, ...; lanes are added in their order. */
#ifndef LF_AUTOGRAD_KERNELS_LANES_H
#define LF_AUTOGRAD_KERNELS_LANES_H

#include "autograd/kernels/kernels.h"

long lf_conv_lanes(const lf_conv *s);
/* Numbers of scratch that the gradient of the filter needs. */
long lf_conv_dw_scratch(const lf_conv *s);

#endif
