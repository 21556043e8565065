#!/bin/sh
# Build a bare board of Debian's suite $2 in the folder $1: tree/ (its files), root.ext4, vmlinuz, initrd.img, and key, with
# which root may log in. Needs root.
# What provisioning installs is only in apt's cache, as on a card made for a place without network.
# As Raspberry Pi OS has them: avahi, which answers for NAME.local, and cloud-init's settings of ssh.
# The packages come from where this system gets its own, if it is of the same suite.
set -eu
out=$1
suite=$2
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$out/tree"
ssh-keygen -q -t ed25519 -N '' -C 'palpate tests' -f "$out/key"
cp "$out/key.pub" "$out/authorized_keys"

sources=""
if grep -q "^VERSION_CODENAME=$suite" /etc/os-release; then
    for file in /etc/apt/sources.list /etc/apt/sources.list.d/debian.sources; do
        if grep -qs "$suite" "$file"; then sources="$sources $file"; fi
    done
fi

# The initial RAM disk holds what finds the root, not what any machine could need: a quarter of the size.
initrd='mkdir -p "$1/etc/initramfs-tools/conf.d"
printf "MODULES=list\nCOMPRESS=lz4\n" >"$1/etc/initramfs-tools/conf.d/small"
printf "virtio_pci\nvirtio_blk\next4\n" >"$1/etc/initramfs-tools/modules"'

fetch='APT_CONFIG=$MMDEBSTRAP_APT_CONFIG apt-get install --quiet --quiet --download-only --yes \
  --no-install-recommends python3-venv chrony can-utils unattended-upgrades avrdude >/dev/null'

# shellcheck disable=SC2016,SC2086
mmdebstrap --quiet --variant=minbase --format=directory --mode=root --skip=cleanup/apt \
    --include=linux-image-amd64,initramfs-tools,lz4,zstd,systemd,systemd-sysv,udev,kmod,dbus \
    --include=openssh-server,python3,python3-apt,iproute2,procps,v4l-utils,avahi-daemon \
    --aptopt='APT::Install-Recommends "false"' \
    --dpkgopt='path-exclude=/usr/share/doc/*' \
    --dpkgopt='path-exclude=/usr/share/man/*' \
    --dpkgopt='path-exclude=/usr/share/locale/*' \
    --essential-hook="$initrd" \
    --customize-hook="$fetch" \
    --customize-hook='echo board >"$1/etc/hostname"; : >"$1/etc/machine-id"' \
    --customize-hook='mkdir -p -m 700 "$1/root/.ssh"' \
    --customize-hook="copy-in '$out/authorized_keys' /root/.ssh" \
    --customize-hook="sync-in '$here/board' /" \
    --customize-hook='chroot "$1" systemctl enable --quiet systemd-networkd.service' \
    --customize-hook='chroot "$1" systemctl disable --quiet systemd-networkd-wait-online.service' \
    "$suite" "$out/tree" $sources
cp "$out"/tree/boot/vmlinuz-* "$out/vmlinuz"
cp "$out"/tree/boot/initrd.img-* "$out/initrd.img"
/sbin/mke2fs -q -t ext4 -L board -d "$out/tree" "$out/root.ext4" 4G
