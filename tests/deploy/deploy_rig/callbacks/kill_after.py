"""Count ansible's tasks, and kill ansible (signal 9) when one has ended: a callback plugin for tests.

PALPATE_KILL_AFTER is the end of a task's name, or its number among the tasks that ran, from 1.
"""

from __future__ import annotations

import os
import signal

from ansible.plugins.callback import CallbackBase


class CallbackModule(CallbackBase):
    """Kills the process group, which ansible-playbook leads. A skipped task does not count."""

    CALLBACK_VERSION = 2.0
    CALLBACK_TYPE = "aggregate"
    CALLBACK_NAME = "kill_after"

    def __init__(self) -> None:
        super().__init__()
        self._number = 0

    def v2_runner_on_ok(self, result) -> None:
        self._number += 1
        wanted = os.environ["PALPATE_KILL_AFTER"]
        if wanted == str(self._number) or result.task_name.endswith(wanted):
            os.killpg(os.getpgrp(), signal.SIGKILL)
