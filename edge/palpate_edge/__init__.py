"""palpate_edge: what runs on a fingertip's board: frames in, contact and force on the bus."""

__version__ = "0.1.0"
