"""The twin's commands, plugged into palpate-host by entry point.

Belongs here: arguments and printing. May use: every room.
"""

__all__ = []
