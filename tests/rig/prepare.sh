#!/usr/bin/env bash
# Lay in what the guest needs, once, under one folder: a stock Debian kernel, v4l2loopback built for it, udev and v4l2-ctl
# beside (not in) this machine's file system, and an initramfs that mounts it all. Nothing about jobs belongs here.
#
# usage: prepare.sh FOLDER        needs root and apt; done in about half a minute; does nothing where FOLDER is up to date
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
folder=$1
stamp=$folder/prepared
recipe=$(cat "$here/prepare.sh" "$here/guest/init" | sha256sum | cut -c1-16)
[[ -f $stamp && $(cat "$stamp") == "$recipe" ]] && command -v qemu-system-x86_64 >/dev/null && exit 0

refuse() { echo "rig: cannot be prepared: $1" >&2; exit 3; }
[[ $(id -u) == 0 ]] || refuse "installing qemu and kernel headers needs root"
command -v apt-get >/dev/null || refuse "this is no Debian (apt-get is missing)"

export DEBIAN_FRONTEND=noninteractive
log=$folder/prepare.log
mkdir -p "$folder" && : >"$log"
trap 'echo "rig: preparing failed; the end of $log:" >&2; tail -n 15 "$log" >&2; exit 3' ERR

apt() { apt-get -qq -o DPkg::Lock::Timeout=300 "$@" >>"$log" 2>&1; }
apt update
apt install -y --no-install-recommends qemu-system-x86 busybox-static cpio kmod systemd
image=$(apt-cache depends linux-image-amd64 | awk '/Depends:/ {print $2; exit}')
release=${image#linux-image-}
apt install -y --no-install-recommends "linux-headers-$release"

# udev must be of systemd's own version; the rest may be whatever is current. Unpacked, never installed.
work=$folder/new
rm -rf "$work" && mkdir -p "$work"/{debs,kernel,layer,loopback,initramfs/{bin,modules,proc,sys,dev,host,layer,job,rw,root}}
(cd "$work/debs" && apt download "$image" v4l2loopback-dkms "udev=$(dpkg-query -W -f '${Version}' systemd)" \
  v4l-utils libv4l-0 libv4lconvert0 libv4l2rds0 libjpeg62-turbo)
unpack() { local to=$1; shift; for deb in "$@"; do dpkg -x "$deb" "$to"; done; }
unpack "$work/kernel" "$work"/debs/linux-image-*.deb
unpack "$work/loopback" "$work"/debs/v4l2loopback-dkms_*.deb
unpack "$work/layer" "$work"/debs/{udev,v4l-utils,libv4l,libjpeg}*.deb
rm -rf "$work/layer/usr/share/doc" "$work/debs"
for merged in bin sbin lib; do # a folder /lib in a layer would hide the host's link /lib -> usr/lib
  [[ ! -d $work/layer/$merged ]] || { mkdir -p "$work/layer/usr/$merged"; cp -a "$work/layer/$merged/." "$work/layer/usr/$merged/"; rm -rf "${work:?}/layer/$merged"; }
done

modules=$work/kernel/lib/modules/$release
source=$(echo "$work"/loopback/usr/src/v4l2loopback-*)
make -s -C "/lib/modules/$release/build" M="$source" modules >>"$log" 2>&1
install -D "$source/v4l2loopback.ko" "$modules/extra/v4l2loopback.ko"
depmod -b "$work/kernel" "$release"

# In the order in which they must be loaded to reach the shared folders.
for module in virtio_ring virtio virtio_pci_modern_dev virtio_pci_legacy_dev virtio_pci netfs fscache 9pnet 9pnet_virtio \
  9p overlay; do
  file=$(find "$modules" -name "$module.ko")
  [[ -n $file ]] && cp "$file" "$work/initramfs/modules/" && echo "$module" >>"$work/initramfs/modules/order"
done
cp "$(command -v busybox)" "$work/initramfs/bin/busybox"
install -m 755 "$here/guest/init" "$work/initramfs/init"
(cd "$work/initramfs" && find . | cpio -o -H newc --quiet | gzip -1) >"$work/initramfs.gz"
cp "$work"/kernel/boot/vmlinuz-* "$work/vmlinuz"

rm -rf "$folder"/{kernel,layer,loopback,initramfs,initramfs.gz,vmlinuz}
mv "$work"/{kernel,layer,initramfs.gz,vmlinuz} "$folder/"
rm -rf "$work"
echo "$recipe" >"$stamp"
