/* The value of MCUSR at reset. */
#ifndef RESET_CAUSE_H
#define RESET_CAUSE_H

#include <stdint.h>

extern uint8_t reset_cause;

#endif
