/* Illumination controller: ATmega328P at 8 MHz (internal oscillator, which allows 3.3 V).

   PB1 (OC1A)  LED driver        PD2 (INT0)  camera trigger, rising edge
   PC0 (ADC0)  LED thermistor    PC1 (ADC1)  silicone thermistor
   PC4, PC5    SDA, SCL

   timer 0: 1 ms tick   timer 1: PWM, 10 bits at 7.8 kHz, 8 bits at 31 kHz for the strobe   timer 2: strobe, 32 us
   Only the strobe works in interrupts. A flash can be delayed by the tick's interrupt (13 cycles) and by the
   ATOMIC_BLOCK (about 20 cycles), by nothing else. The main loop does the rest; the two-wire interface stretches the
   clock until the main loop has served it. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>
#include <util/atomic.h>
#include <util/twi.h>

#include "core.h"
#include "reset_cause.h"
#include "tick_interrupt.h"

FUSES = {
    .low = FUSE_CKSEL0 & FUSE_CKSEL2 & FUSE_CKSEL3 & FUSE_SUT0, /* internal 8 MHz, slow start */
    .high = FUSE_SPIEN & FUSE_EESAVE,                           /* no bootloader */
    .extended = FUSE_BODLEVEL1,                                 /* brown-out at 2.7 V */
};

#define TICK_TOP (F_CPU / 64 / 1000 - 1)
#define STROBE_TOP 255 /* one PWM period is one tick of timer 2, so that each flash has whole periods */
#define BUS_TIMEOUT 35 /* ms, SMBus 3.1 table 2: the longest clock low time before a target releases the bus */
#define UNSETTLED_READINGS 2 /* of each input one, after the reference was selected (data sheet, 24.5.2) */
#define TIMER_START 62 /* cycles from the edge to the timer and from its overflow to the light */
#define FLASH_START 52 /* cycles from the timer's overflow to the end of the light, and a few, so that no period begins */
/* An interrupt that calls a function saves every register. */
#define INLINE static inline __attribute__((always_inline))
#define BUS_LINES (_BV(PINC4) | _BV(PINC5))
#define PWM (_BV(WGM11)) /* mode 14 with WGM13 and WGM12: fast PWM, top in ICR1 */

static core_t core;

/* Shared by the strobe's interrupts and the main loop; each member is one byte. */
static volatile struct {
    uint8_t delay, width; /* 32 us; width 0: steady light */
    bool lit;             /* the duty is not 0 */
    bool flashing;
    uint8_t ticks;    /* ticks until the flash begins or ends */
    uint8_t triggers; /* wraps */
} strobe;

/* Connects the LED driver to the PWM or holds it low: a compare value of 0 would still pulse for one cycle. */
INLINE void switch_led(void) {
    TCCR1A = strobe.lit && (strobe.flashing || strobe.width == 0) ? PWM | _BV(COM1A1) : PWM;
}

INLINE void begin_flash(void) {
    strobe.flashing = true;
    strobe.ticks = strobe.width;
    switch_led();
    TCNT1 = STROBE_TOP - 1; /* starts a new period, so that the flash begins with the edge and not with the PWM */
    TCNT2 = FLASH_START;
}

ISR(INT0_vect) {
    TCNT2 = TIMER_START; /* not by the prescaler, which keeps running: a first tick could be up to 32 us */
    TIFR2 = _BV(TOV2);
    strobe.triggers++;
    if (strobe.width == 0) {
        return;
    }
    TIMSK2 = _BV(TOIE2);
    if (strobe.delay == 0) {
        begin_flash();
        return;
    }
    strobe.flashing = false;
    strobe.ticks = strobe.delay;
    switch_led();
}

ISR(TIMER2_OVF_vect) {
    if (--strobe.ticks) {
        return;
    }
    if (!strobe.flashing && strobe.width) {
        begin_flash();
        return;
    }
    TIMSK2 = 0;
    strobe.flashing = false;
    switch_led();
}

/* Reads the thermistors in turn; returns true when both have been read since the last true. */
static bool read_temperature(void) {
    static uint16_t led_adc;
    static uint8_t unsettled = UNSETTLED_READINGS;
    bool both = ADMUX & 1;
    if (ADCSRA & _BV(ADSC)) {
        return false;
    }
    if (unsettled) {
        unsettled--;
    } else if (both) {
        core_temperatures(&core, led_adc, ADC);
    } else {
        led_adc = ADC;
    }
    ADMUX ^= 1;
    ADCSRA |= _BV(ADSC);
    return both;
}

