"""``palpate-edge guide`` as a process with typed lines, and its refusals."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from contextlib import closing

import pytest
from click.testing import CliRunner

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.cli.main import cli
from palpate_edge.common.errors import ConfigError
from palpate_edge.datasets.weights_table import read_weight_rows

PATIENCE_S = 60.0


class Typed:
    """The command with a pipe for what is typed."""

    def __init__(self, config):
        command = [sys.executable, "-m", "palpate_edge.cli.main", "guide", "--config", str(config)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self._text, self._seen = "", 0
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def close(self):
        """Kill the process if it has not ended."""
        self.process.kill()
        self.process.wait()
        self._thread.join()
        self.process.stdin.close()
        self.process.stdout.close()

    def say(self, line):
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()

    def until(self, text):
        """Wait for a text after the one that was waited for last."""
        end_s = time.monotonic() + PATIENCE_S
        while (found := self._text.find(text, self._seen)) < 0:
            assert time.monotonic() < end_s, f"{text} not in {self._text[self._seen :]}"
            time.sleep(0.02)
        self._seen = found + len(text)

    def _read(self):
        while letter := self.process.stdout.read(1):
            self._text += letter


@pytest.mark.slow
def test_typed_lines_lead_to_the_file_over_an_interruption(bench, tmp_path):
    with bench.camera(tmp_path) as (camera, config):
        with closing(Typed(config)) as typed:
            for text in ("best", "brightness", "every bead", "20 pictures of", "measuring"):
                typed.until(text)
                typed.say("")
            typed.until("6/8 Presses on the scale")
            for image, mass_g in bench.presses[:2]:
                camera.shown = [image]
                time.sleep(1.0)
                typed.say("")
                typed.until("how many grams")
                typed.say(f"{mass_g:g}")
                typed.until("last press")
            typed.say("quit")
            typed.until("the same command goes on from here")
            assert typed.process.wait(PATIENCE_S) == 0
        assert len(read_weight_rows(tmp_path / "presses" / "weights.csv")) == 2
        assert not (tmp_path / "table.cal").exists()
        with closing(Typed(config)) as typed:
            typed.until("6/8 Presses on the scale")
            typed.say("next")
            typed.until("8/8 Result")
            typed.until("written")
            assert typed.process.wait(PATIENCE_S) == 0
    assert load_calibration(tmp_path / "table.cal").source.weighed == 2
    assert (tmp_path / "table.svg").read_text().startswith("<svg")


def test_a_configuration_without_a_sensor_is_refused(tmp_path):
    config = tmp_path / "finger.toml"
    config.write_text(
        'name = "bare"\n[capture]\nsource = "recorded"\npath = "frames"\n[node]\nid = 16\n'
        '[bus]\ninterface = "palpate"\n'
    )
    result = CliRunner().invoke(cli, ["guide", "--config", str(config)])
    assert isinstance(result.exception, ConfigError)
    assert str(result.exception).startswith("bare: estimator.sensor is not set")
