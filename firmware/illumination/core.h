/* The controller's logic without hardware: the same file runs on the ATmega328P and, for tests, on a PC.

   Nothing here blocks or reads a clock. One loop calls all functions: core_tick_ms every millisecond,
   core_temperatures when the ADC has measured both, the smbus functions for each byte of the two-wire interface. */
#ifndef CORE_H
#define CORE_H

#include <stdbool.h>
#include <stdint.h>

#include "registers.h"

#define DUTY_MAX 1023

typedef struct {
    uint16_t adc;   /* the filtered reading; 0 before the first whole one */
    uint8_t broken; /* net broken readings, 0 to BROKEN_READINGS */
} thermistor_t;

typedef struct {
    uint16_t reg[REGISTER_COUNT];
    uint16_t level_now;    /* 8.8 fixed point: LEVEL after soft start and derating */
    uint16_t silent_ms;    /* time since the last valid transaction */
    uint16_t ms;           /* part of a second, for UPTIME */
    thermistor_t led, silicone;
    /* one SMBus transaction */
    uint8_t received;      /* bytes after the address */
    uint8_t sent;
    uint8_t crc;
    uint8_t command;
    uint16_t value;
} core_t;

void core_init(core_t *core, uint8_t reset_faults);
void core_tick_ms(core_t *core);
void core_temperatures(core_t *core, uint16_t led_adc, uint16_t silicone_adc);
void core_triggers(core_t *core, uint8_t count); /* the low byte of TRIGGERS */
uint16_t core_duty(const core_t *core);

/* The target's side of SMBus. smbus_write returns whether to acknowledge the NEXT byte. */
void smbus_start(core_t *core, uint8_t address_and_direction);
bool smbus_write(core_t *core, uint8_t byte);
uint8_t smbus_read(core_t *core);
void smbus_stop(core_t *core);

int16_t thermistor_dC(uint16_t adc);
uint8_t crc8(uint8_t crc, uint8_t byte);

#endif