static uint8_t bus_low_ms; /* how long a line of the bus has been low without a byte */

/* Releases the bus when a transaction was cut off in the middle of a byte that holds the data line low. */
static void watch_bus(void) {
    if ((PINC & BUS_LINES) != BUS_LINES) {
        bus_low_ms++;
    } else {
        bus_low_ms = 0;
    }
    if (bus_low_ms > BUS_TIMEOUT) {
        bus_low_ms = 0;
        TWCR = 0;
        TWCR = _BV(TWEN) | _BV(TWEA);
    }
}

/* Sets PWM and width; a new top needs a new start, or the counter would pass it and count to 65535. */
static void set_light(uint16_t duty, uint8_t width) {
    bool changed = (width == 0) != (strobe.width == 0);
    uint16_t top = width ? STROBE_TOP : DUTY_MAX;
    /* at full duty above the top: no compare match ends the light */
    uint16_t compare = duty == DUTY_MAX ? DUTY_MAX + 1 : duty;
    if (width) {
        compare >>= 2;
    }
    ATOMIC_BLOCK(ATOMIC_FORCEON) { /* all 16-bit registers share one temporary byte */
        if (changed) {
            ICR1 = top;
            TCNT1 = 0;
        }
        strobe.width = width;
        strobe.lit = duty != 0;
        OCR1A = compare;
        switch_led();
    }
}

static void tick(void) {
    if (read_temperature()) {
        wdt_reset();
    }
    core_tick_ms(&core);
    core_triggers(&core, strobe.triggers);
    strobe.delay = (uint8_t)core.reg[REG_STROBE_DELAY];
    set_light(core.reg[REG_DUTY], (uint8_t)core.reg[REG_STROBE_WIDTH]);
    watch_bus();
}

/* Handles one byte of the two-wire interface. */
static void serve_bus(void) {
    bool acknowledge = true;
    bus_low_ms = 0;
    switch (TW_STATUS) {
    case TW_SR_SLA_ACK:
        smbus_start(&core, I2C_ADDRESS << 1);
        break;
    case TW_SR_DATA_ACK:
        acknowledge = smbus_write(&core, TWDR);
        break;
    case TW_SR_STOP:
        smbus_stop(&core);
        break;
    case TW_ST_SLA_ACK:
        smbus_start(&core, I2C_ADDRESS << 1 | 1);
        TWDR = smbus_read(&core);
        break;
    case TW_ST_DATA_ACK:
        TWDR = smbus_read(&core);
        break;
    case TW_BUS_ERROR:
        TWCR = _BV(TWINT) | _BV(TWSTO) | _BV(TWEA) | _BV(TWEN);
        return;
    default: /* not acknowledged, or the last byte was sent: listen again */
        break;
    }
    TWCR = _BV(TWINT) | _BV(TWEN) | (acknowledge ? _BV(TWEA) : 0);
}

static uint8_t reset_faults(void) {
    uint8_t faults = 0;
    if (reset_cause & _BV(WDRF)) {
        faults |= FAULT_RESET_WATCHDOG;
    }
    if (reset_cause & _BV(BORF)) {
        faults |= FAULT_RESET_BROWN_OUT;
    }
    return faults;
}

int main(void) {
    core_init(&core, reset_faults());

    DDRB = _BV(DDB1);
    PORTD = (uint8_t)~_BV(PORTD2); /* no floating inputs */
    DIDR0 = _BV(ADC0D) | _BV(ADC1D);

    ICR1 = DUTY_MAX; /* the first tick writes TCCR1A */
    TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS10);

    TCCR0A = _BV(WGM01);
    TCCR0B = _BV(CS01) | _BV(CS00);
    OCR0A = TICK_TOP;
    TIMSK0 = _BV(OCIE0A);

    TCCR2B = _BV(CS20); /* overflows every 256 cycles */

    EICRA = _BV(ISC01) | _BV(ISC00);
    EIMSK = _BV(INT0);

    ADMUX = _BV(REFS0);
    ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADPS2) | _BV(ADPS1);

    TWAR = I2C_ADDRESS << 1;
    TWCR = _BV(TWEN) | _BV(TWEA);

    wdt_enable(WDTO_250MS);
    sei();
    for (;;) {
        if (GPIOR0 & TICK_DUE) {
            GPIOR0 &= (uint8_t)~TICK_DUE;
            tick();
        }
        if (TWCR & _BV(TWINT)) {
            serve_bus();
        }
    }
}
