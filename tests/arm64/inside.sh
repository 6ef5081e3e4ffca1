#!/usr/bin/env bash
# Install the package in the root for arm64, and look at the pairs, or run the demo there. Mounts and files end with it.
#
# usage: unshare --mount inside.sh ROOT WORK [DEMO...]       WORK has facetd.deb, recognise.py, calibration.yaml, model.npz and looks/
set -euo pipefail
root=$1 work=$2
shift 2
memory=$(mktemp -d)
mount -t tmpfs tmpfs "$memory"
mkdir "$memory"/{upper,below,root}
mount -t overlay -o "lowerdir=$root,upperdir=$memory/upper,workdir=$memory/below" overlay "$memory/root"
mount -t proc proc "$memory/root/proc"
mount --rbind /dev "$memory/root/dev"
mount --bind "$work" "$memory/root/mnt"
inside() { chroot "$memory/root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root OMP_NUM_THREADS=1 "$@"; }
began() { echo "arm64: $1 after $SECONDS s"; }
inside dpkg -i /mnt/facetd.deb >"$work/dpkg.log" 2>&1 || { cat "$work/dpkg.log"; exit 1; }
began "the package installed"
if [[ $# == 0 ]]; then
    (cd "$work" && inside /usr/lib/facetd/bin/python3 /mnt/recognise.py --calibration /mnt/calibration.yaml --model /mnt/model.npz \
        $(printf '/mnt/%s ' looks/*)) >"$work/arm64.jsonl"
    began "all pairs looked at"
else
    inside facetctl demo "$@"
    began "the demo done"
fi
