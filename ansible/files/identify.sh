#!/bin/sh
# Blink an LED of this board. The LED ring of the fingertip with the configuration $3 blinks for ten seconds. If it
# cannot, the LED $1 of the kernel's LED class blinks five times a second for $2 seconds; its state is restored.
set -eu
led=$1
seconds=$2
config=${3:-/etc/palpate/fingertip.toml}
if [ -e "$config" ]; then
    if output=$(palpate-edge identify --config "$config" 2>&1); then
        echo "$output"
        exit
    fi
    echo "$output" >&2
fi
if ! [ -w "$led/trigger" ]; then
    echo "error: this board has no LED $led: give another one of $(cd /sys/class/leds && echo *) with -e identify_led=/sys/class/leds/NAME" >&2
    exit 1
fi
before=$(sed 's/.*\[\(.*\)\].*/\1/' "$led/trigger")
level=$(cat "$led/brightness")
most=$(cat "$led/max_brightness")
restore() {
    echo "$before" >"$led/trigger"
    if [ "$before" = none ]; then echo "$level" >"$led/brightness"; fi
}
trap restore EXIT
echo "the board's own LED $led blinks"
echo none >"$led/trigger"
for _ in $(seq "$((5 * seconds))"); do
    echo "$most" >"$led/brightness"
    sleep 0.1
    echo 0 >"$led/brightness"
    sleep 0.1
done
