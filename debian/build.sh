#!/usr/bin/env bash
# Build facetd's Debian packages from this checkout into build/: for Debian's Python of this machine, for each architecture.
#
# usage: build.sh [ARCH...]     amd64, arm64 (default: both)
#   EXTRAS=no                   only the package facetd
#   VERSION=1.2.3               instead of daemon/__init__.py's
#   COMPRESS=gzip               faster, for a test (default: xz)
#   LINTIAN=yes                 and look for errors with lintian
# Missing build tools are installed with apt where this runs as root. Wheels come from pip's index.
set -euo pipefail
cd "$(dirname "$0")/.."
tools=(debhelper dpkg-dev python3-pip python3-venv)
[[ ${LINTIAN:-no} == no ]] || tools+=(lintian)
if ! dpkg -s "${tools[@]}" >/dev/null 2>&1; then
    [[ $(id -u) == 0 ]] || { echo "deb: install the build tools first: sudo apt install ${tools[*]}" >&2; exit 2; }
    echo "== installing the build tools"
    apt-get -qq update
    DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends "${tools[@]}" >/dev/null
fi
version=${VERSION:-$(sed -n 's/^VERSION = "\(.*\)"/\1/p' daemon/__init__.py)}
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct 2>/dev/null || stat -c %Y pyproject.toml)
export SOURCE_DATE_EPOCH
profiles=(); [[ ${EXTRAS:-yes} == yes ]] || profiles=(--build-profiles=pkg.facetd.noextras)
[[ $# -gt 0 ]] || set -- amd64 arm64
for arch in "$@"; do
    stage=build/deb/$arch/facetd-$version
    rm -rf "build/deb/$arch"
    mkdir -p "$stage"
    cp -a daemon drivers etc docs deploy debian pyproject.toml README.md LICENSE "$stage/"
    find "$stage" -name __pycache__ -prune -exec rm -rf {} +
    sed -i "s/^VERSION = .*/VERSION = \"$version\"/" "$stage/daemon/__init__.py"
    cat >"$stage/debian/changelog" <<END
facetd ($version) unstable; urgency=medium

  * Release $version.

 -- The facetd developers <facetd@localhost.localdomain>  $(date -uRd "@$SOURCE_DATE_EPOCH")
END
    echo "== building facetd $version for $arch"
    log=build/deb/$arch.log
    (cd "$stage" && dpkg-buildpackage -b -uc -us -d -a "$arch" "${profiles[@]}") >"$log" 2>&1 ||
        { tail -n 20 "$log" >&2; echo "deb: the build failed; its log is $log" >&2; exit 1; }
    [[ ${LINTIAN:-no} == no ]] || lintian --fail-on error --suppress-tags unusual-interpreter build/deb/"$arch"/*.deb
    for deb in build/deb/"$arch"/*.deb; do
        mv "$deb" build/
        echo "   build/$(basename "$deb")  $(du -h "build/$(basename "$deb")" | cut -f1)"
    done
    rm -rf "build/deb/$arch"
done
