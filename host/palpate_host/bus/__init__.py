"""A CAN bus for one machine without SocketCAN: the hub, its python-can interface, and bus logs."""
