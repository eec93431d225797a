"""The account of a run counts every entry once and gives every second to one name."""

from time import sleep

import pytest

from ddgcli.simulation.account import Account, time_shares


def test_every_entry_is_counted_once():
    account = Account()
    for _ in range(3):
        with account.within("bending"), account.within("solver"):
            pass
    assert account.calls == {"bending": 3, "solver": 3}
    by_effect, _ = time_shares(account, ["bending", "gravity"], 1.0)
    assert {name: row["evaluations"] for name, row in by_effect.items()} == {"bending": 3, "gravity": 0}


def test_an_inner_timer_stops_the_outer_one():
    account = Account()
    with account.within("integrator"):
        with account.within("solver"):
            sleep(0.05)
        sleep(0.01)
    assert account.seconds["solver"] >= 0.05
    total = sum(account.seconds.values())
    assert account.seconds["integrator"] == pytest.approx(total - account.seconds["solver"])
    restored = Account()
    restored.restore(account.rows())
    assert restored.calls == account.calls and restored.seconds == account.seconds
