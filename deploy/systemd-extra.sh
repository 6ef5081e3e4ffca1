#!/bin/sh
# Install the `systemd` extra where it can be compiled; say so in one line where it cannot. The daemon runs without it.
# usage: systemd-extra.sh PIP
pip=$1
include=$("${pip%pip}python" -c 'import sysconfig; print(sysconfig.get_paths()["include"])')

ready() { command -v cc >/dev/null && pkg-config --exists libsystemd 2>/dev/null && [ -f "$include/Python.h" ]; }

if ! ready && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "== installing the headers of libsystemd"
    { apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
        gcc libc6-dev libsystemd-dev pkg-config python3-dev; } >/dev/null 2>&1
fi
if ready && "$pip" install -q 'systemd-python>=235' 2>/dev/null; then
    exit 0
fi
echo "note: without systemd's journal and notifications (needs a C compiler, pkg-config, libsystemd-dev, python3-dev)"
