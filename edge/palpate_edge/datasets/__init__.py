"""Recordings on disk: press datasets, folders of frames, videos.

Belongs here: readers and writers of recordings and of sensor.toml. May use: vision, geometry, common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = [
    "PressDataset",
    "RealTimeSource",
    "Recorder",
    "open_recording",
    "read_dataset",
    "read_image",
    "read_sensor",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "press_dataset": "PressDataset read_dataset",
        "recording": "open_recording RealTimeSource",
        "recorder": "Recorder",
        "images": "read_image",
        "sensor_file": "read_sensor",
    },
)
