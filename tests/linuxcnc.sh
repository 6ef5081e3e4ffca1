#!/bin/sh
# LinuxCNC, a controller that was not made here, for the tests of an arm behind it. Where it may not be installed, they say so and skip.
command -v linuxcnc >/dev/null && exit 0
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "== installing LinuxCNC for the tests of an arm behind it"
    { apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends linuxcnc-uspace; } \
        >/dev/null 2>&1 && exit 0
fi
echo "note: no LinuxCNC here: the tests of an arm behind it will be skipped"
