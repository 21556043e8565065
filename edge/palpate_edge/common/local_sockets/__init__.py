"""Unix sockets of one machine: systemd's notifications, the peers and leftover files of other sockets."""
