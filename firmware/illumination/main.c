/* Illumination controller: ATmega328P at 8 MHz (internal oscillator, so that 3.3 V is enough).

   PB1 (OC1A)  LED driver        PD2 (INT0)  camera trigger, rising edge
   PC0 (ADC0)  LED thermistor    PC1 (ADC1)  silicone thermistor
   PC4, PC5    SDA, SCL

   timer 0: 1 ms tick   timer 1: 10-bit PWM, 7.8 kHz   timer 2: strobe, 32 us
   All work is done in interrupts; the main loop feeds the watchdog while the tick and the ADC both run. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/twi.h>

#include "core.h"
#include "reset_cause.h"

FUSES = {
    .low = FUSE_CKSEL0 & FUSE_CKSEL2 & FUSE_CKSEL3 & FUSE_SUT0, /* internal 8 MHz, slow start */
    .high = FUSE_SPIEN & FUSE_EESAVE,                           /* no bootloader */
    .extended = FUSE_BODLEVEL1,                                 /* brown-out at 2.7 V */
};

#define TICK_TOP (F_CPU / 64 / 1000 - 1)
#define ADC_EVERY_MS 4

static core_t core;
static volatile uint8_t tick_seen, adc_seen;
static uint16_t led_adc;
static bool flashing, steady;

static void led_off(void) { TCCR1A &= (uint8_t)~_BV(COM1A1); }

static void led_on(void) {
    uint16_t duty = core_duty(&core);
    OCR1A = duty;
    if (duty) {
        TCCR1A |= _BV(COM1A1);
    } else {
        led_off(); /* a compare value of 0 would still give a pulse of one cycle */
    }
}

ISR(TIMER0_COMPA_vect) {
    static uint8_t since_adc;
    core_tick_ms(&core);
    steady = core.reg[REG_STROBE_WIDTH] == 0;
    if (steady || (flashing && core_duty(&core) == 0)) {
        led_on();
    } else if (!flashing) {
        led_off();
    }
    if (++since_adc == ADC_EVERY_MS) {
        since_adc = 0;
        ADCSRA |= _BV(ADSC);
    }
    tick_seen = 1;
}

ISR(ADC_vect) {
    uint16_t value = ADC;
    if (ADMUX & 1) {
        core_temperatures(&core, led_adc, value);
        adc_seen = 1;
    } else {
        led_adc = value;
    }
    ADMUX ^= 1;
}

static void strobe_timer(uint8_t ticks) {
    TCNT2 = 0;
    OCR2A = (uint8_t)(ticks - 1);
    TIFR2 = _BV(OCF2A);
    TIMSK2 = _BV(OCIE2A);
    TCCR2B = _BV(CS22) | _BV(CS21); /* 8 MHz / 256 */
}

static void flash(void) {
    flashing = true;
    led_on();
    TCNT1 = DUTY_MAX - 1; /* a new period at once: the flash starts with the edge, not with the PWM */
    strobe_timer((uint8_t)core.reg[REG_STROBE_WIDTH]);
}

ISR(INT0_vect) {
    core_trigger(&core);
    if (core.reg[REG_STROBE_WIDTH] == 0) {
        return;
    }
    led_off();
    flashing = false;
    if (core.reg[REG_STROBE_DELAY]) {
        strobe_timer((uint8_t)core.reg[REG_STROBE_DELAY]);
    } else {
        flash();
    }
}

ISR(TIMER2_COMPA_vect) {
    TCCR2B = 0;
    TIMSK2 = 0;
    if (!flashing && core.reg[REG_STROBE_WIDTH]) {
        flash();
        return;
    }
    flashing = false;
    if (!steady) {
        led_off();
    }
}

ISR(TWI_vect) {
    bool acknowledge = true;
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
        TWCR = _BV(TWINT) | _BV(TWSTO) | _BV(TWEA) | _BV(TWEN) | _BV(TWIE);
        return;
    default: /* not acknowledged, or the last byte was sent: listen again */
        break;
    }
    TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWIE) | (acknowledge ? _BV(TWEA) : 0);
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

    ICR1 = DUTY_MAX; /* mode 14: fast PWM, top in ICR1 */
    TCCR1A = _BV(WGM11);
    TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS10);

    TCCR0A = _BV(WGM01);
    TCCR0B = _BV(CS01) | _BV(CS00);
    OCR0A = TICK_TOP;
    TIMSK0 = _BV(OCIE0A);

    TCCR2A = _BV(WGM21);

    EICRA = _BV(ISC01) | _BV(ISC00);
    EIMSK = _BV(INT0);

    ADMUX = _BV(REFS0);
    ADCSRA = _BV(ADEN) | _BV(ADIE) | _BV(ADPS2) | _BV(ADPS1);

    TWAR = I2C_ADDRESS << 1;
    TWCR = _BV(TWEN) | _BV(TWIE) | _BV(TWEA);

    wdt_enable(WDTO_250MS);
    sei();
    for (;;) {
        sleep_mode();
        if (tick_seen && adc_seen) {
            tick_seen = adc_seen = 0;
            wdt_reset();
        }
    }
}
