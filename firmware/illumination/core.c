#include "core.h"

#define FULL_LEVEL (255u << 8)
#define ADC_SHORTED 12   /* above 190 degC */
#define ADC_OPEN 1011    /* below -52 degC */
#define READING_STEP 4     /* ADC steps that a temperature follows in one reading: a wild reading shifts it by no more */
#define BROKEN_READINGS 32 /* net broken readings that make a fault, and net whole ones that end it */
#define MS_PER_S 1000
#define WRITE_BYTES 4    /* command, low, high, PEC */

static const int16_t thermistor[] = THERMISTOR;

static bool is_readable(uint8_t address) {
    switch (address) {
#define CASE(name) case name:
        READABLE(CASE)
#undef CASE
        return true;
    default:
        return false;
    }
}

typedef struct {
    uint8_t address;
    uint16_t least, greatest;
} range_t;

static const range_t writable[] = {
#define RANGE(name, least, greatest, start) {name, least, greatest},
    WRITABLE(RANGE)
#undef RANGE
};

/* Returns whether the register may be written with this value; the cut-off stays above the start of derating. */
static bool is_allowed(const core_t *core, uint8_t address, uint16_t value) {
    if (address == REG_DERATE_START && value >= core->reg[REG_CUT_OFF]) {
        return false;
    }
    if (address == REG_CUT_OFF && value <= core->reg[REG_DERATE_START]) {
        return false;
    }
    for (uint8_t i = 0; i < sizeof writable / sizeof writable[0]; i++) {
        if (writable[i].address == address) {
            return value >= writable[i].least && value <= writable[i].greatest;
        }
    }
    return false;
}

void core_init(core_t *core, uint8_t reset_faults) {
    *core = (core_t){0};
#define START(name, least, greatest, start) core->reg[name] = (start);
    WRITABLE(START)
#undef START
    core->reg[REG_IDENTITY] = IDENTITY;
    core->reg[REG_VERSION] = VERSION;
    core->reg[REG_MAP_CRC] = TABLE_CRC;
    core->reg[REG_FAULTS] = reset_faults;
}

/* Returns the highest level that the LED temperature allows. */
static uint16_t allowed_level(const core_t *core) {
    int16_t temperature = (int16_t)core->reg[REG_LED_TEMPERATURE];
    int16_t start = (int16_t)core->reg[REG_DERATE_START];
    int16_t cut_off = (int16_t)core->reg[REG_CUT_OFF];
    if (temperature <= start) {
        return FULL_LEVEL;
    }
    if (temperature >= cut_off) {
        return 0;
    }
    return (uint16_t)((uint32_t)FULL_LEVEL * (uint16_t)(cut_off - temperature) / (uint16_t)(cut_off - start));
}

static void follow_level(core_t *core) {
    uint16_t target = core->reg[REG_LEVEL] << 8;
    uint16_t allowed = allowed_level(core);
    uint16_t soft_start = core->reg[REG_SOFT_START];
    if (target > allowed) {
        target = allowed;
    }
    if (core->reg[REG_PRESENT] & FAULTS_DARK) {
        target = 0;
    }
    if (core->level_now >= target || soft_start == 0) {
        core->level_now = target;
        return;
    }
    uint16_t step = (FULL_LEVEL - 1) / soft_start + 1; /* rounded up without a sum that 16 bits cannot hold */
    core->level_now = target - core->level_now > step ? core->level_now + step : target;
}

uint16_t core_duty(const core_t *core) {
    /* the square of the level gives even steps of perceived brightness; no division, as this runs every ms */
    uint16_t level = (uint16_t)(core->level_now + (core->level_now >> 8));
    return (uint16_t)((uint32_t)level * level >> 22);
}

void core_tick_ms(core_t *core) {
    if (++core->ms == MS_PER_S) {
        core->ms = 0;
        core->reg[REG_UPTIME]++;
    }
    if (core->silent_ms < UINT16_MAX) {
        core->silent_ms++;
    }
    if (core->silent_ms > core->reg[REG_WATCHDOG] && core->reg[REG_LEVEL]) {
        core->reg[REG_LEVEL] = 0;
        core->reg[REG_FAULTS] |= FAULT_BOARD_SILENT;
    }
    follow_level(core);
    core->reg[REG_DUTY] = core_duty(core);
}

int16_t thermistor_dC(uint16_t adc) {
    uint8_t i = (uint8_t)(adc / THERMISTOR_STEP);
    int16_t part = (int16_t)(adc % THERMISTOR_STEP);
    return (int16_t)(thermistor[i] + (int32_t)(thermistor[i + 1] - thermistor[i]) * part / THERMISTOR_STEP);
}

static bool is_broken(uint16_t adc) { return adc < ADC_SHORTED || adc > ADC_OPEN; }

