/* Which sources the library was compiled from: library.py compares it with those beside it. */

#include "kernels.h"

KERNEL uint32_t kernels_checksum(void) { return KERNELS_CHECKSUM; }
