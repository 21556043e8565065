"""Hands whose ticks do not fit on their bus are refused before they start."""

import msgspec
import pytest

from palpate_bus.load.budget import BudgetCase, budget
from palpate_edge.common.errors import ConfigError
from palpate_host.service.bus_load_check import check_bus_load
from palpate_host.service.host import load_hand
from palpate_twin.cli.options import PACKAGED


def ticking(model, tick_Hz):
    config, _ = load_hand(PACKAGED[model])
    return msgspec.structs.replace(config, control=msgspec.structs.replace(config.control, tick_Hz=tick_Hz))


@pytest.mark.parametrize("tick_Hz", [10, 100, 250])
def test_a_hand_of_nine_drives_fits_at_usual_rates(tick_Hz):
    check_bus_load(ticking("table4-wide", tick_Hz))


def test_too_many_ticks_are_refused_with_the_largest_number_that_fits():
    """By the budget command's own figures: what the message names fits, one tick more does not."""
    refusal = r"500 ticks a second load the bus of 1000 kbit/s to \d+ %"
    with pytest.raises(ConfigError, match=refusal) as error:
        check_bus_load(ticking("table4-wide", 500))
    named = int(str(error.value).split("set control.tick_Hz to ")[1].split()[0])
    check_bus_load(ticking("table4-wide", named))
    assert budget(BudgetCase(tick_Hz=named)).worst_percent <= 100.0
    assert budget(BudgetCase(tick_Hz=named + 1)).worst_percent > 100.0


def test_a_bus_that_is_too_slow_for_any_rate_is_named():
    config = ticking("table4-wide", 100)
    config = msgspec.structs.replace(config, bus=msgspec.structs.replace(config.bus, bitrate=50_000))
    with pytest.raises(ConfigError, match=r"50 kbit/s .* use a faster bus or fewer nodes"):
        check_bus_load(config)


def test_the_hand_of_table_3_does_not_fit_at_its_1000_ticks():
    """15 drives at 1 kHz: the paper's hand has no CAN bus. The bus is named, not the start pose."""
    with pytest.raises(ConfigError, match=r"1000 ticks a second load the bus .* and 15 drives"):
        check_bus_load(load_hand(PACKAGED["table3"])[0])
