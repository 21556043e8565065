"""Logs of a CAN bus: candump, ASC, BLF, pcap.

Belongs here: readers and writers of log files. May use: palpate_edge.common and can_bus.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["LogNote", "LogRecord", "LogWriter", "read_any_log", "read_log", "write_log", "write_pcap"]

__getattr__ = lazy_exports(
    __name__,
    {
        "candump": "LogNote LogRecord LogWriter read_log write_log",
        "log_files": "read_any_log",
        "pcap": "write_pcap",
    },
)
