"""The fingertip's process: capture, estimate, publish.

Belongs here: the loop, its threads, health, self-check and configuration. May use: every lower room of the
edge.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["FingertipConfig", "FingertipCore", "HealthReport", "read_config", "read_health", "run"]

__getattr__ = lazy_exports(
    __name__,
    {
        "daemon": "run",
        "config": "FingertipConfig read_config",
        "fingertip_core": "FingertipCore",
        "health": "HealthReport read_health",
    },
)
