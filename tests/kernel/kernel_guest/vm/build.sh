#!/bin/sh
# Build the virtual machine's disk in the folder $1: root.ext4, vmlinuz, initrd.img. Needs root or user namespaces.
# The packages come from where this system gets its own, if it is a bookworm too.
set -eu
out=$1
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$out"

sources=""
if grep -q '^VERSION_CODENAME=bookworm' /etc/os-release; then
    for file in /etc/apt/sources.list /etc/apt/sources.list.d/debian.sources; do
        if grep -qs bookworm "$file"; then sources="$sources $file"; fi
    done
fi

# The initial RAM disk holds what finds the root, not what any machine could need: a quarter of the size.
initrd='mkdir -p "$1/etc/initramfs-tools/conf.d"
printf "MODULES=list\nCOMPRESS=lz4\n" >"$1/etc/initramfs-tools/conf.d/small"
printf "virtio_pci\nvirtio_blk\next4\n" >"$1/etc/initramfs-tools/modules"'

# Bound a second time the root is without the /proc and /sys that are mounted in it now.
disk="mkdir '$out/root'; mount --bind \"\$1\" '$out/root'
mke2fs -q -t ext4 -d '$out/root' '$out/root.ext4' 3G; umount '$out/root'; rmdir '$out/root'"

# shellcheck disable=SC2016,SC2086
mmdebstrap --quiet --variant=minbase --format=null \
    --include=linux-image-amd64,initramfs-tools,lz4,zstd,systemd,systemd-sysv,udev,kmod \
    --include=iproute2,procps,can-utils,v4l-utils,python3 \
    --aptopt='APT::Install-Recommends "false"' \
    --dpkgopt='path-exclude=/usr/share/doc/*' \
    --dpkgopt='path-exclude=/usr/share/man/*' \
    --dpkgopt='path-exclude=/usr/share/locale/*' \
    --essential-hook="$initrd" \
    --customize-hook="copy-in '$here/guest-tests' /usr/local/sbin" \
    --customize-hook="copy-in '$here/guest-tests.service' /etc/systemd/system" \
    --customize-hook='chroot "$1" systemctl enable --quiet guest-tests.service' \
    --customize-hook='chroot "$1" systemctl mask --quiet getty@tty1.service serial-getty@ttyS0.service' \
    --customize-hook='chroot "$1" systemctl mask --quiet apt-daily.timer apt-daily-upgrade.timer dpkg-db-backup.timer' \
    --customize-hook='rm -f "$1"/var/cache/apt/*.bin "$1"/var/lib/apt/lists/*_*; echo palpate >"$1/etc/hostname"' \
    --customize-hook="cp \"\$1\"/boot/vmlinuz-* '$out/vmlinuz'; cp \"\$1\"/boot/initrd.img-* '$out/initrd.img'" \
    --customize-hook="$disk" \
    bookworm /dev/null $sources
