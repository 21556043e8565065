#!/bin/sh
# Tell this board from others for ten seconds: by the LED ring of the fingertip that the file $3 describes; where
# that cannot blink, by the LED $1 of the kernel's LED class, five times a second for $2 seconds, left as it was.
set -eu
led=$1
seconds=$2
config=${3:-/etc/palpate/fingertip.toml}
if [ -e "$config" ]; then
    if said=$(palpate-edge identify --config "$config" 2>&1); then
        echo "$said"
        exit
    fi
    echo "$said" >&2
fi
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
echo "the board's own LED $led blinks"
echo none >"$led/trigger"
for _ in $(seq "$((5 * seconds))"); do
    echo "$most" >"$led/brightness"
    sleep 0.1
    echo 0 >"$led/brightness"
    sleep 0.1
done
