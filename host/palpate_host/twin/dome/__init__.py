"""The dome by finite elements: presses of a silicone hemisphere and the library of their fields.

:mod:`library` needs numpy alone; everything that solves needs the extra ``twin`` (scipy).
"""
