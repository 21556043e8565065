/* Written by firmware/illumination/generate.py from registers.toml: edit registers.toml. */
#ifndef REGISTERS_H
#define REGISTERS_H

#define IDENTITY 0x5041
#define VERSION 0x0002
#define I2C_ADDRESS 0x002A
#define TABLE_CRC 0x3268

#define REG_IDENTITY 0x00
#define REG_VERSION 0x01
#define REG_MAP_CRC 0x02
#define REG_LEVEL 0x03
#define REG_SOFT_START 0x04
#define REG_WATCHDOG 0x05
#define REG_STROBE_DELAY 0x06
#define REG_STROBE_WIDTH 0x07
#define REG_DERATE_START 0x08
#define REG_CUT_OFF 0x09
#define REG_LED_TEMPERATURE 0x10
#define REG_SILICONE_TEMPERATURE 0x11
#define REG_DUTY 0x12
#define REG_FAULTS 0x13
#define REG_FAULT_CLEAR 0x14
#define REG_UPTIME 0x15
#define REG_TRIGGERS 0x16
#define REG_PEC_ERRORS 0x17
#define REG_PRESENT 0x18
#define REGISTER_COUNT 25

#define FAULT_OVER_TEMPERATURE 0x01
#define FAULT_LED_SENSOR 0x02
#define FAULT_SILICONE_SENSOR 0x04
#define FAULT_BOARD_SILENT 0x08
#define FAULT_RESET_WATCHDOG 0x10
#define FAULT_RESET_BROWN_OUT 0x20
#define FAULTS_DARK 0x03 /* the light is off while one of these is present */

/* writable registers: register, least and greatest value, value after reset */
#define WRITABLE(X) \
    X(REG_LEVEL, 0, 255, 0) \
    X(REG_SOFT_START, 0, 5000, 200) \
    X(REG_WATCHDOG, 100, 10000, 1000) \
    X(REG_STROBE_DELAY, 0, 255, 0) \
    X(REG_STROBE_WIDTH, 0, 255, 0) \
    X(REG_DERATE_START, 300, 900, 600) \
    X(REG_CUT_OFF, 400, 950, 750) \
    X(REG_FAULT_CLEAR, 0, 255, 0)

/* readable registers */
#define READABLE(X) \
    X(REG_IDENTITY) \
    X(REG_VERSION) \
    X(REG_MAP_CRC) \
    X(REG_LEVEL) \
    X(REG_SOFT_START) \
    X(REG_WATCHDOG) \
    X(REG_STROBE_DELAY) \
    X(REG_STROBE_WIDTH) \
    X(REG_DERATE_START) \
    X(REG_CUT_OFF) \
    X(REG_LED_TEMPERATURE) \
    X(REG_SILICONE_TEMPERATURE) \
    X(REG_DUTY) \
    X(REG_FAULTS) \
    X(REG_UPTIME) \
    X(REG_TRIGGERS) \
    X(REG_PEC_ERRORS) \
    X(REG_PRESENT)

/* 0.1 degC at ADC readings 0, 32, 64, ... */
#define THERMISTOR_STEP 32
#define THERMISTOR { \
    3521, 1293, 1016, 866, 763, 685, 621, 567, \
    520, 477, 439, 403, 370, 338, 308, 278, \
    250, 222, 194, 167, 139, 111, 83, 53, \
    22, -11, -47, -87, -132, -186, -256, -364, \
    -774 }

#endif
