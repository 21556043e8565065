#!/bin/sh
# Unpack the Python of Debian's suite $2 for aarch64 into the folder $1. Nothing of it is run while it is made.
set -eu
out=$1
suite=$2
sources=""
if grep -q "^VERSION_CODENAME=$suite" /etc/os-release; then
    for file in /etc/apt/sources.list /etc/apt/sources.list.d/debian.sources; do
        if grep -qs "$suite" "$file"; then sources="$sources $file"; fi
    done
fi
# shellcheck disable=SC2086
mmdebstrap --quiet --variant=extract --architectures=arm64 --format=directory --skip=check/qemu \
    --include=python3,libpython3-stdlib,libstdc++6 \
    --aptopt='APT::Install-Recommends "false"' \
    --dpkgopt='path-exclude=/usr/share/doc/*' \
    "$suite" "$out/tree" $sources

# The loader is at /lib/ld-linux-aarch64.so.1 in every program; since Debian 13 /lib is a link that no package brings.
test -e "$out/tree/lib" || ln -s usr/lib "$out/tree/lib"

# Where a library asks which processor this is, the emulator gives it this file, not that of the machine around.
mkdir -p "$out/tree/proc"
for core in 0 1 2 3; do
    printf 'processor\t: %s\nBogoMIPS\t: 38.40\nFeatures\t: fp asimd evtstrm crc32 cpuid\n' "$core"
    printf 'CPU implementer\t: 0x41\nCPU architecture: 8\nCPU variant\t: 0x0\nCPU part\t: 0xd03\nCPU revision\t: 4\n\n'
done >"$out/tree/proc/cpuinfo"
