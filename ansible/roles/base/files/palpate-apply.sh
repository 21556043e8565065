#!/bin/sh
# palpate-apply [--boot-loads] NAME FILE... -- COMMAND...: run COMMAND unless it has run with these files since the
# board's start. Prints "applied" if the files differ from those of its last run, else "unchanged". A run that is
# interrupted between a file and its command leaves no stamp, so the next one runs the command.
# --boot-loads: not once more after a start, which has loaded the files; for a command that disturbs a running hand.
set -eu
boot_loads=false
if [ "$1" = --boot-loads ]; then
    boot_loads=true
    shift
fi
name=$1
shift
digest=$(while [ "$1" != -- ]; do
    printf '%s ' "$1"
    sha256sum <"$1" 2>/dev/null || echo absent
    shift
done | sha256sum)
while [ "$1" != -- ]; do shift; done
shift
since_start=/run/palpate-apply ever=/var/lib/palpate-apply
mkdir -p "$since_start" "$ever"
if [ "$(cat "$since_start/$name" 2>/dev/null)" = "$digest" ]; then
    echo unchanged
    exit 0
fi
result=applied
if [ "$(cat "$ever/$name" 2>/dev/null)" = "$digest" ]; then result=unchanged; fi
if [ $result = applied ] || [ $boot_loads = false ]; then "$@"; fi
echo "$digest" >"$ever/.$name.new"
mv "$ever/.$name.new" "$ever/$name"
echo "$digest" >"$since_start/$name"
echo "$result"
