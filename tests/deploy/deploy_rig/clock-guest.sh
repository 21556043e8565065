#!/bin/sh
# The first process of a board in user-mode Linux that has a clock and a network. The kernel's command line gives SHARED,
# the only writable folder: start.sh there sets `layers` (of the card) and has the function `begin` (addresses, and a wrong
# time), palpate.conf is for chrony, which starts when the file `go` exists.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t tmpfs run /run
mkdir -p /run/shared /run/card /run/written /run/work
mount -t hostfs -o "$SHARED" shared /run/shared
insmod "/usr/lib/uml/modules/$(uname -r)/kernel/fs/overlayfs/overlay.ko"
. /run/shared/start.sh
mount -t overlay -o "lowerdir=$layers,upperdir=/run/written,workdir=/run/work" card /run/card
mount --bind /dev /run/card/dev
mount -t proc proc /run/card/proc
mount -t tmpfs run /run/card/run
mkdir /run/card/run/shared
mount --bind /run/shared /run/card/run/shared
ip link set lo up
begin
cp /run/shared/palpate.conf /run/card/etc/chrony/conf.d/
chroot /run/card install -d -o _chrony -g _chrony -m 700 /run/chrony
(
    while ! test -e /run/shared/go; do sleep 0.2; done
    chroot /run/card chronyd
) &
chroot /run/card /usr/bin/python3 /run/shared/clock_exchange.py
echo o >/proc/sysrq-trigger # power off
sleep 60
