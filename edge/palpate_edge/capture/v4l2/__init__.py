"""Video capture from the kernel's V4L2 interface: no library between us and the driver."""
