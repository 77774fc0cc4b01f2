#!/bin/sh
# Installs Debian's chromium for the browser tests where it is missing and we may.
set -eu
browser=${1:-/usr/bin/chromium}
[ -x "$browser" ] && exit 0
if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null; then
    echo "chromium is missing at $browser; install it (Debian: apt-get install chromium) and run again" >&2
    exit 1
fi
apt-get update -qq
DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium >/dev/null
