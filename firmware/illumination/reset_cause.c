#include "reset_cause.h"

#include <avr/io.h>
#include <avr/wdt.h>

uint8_t reset_cause __attribute__((section(".noinit")));

/* Runs before anything else: after a watchdog reset the watchdog continues with 16 ms. */
__attribute__((naked, used, section(".init3"))) void keep_reset_cause(void) {
    reset_cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
}
