#include "tick_interrupt.h"

#include <avr/interrupt.h>

/* One instruction that changes no register and no flag of the processor, so nothing is saved: 13 cycles. */
ISR(TIMER0_COMPA_vect, ISR_NAKED) {
    GPIOR0 |= TICK_DUE;
    reti();
}
