#!/bin/sh
# Chromium, in which a test clicks through the report page. Where it may not be installed, that test says so and skips.
command -v chromium >/dev/null && command -v chromedriver >/dev/null && exit 0
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "== installing chromium for the report page's test"
    { apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends chromium chromium-driver; } \
        >/dev/null 2>&1 && exit 0
fi
echo "note: no chromium here: the report page's browser test will be skipped"