/* Follows the readings by small steps, so that adc becomes their median; broken readings are only counted. */
static void follow_reading(thermistor_t *sensor, uint16_t adc) {
    if (is_broken(adc)) {
        if (sensor->broken < BROKEN_READINGS) {
            sensor->broken++;
        }
        return;
    }
    if (sensor->broken) {
        sensor->broken--;
    }
    if (sensor->adc && adc > sensor->adc + READING_STEP) {
        adc = sensor->adc + READING_STEP;
    }
    if (sensor->adc > adc + READING_STEP) {
        adc = sensor->adc - READING_STEP;
    }
    sensor->adc = adc;
}

static void set_present(core_t *core, uint16_t fault, bool begins, bool ends) {
    if (begins) {
        core->reg[REG_PRESENT] |= fault;
    }
    if (ends) {
        core->reg[REG_PRESENT] &= (uint16_t)~fault;
    }
}

void core_temperatures(core_t *core, uint16_t led_adc, uint16_t silicone_adc) {
    thermistor_t *led = &core->led, *silicone = &core->silicone;
    follow_reading(led, led_adc);
    follow_reading(silicone, silicone_adc);
    set_present(core, FAULT_LED_SENSOR, led->broken == BROKEN_READINGS, led->broken == 0);
    set_present(core, FAULT_SILICONE_SENSOR, silicone->broken == BROKEN_READINGS, silicone->broken == 0);
    if (led->adc) {
        int16_t temperature = thermistor_dC(led->adc);
        core->reg[REG_LED_TEMPERATURE] = (uint16_t)temperature;
        set_present(core, FAULT_OVER_TEMPERATURE, temperature >= (int16_t)core->reg[REG_CUT_OFF],
                    temperature < (int16_t)core->reg[REG_DERATE_START]);
    }
    if (silicone->adc) {
        core->reg[REG_SILICONE_TEMPERATURE] = (uint16_t)thermistor_dC(silicone->adc);
    }
    core->reg[REG_FAULTS] |= core->reg[REG_PRESENT];
}

void core_triggers(core_t *core, uint8_t count) {
    core->reg[REG_TRIGGERS] += (uint8_t)(count - (uint8_t)core->reg[REG_TRIGGERS]);
}

static void clear_faults(core_t *core, uint16_t faults) {
    core->reg[REG_FAULTS] &= (uint16_t)~faults;
    core->reg[REG_FAULTS] |= core->reg[REG_PRESENT];
}

/* CRC-8 of SMBus: polynomial 07h, start 0. */
uint8_t crc8(uint8_t crc, uint8_t byte) {
    crc ^= byte;
    for (uint8_t i = 0; i < 8; i++) {
        crc = (uint8_t)(crc & 0x80 ? crc << 1 ^ 0x07 : crc << 1);
    }
    return crc;
}

void smbus_start(core_t *core, uint8_t address_and_direction) {
    bool is_read = address_and_direction & 1;
    if (!is_read) {
        core->crc = 0;
        core->received = 0;
    }
    core->crc = crc8(core->crc, address_and_direction);
    core->sent = 0;
}

bool smbus_write(core_t *core, uint8_t byte) {
    switch (core->received) {
    case 0:
        core->command = byte;
        core->value = is_readable(byte) ? core->reg[byte] : 0xFFFF;
        break;
    case 1:
        core->value = byte;
        break;
    case 2:
        core->value |= (uint16_t)byte << 8;
        break;
    case 3:
        if (core->crc != byte) {
            core->reg[REG_PEC_ERRORS]++;
            core->received = WRITE_BYTES; /* beyond a complete write: never executed */
        }
        break;
    default:
        break;
    }
    core->crc = crc8(core->crc, byte);
    if (core->received <= WRITE_BYTES) {
        core->received++;
    }
    /* The PEC of a write that cannot be executed is not acknowledged. */
    return core->received < 3 || (core->received == 3 && is_allowed(core, core->command, core->value));
}

uint8_t smbus_read(core_t *core) {
    bool exists = is_readable(core->command) && core->received == 1;
    uint8_t byte = 0xFF;
    switch (core->sent) {
    case 0:
        byte = (uint8_t)core->value;
        break;
    case 1:
        byte = (uint8_t)(core->value >> 8);
        break;
    case 2:
        /* a register that does not exist has a wrong PEC */
        byte = exists ? core->crc : (uint8_t)~core->crc;
        if (exists) {
            core->silent_ms = 0;
        }
        break;
    default:
        break;
    }
    if (core->sent < 2) {
        core->crc = crc8(core->crc, byte);
    }
    if (core->sent < 3) {
        core->sent++;
    }
    return byte;
}

/* Handles a stop or a repeated start: executes a complete, valid write; keeps the state that a read needs. */
void smbus_stop(core_t *core) {
    bool whole = core->received == WRITE_BYTES && core->sent == 0;
    if (!whole || !is_allowed(core, core->command, core->value)) {
        return;
    }
    core->received = 0;
    core->silent_ms = 0;
    if (core->command == REG_FAULT_CLEAR) {
        clear_faults(core, core->value);
    } else {
        core->reg[core->command] = core->value;
    }
}
