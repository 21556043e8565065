"""Kill ansible (signal 9) when the task of PALPATE_KILL_AFTER has ended: a callback plugin for tests."""

from __future__ import annotations

import os
import signal

from ansible.plugins.callback import CallbackBase


class CallbackModule(CallbackBase):
    """Kills the process group, which ansible-playbook leads."""

    CALLBACK_VERSION = 2.0
    CALLBACK_TYPE = "aggregate"
    CALLBACK_NAME = "kill_after"

    def v2_runner_on_ok(self, result) -> None:
        if result.task_name.endswith(os.environ.get("PALPATE_KILL_AFTER", "no task")):
            os.killpg(os.getpgrp(), signal.SIGKILL)
