#!/bin/sh
# Become the first process of a board: systemd on the files of $1 (folders, the newest first, as overlayfs takes them),
# its changes in the folder $2. Run by `unshare` in namespaces of its own; nothing that it mounts or makes is seen
# outside.
set -eu
layers=$1
folder=$2
root=$folder/root
mount --make-rprivate /
mount -t overlay -o "lowerdir=$layers,upperdir=$folder/written,workdir=$folder/work" board "$root"
mount -t proc proc "$root/proc"
mount --bind "$root/proc/sys" "$root/proc/sys"
mount -o remount,ro,bind "$root/proc/sys" # the kernel's parameters are not this board's
mount -t sysfs -o ro sysfs "$root/sys"
mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
mount -t tmpfs -o mode=755 dev "$root/dev"
mount -t tmpfs -o mode=755 run "$root/run"
mkdir "$root/run/outside"
mount --bind "$folder/outside" "$root/run/outside"
for device in null zero full random urandom tty; do
    touch "$root/dev/$device"
    mount --bind "/dev/$device" "$root/dev/$device"
done
mkdir "$root/dev/pts" "$root/dev/shm"
mount -t devpts -o newinstance,ptmxmode=0666,mode=620 devpts "$root/dev/pts"
ln -s pts/ptmx "$root/dev/ptmx"
ln -s /proc/self/fd "$root/dev/fd"
ip link set lo up
cd "$root"
pivot_root . mnt
umount -l /mnt
exec env -i container=palpate PATH=/usr/sbin:/usr/bin:/sbin:/bin \
    /lib/systemd/systemd --system --log-target=journal --show-status=no
