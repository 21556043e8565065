#!/bin/sh
# Blink the LED $1 of the kernel's LED class for $2 seconds, five times a second, then leave it as it was.
set -eu
led=$1
seconds=$2
if ! [ -w "$led/trigger" ]; then
    echo "error: this board has no LED $led: give another one of $(cd /sys/class/leds && echo *) with -e identify_led=/sys/class/leds/NAME" >&2
    exit 1
fi
before=$(sed 's/.*\[\(.*\)\].*/\1/' "$led/trigger")
level=$(cat "$led/brightness")
most=$(cat "$led/max_brightness")
leave() {
    echo "$before" >"$led/trigger"
    if [ "$before" = none ]; then echo "$level" >"$led/brightness"; fi
}
trap leave EXIT
echo none >"$led/trigger"
for _ in $(seq "$((5 * seconds))"); do
    echo "$most" >"$led/brightness"
    sleep 0.1
    echo 0 >"$led/brightness"
    sleep 0.1
done
