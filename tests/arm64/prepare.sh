#!/usr/bin/env bash
# Make a root of Debian 12 for arm64 with what facetd's package depends on, once, and let this machine's kernel run its programs.
#
# usage: prepare.sh FOLDER        needs root and apt; makes FOLDER/root; does nothing where that is up to date
set -euo pipefail
folder=$1
depends=python3,python3-systemd,systemd-standalone-sysusers # debian/control

refuse() { echo "arm64: cannot be prepared: $1" >&2; exit 3; }
[[ $(id -u) == 0 ]] || refuse "installing qemu-user-static and mmdebstrap needs root"
command -v apt-get >/dev/null || refuse "this is no Debian (apt-get is missing)"
if ! dpkg -s qemu-user-static mmdebstrap arch-test >/dev/null 2>&1; then
    apt-get -qq -o DPkg::Lock::Timeout=300 update
    DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=300 install -y --no-install-recommends \
        qemu-user-static mmdebstrap arch-test >/dev/null
fi

# systemd or Debian's binfmt-support would register the emulator; a machine with neither has it done here. F: the kernel
# opens the emulator now, so that it is found from inside any root.
formats=/proc/sys/fs/binfmt_misc
[[ -e $formats/register ]] || mount -t binfmt_misc binfmt_misc $formats || refuse "the kernel has no binfmt_misc"
if [[ ! -e $formats/qemu-aarch64 ]]; then
    magic='\x7fELF\x02\x01\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x02\x00\xb7\x00'
    mask='\xff\xff\xff\xff\xff\xff\xff\x00\xff\xff\xff\xff\xff\xff\xff\xff\xfe\xff\xff\xff'
    printf '%s' ":qemu-aarch64:M::$magic:$mask:/usr/bin/qemu-aarch64-static:F" >$formats/register ||
        refuse "the kernel takes no emulator for arm64"
fi

runs() { unshare --mount sh -c 'mount -t tmpfs tmpfs /mnt && mount -t proc proc "$1/proc" && chroot "$1" /bin/true' sh "$folder/root"; }
[[ -f $folder/recipe && $(cat "$folder/recipe") == "$depends" ]] && runs && exit 0
echo "== making a root of Debian 12 for arm64 (once; minutes)"
rm -rf "$folder"
mkdir -p "$folder"
mmdebstrap --quiet --arch=arm64 --variant=minbase --include="$depends" bookworm "$folder/root" || refuse "mmdebstrap failed"
echo "$depends" >"$folder/recipe"
runs || refuse "its programs do not run, or nothing may be mounted"
