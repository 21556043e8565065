#ifndef TICK_INTERRUPT_H
#define TICK_INTERRUPT_H

#include <avr/io.h>

#define TICK_DUE _BV(GPIOR00) /* in GPIOR0: a millisecond has passed */

#endif
