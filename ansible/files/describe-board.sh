#!/bin/sh
# All that helps to see from afar what is the matter with a board. Nothing here changes anything.
say() {
    echo
    echo "=== $*"
    "$@" 2>&1 || echo "(exit status $?)"
}
say date --iso-8601=seconds
say uname -a
say uptime
say /opt/palpate/bin/palpate-release status
if [ -e /etc/palpate/fingertip.toml ]; then
    say /opt/palpate/current/bin/palpate-edge check --config /etc/palpate/fingertip.toml
fi
say systemctl --no-pager --full status 'palpate*'
say systemctl --no-pager --failed
say ip -details -statistics link
say df -h / /run /tmp
say free -m
say chronyc tracking
if command -v vcgencmd >/dev/null; then say vcgencmd get_throttled; fi
say journalctl --no-pager --boot --unit 'palpate*' --output short-precise
say journalctl --no-pager --boot --dmesg --priority warning
