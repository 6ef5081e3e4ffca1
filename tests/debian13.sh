#!/usr/bin/env bash
# `make demo` and `make test` on Debian 13, whose Python is 3.13: in a root of it beside this machine's own system.
#
# usage: debian13.sh [TESTS...]      needs root and apt; exit status 1 where something failed, 2 where it cannot be run here
# The root, with its .venv, is made once and kept in ~/.cache/facetd/debian13.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${XDG_CACHE_HOME:-$HOME/.cache}/facetd/debian13
root=$folder/root
packages=make,git,ca-certificates,python3,python3-venv # what the README asks for
refuse() { echo "debian13: cannot be run here: $1" >&2; exit 2; }

[[ $(id -u) == 0 ]] || refuse "it needs root"
command -v apt-get >/dev/null || refuse "this is no Debian (apt-get is missing)"
unshare --mount mount -t tmpfs tmpfs /mnt || refuse "nothing may be mounted"
if [[ ! -f $folder/recipe || $(cat "$folder/recipe") != "$packages" ]]; then
    echo "== making a root of Debian 13 (once; minutes)"
    if ! dpkg -s mmdebstrap >/dev/null 2>&1; then
        apt-get -qq -o DPkg::Lock::Timeout=300 update
        DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=300 install -y --no-install-recommends mmdebstrap >/dev/null
    fi
    rm -rf "$folder"
    mkdir -p "$folder"
    mmdebstrap --quiet --variant=minbase --include="$packages" trixie "$root" || refuse "mmdebstrap failed"
    mkdir "$root/facetd"
    echo "$packages" >"$folder/recipe"
fi
cp -L /etc/resolv.conf /etc/hosts "$root/etc/"
cp -L /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/" # where a company has its own authority, pip needs it
find "$root/facetd" -mindepth 1 -maxdepth 1 ! -name .venv -exec rm -rf {} +
git ls-files -z | tar -c --null --files-from=- | tar -x -C "$root/facetd" --no-same-owner

# The mounts end with the shell that made them.
unshare --mount --fork bash -euo pipefail -c '
    root=$1; shift
    mount -t proc proc "$root/proc"
    mount --rbind /dev "$root/dev"
    chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 PIP_CERT=/etc/ssl/certs/ca-certificates.crt \
        sh -ec "cd /facetd && .venv/bin/python --version 2>/dev/null || true; make demo DEMO=\"--seed 106\" && make test-short TESTS=\"\$*\"" sh "$@"
' bash "$root" "$@" || exit 1 # make's own status is 2
