#!/bin/sh
# First process of user-mode Linux whose root is that of the machine outside. For each line on the console: mount the
# card, /dev/ubda, as it is then, let witness.py do what palpate-settle.service does and read the card, and unmount it.
# The kernel keeps nothing of a card that is not mounted.
set -u
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
witness=$(dirname "$0")/witness.py
stty -echo
echo "witness waits"
while read -r _; do
    if mount -t ext4 /dev/ubda /mnt && mount --rbind /dev /mnt/dev; then
        chroot /mnt /usr/bin/python3 - alone <"$witness" || echo "witness: no answer"
        umount /mnt/dev && umount /mnt || exit
    else
        echo "witness: cannot mount the card"
    fi
done
