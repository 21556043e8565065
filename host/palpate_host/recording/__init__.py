"""Recordings of a running hand: MCAP, Parquet, CSV, bus-log segments.

Belongs here: writers, readers and exports. May use: service and below. Needs the extra record.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["SegmentedRecording", "rows", "write_csv"]

__getattr__ = lazy_exports(__name__, {"segments": "SegmentedRecording", "table": "rows write_csv"})
