#!/bin/sh
# Install the apt packages that some tests use. Each is optional: without it its tests skip with its name.
set -eu
packages="tshark user-mode-linux kmod iproute2 can-utils qemu-system-x86 mmdebstrap e2fsprogs dmsetup systemd
  gcc g++ gcc-avr avr-libc avrdude libelf-dev openssh-client qemu-user-static qemu-user
  chromium chromium-driver valgrind openscad xvfb"
if [ "$(id -u)" -eq 0 ]; then sudo=""; else sudo="sudo"; fi
missing=""
for package in $packages; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing="$missing $package"
done
if [ -z "$missing" ]; then
    echo "system-deps: all there: $packages"
    exit 0
fi
echo "system-deps: installing$missing"
$sudo apt-get update -qq
# shellcheck disable=SC2086
$sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >/dev/null
