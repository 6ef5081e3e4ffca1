#!/bin/sh
# Install, upgrade, roll back or remove facetd on a Debian 12 machine (x86-64 or arm64). Run as root.
#
#   install.sh install      also upgrades: the new release is built beside the old one and checked against your
#                           configuration before it takes over; configuration, models and runs are kept
#   install.sh extra NAME   add one of the program's extras to the release in use: dashboard, export, fleet, metrics, systemd
#   install.sh rollback     back to the release before
#   install.sh remove       everything but /etc/facetd, /var/lib/facetd and udev rules that you have edited
#   install.sh purge        these, too
#
# DESTDIR=DIR puts files below DIR and touches neither users nor services: for images. What is made so runs once DIR's
# content lies at /, and nowhere else.
# FACETD_APT=no does not install Debian packages; FACETD_PIP is added to pip's arguments (an index, a wheel folder).
set -eu

house=$(cd "$(dirname "$0")/.." && pwd)
root=${DESTDIR:-}
opt=$root/opt/facetd
keep=2
completion=/usr/share/bash-completion/completions/facetctl

say() { echo "facetd: $*"; }
fail() { echo "install.sh: $*" >&2; exit 2; }
alive() { [ -z "$root" ] && [ -d /run/systemd/system ]; }

need_root() {
    [ -n "$root" ] || [ "$(id -u)" = 0 ] || fail "run this as root (sudo $0 $command)"
}

packages() {
    [ -z "$root" ] && [ "${FACETD_APT:-yes}" = yes ] || return 0
    dpkg -s python3-venv >/dev/null 2>&1 && return 0
    say "installing the Debian package python3-venv"
    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends python3-venv >/dev/null
}

build() {
    release=$opt/releases/$(date -u +%Y%m%dT%H%M%SZ)
    say "building $release"
    mkdir -p "$release"
    trap 'rm -rf "$release"' EXIT
    for item in daemon drivers etc deploy docs pyproject.toml README.md LICENSE; do
        [ -e "$house/$item" ] && cp -a "$house/$item" "$release/"
    done
    find "$release" -name __pycache__ -prune -exec rm -rf {} +
    "${PYTHON:-python3}" -m venv "$release/venv"
    # In place, so that the files in etc/ are found beside the program.
    # shellcheck disable=SC2086
    "$release/venv/bin/pip" install -q ${FACETD_PIP:-} -e "$release[metrics,dashboard]"
    if [ "${FACETD_APT:-yes}" = yes ]; then
        "$release/deploy/systemd-extra.sh" "$release/venv/bin/pip"
    fi
    "$release/venv/bin/python" -m compileall -q -s "$root" "$release/daemon" "$release/drivers"
}

at_home() {
    # A virtual environment names itself in its programs: what was made below DESTDIR must name where it will lie.
    [ -n "$root" ] || return 0
    find "$release/venv" -type f \( -path '*/bin/*' -o -name '*.pth' -o -name 'pyvenv.cfg' -o -name 'direct_url.json' \
        -o -name '__editable__*.py' \) -exec grep -lIF "$root/opt/facetd/" {} + | while read -r file; do
        sed -i "s|$root/opt/facetd/|/opt/facetd/|g" "$file"
    done
    find "$release" -name __pycache__ -path '*site-packages/__pycache__' -prune -exec rm -rf {} +
}

# Whole under its name or not there, whenever the power goes.
put() {
    mkdir -p "$(dirname "$2")"
    install -m 0644 "$1" "$2.part"
    sync "$2.part"
    mv -T "$2.part" "$2"
}

# Whether a release can run, with the settings there are: one that was being built when the power went cannot.
runs() {
    STATE_DIRECTORY=$root/var/lib/facetd RUNTIME_DIRECTORY=$root/run/facetd \
        "$1/venv/bin/facetd" --config "$root/etc/facetd/facetd.yaml" --check
}

settings() {
    mkdir -p "$root/etc/facetd"
    for file in facetd.yaml calibration.yaml facets.yaml parts.yaml simcell.yaml; do
        if [ ! -e "$root/etc/facetd/$file" ]; then
            put "$house/etc/$file" "$root/etc/facetd/$file"
        elif ! cmp -s "$house/etc/$file" "$root/etc/facetd/$file" && ! cmp -s "$house/etc/$file" "$opt/current/etc/$file"
        then
            put "$house/etc/$file" "$root/etc/facetd/$file.new"
            say "kept your /etc/facetd/$file; what is new lies beside it as $file.new"
        fi
    done
}

system_files() {
    put "$house/deploy/facetd.service" "$root/etc/systemd/system/facetd.service"
    put "$house/deploy/facetd-dashboard.service" "$root/etc/systemd/system/facetd-dashboard.service"
    dashboard_of_before
    put "$house/deploy/facetd.sysusers" "$root/usr/lib/sysusers.d/facetd.conf"
    put "$house/deploy/facetd.tmpfiles" "$root/usr/lib/tmpfiles.d/facetd.conf"
    put "$house/deploy/facetd.catalog" "$root/usr/lib/systemd/catalog/facetd.catalog"
    if [ ! -e "$root/etc/udev/rules.d/60-facetd.rules" ]; then
        put "$house/deploy/60-facetd.rules" "$root/etc/udev/rules.d/60-facetd.rules"
    fi
    mkdir -p "$root/usr/local/bin"
    ln -sfn /opt/facetd/current/venv/bin/facetctl "$root/usr/local/bin/facetctl"
    ln -sfn /opt/facetd/current/venv/bin/facetd "$root/usr/local/bin/facetd"
    PYTHONPATH=$release "$release/venv/bin/python" -m daemon.ctl completion bash >"$release/completion"
    put "$release/completion" "$root$completion"
    [ -n "$root" ] && return 0
    systemd-sysusers facetd.conf
    systemd-tmpfiles --create facetd.conf
    journalctl --update-catalog
    if alive; then
        udevadm control --reload
        systemctl daemon-reload
    fi
}

