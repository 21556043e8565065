#!/bin/sh
# Print the state of a board for remote diagnosis. No command here changes anything.
show() {
    echo
    echo "=== $*"
    "$@" 2>&1 || echo "(exit status $?)"
}
show date --iso-8601=seconds
show uname -a
show uptime
show /opt/palpate/bin/palpate-release status
if [ -e /etc/palpate/fingertip.toml ]; then
    show /opt/palpate/current/bin/palpate-edge check --config /etc/palpate/fingertip.toml
fi
show systemctl --no-pager --full status 'palpate*'
show systemctl --no-pager --failed
show ip -details -statistics link
show df -h / /run /tmp
show free -m
show chronyc tracking
if command -v vcgencmd >/dev/null; then show vcgencmd get_throttled; fi
show journalctl --no-pager --boot --unit 'palpate*' --output short-precise
show journalctl --no-pager --boot --dmesg --priority warning
