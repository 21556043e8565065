#!/bin/sh
# The first process of user-mode Linux. The root is that of the machine outside, read only. The kernel's
# command line gives SHARED, the only writable folder.
PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t tmpfs run /run
mkdir -p /run/shared /run/tmp /dev/shm /dev/pts
mount -t tmpfs shm /dev/shm
mount -t devpts -o ptmxmode=666 pts /dev/pts
mount -t hostfs -o "$SHARED" shared /run/shared
ip link set lo up

modules=/usr/lib/uml/modules/$(uname -r)/kernel
for module in net/can/can net/can/can-raw net/can/can-bcm drivers/net/can/dev/can-dev drivers/net/can/vcan \
    drivers/net/can/slcan/slcan; do
    insmod "$modules/$module.ko"
done

sh /run/shared/run.sh
echo o >/proc/sysrq-trigger # power off
sleep 60