# The dashboard's unit was facetd-live: whoever had it enabled has the new one enabled, and the old name for it. The old
# file goes last, so that an installation that was cut off does the rest when it is repeated.
dashboard_of_before() {
    units=$root/etc/systemd/system wants=$root/etc/systemd/system/multi-user.target.wants
    [ -f "$units/facetd-live.service" ] && [ ! -L "$units/facetd-live.service" ] || return 0
    if [ -L "$wants/facetd-live.service" ]; then
        ln -sfn /etc/systemd/system/facetd-dashboard.service "$wants/facetd-dashboard.service"
        ln -sfn /etc/systemd/system/facetd-dashboard.service "$units/.facetd-live.service"
        rm "$wants/facetd-live.service"
        mv -T "$units/.facetd-live.service" "$units/facetd-live.service"
        say "facetd-live is now called facetd-dashboard; it stays enabled"
    else
        rm "$units/facetd-live.service"
    fi
}

switch_to() {
    sync -f "$opt/releases/$(basename "$1")"  # all of it on the disk before anything leads to it
    ln -sfn "releases/$(basename "$1")" "$opt/.current"
    mv -T "$opt/.current" "$opt/current"
}

restart() {
    alive || return 0
    if systemctl -q is-active facetd; then
        systemctl restart facetd && say "restarted"
    fi
}

do_install() {
    need_root
    packages
    build
    settings
    if ! runs "$release"; then
        fail "this release does not take your configuration (above); the one before stays in use"
    fi
    at_home
    trap - EXIT
    system_files
    before=$(readlink "$opt/current" 2>/dev/null || true)
    switch_to "$release"
    # shellcheck disable=SC2012
    ls -1d "$opt"/releases/* | sort | head -n -$keep | while read -r old; do
        [ "releases/$(basename "$old")" = "$before" ] || rm -rf "$old"
    done
    restart
    say "installed. Next: deploy/README.md, 3. Configure and start. Then: systemctl enable --now facetd"
}

do_extra() {
    need_root
    [ -L "$opt/current" ] || fail "nothing is installed in $opt"
    case ${1:-} in
    systemd) "$opt/current/deploy/systemd-extra.sh" "$opt/current/venv/bin/pip" && return 0 ;;
    dashboard | live | export | fleet | metrics) ;;
    *) fail "which extra? dashboard, export, fleet, metrics or systemd" ;;
    esac
    # shellcheck disable=SC2086
    "$opt/current/venv/bin/pip" install -q ${FACETD_PIP:-} -e "$opt/current[$1]"
    say "the extra $1 is there now; where it is for the daemon: systemctl restart facetd"
}

do_rollback() {
    need_root
    [ -L "$opt/current" ] || fail "nothing is installed in $opt"
    now=$(basename "$(readlink "$opt/current")")
    # shellcheck disable=SC2012
    for before in $(ls -1 "$opt/releases" | sort -r | sed -n "/^$now\$/,\$p" | tail -n +2); do
        # What lies below DESTDIR names where it will lie, and does not run here.
        program=$opt/releases/$before/venv/bin/facetd
        if [ -x "$program" ] && { [ -n "$root" ] || runs "$opt/releases/$before"; }; then
            switch_to "$before"
            restart
            say "back to $before"
            return 0
        fi
        say "left out: $before, which cannot run here"
    done
    fail "there is no release before $now that runs"
}

do_remove() {
    need_root
    if alive; then
        systemctl disable --now -q facetd facetd-dashboard 2>/dev/null || true
    fi
    rules=$root/etc/udev/rules.d/60-facetd.rules
    if [ "$command" = purge ] || cmp -s "$opt/current/deploy/60-facetd.rules" "$rules"; then
        rm -f "$rules"
    elif [ -e "$rules" ]; then
        say "kept your $rules"
    fi
    rm -rf "$opt"
    rm -f "$root/etc/systemd/system/facetd.service" "$root/etc/systemd/system/facetd-dashboard.service" \
        "$root/etc/systemd/system/facetd-live.service" \
        "$root/etc/systemd/system/multi-user.target.wants/facetd-dashboard.service" "$root/usr/lib/sysusers.d/facetd.conf" \
        "$root/usr/lib/tmpfiles.d/facetd.conf" "$root/usr/lib/systemd/catalog/facetd.catalog" \
        "$root/usr/local/bin/facetctl" "$root/usr/local/bin/facetd" "$root$completion"
    [ -n "$root" ] || journalctl --update-catalog
    if alive; then
        systemctl daemon-reload
        udevadm control --reload
    fi
    say "removed; /etc/facetd and /var/lib/facetd are kept"
}

do_purge() {
    do_remove
    rm -rf "$root/etc/facetd" "$root/var/lib/facetd"
    say "and so are they, now"
}

command=${1:-}
case $command in
install | upgrade) do_install ;;
extra) do_extra "${2:-}" ;;
rollback) do_rollback ;;
remove) do_remove ;;
purge) do_purge ;;
*) sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit 2 ;;
esac
