#!/bin/sh
# First process of user-mode Linux whose root is that of the machine outside: start the board on its card, /dev/ubda,
# through dm-log-writes, which records every write and every flush on /dev/ubdb (write_log.py).
set -eu
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t proc proc /proc
mount -t sysfs sys /sys
modules=/usr/lib/uml/modules/$(uname -r)/kernel/drivers/md
insmod "$modules/dm-mod.ko"
insmod "$modules/dm-log-writes.ko"
echo "0 $(blockdev --getsz /dev/ubda) log-writes /dev/ubda /dev/ubdb" | dmsetup create --noudevsync card
mount -t ext4 /dev/dm-0 /mnt
exec env -i "PATH=$PATH" TERM=linux switch_root /mnt /sbin/init
