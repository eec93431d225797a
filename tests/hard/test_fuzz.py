"""A fixed budget of mutated inputs of every kind; `make fuzz` runs longer."""

import pytest

from benchmarks import fuzz

FEWER = {"scene": 6, "vtkhdf": 25, "expression": 300}  # those that cost more, or less, than others


@pytest.mark.parametrize("name", fuzz.kinds())
def test_mutated_inputs_end_in_our_own_errors(name):
    seeds, reader = fuzz.kinds()[name]
    account = fuzz.fuzz(name, seeds(), reader(), 60, FEWER.get(name, 80), seed=1)
    assert account.escapes == []
    assert account.refused > 0


def test_a_foreign_exception_a_long_message_and_a_slow_reader_escape(monkeypatch):
    from ddgcli.errors import InputError

    def read(data):
        {1: lambda: data.missing, 2: lambda: long_winded(), 3: lambda: sum(range(10**6))}[len(data)]()

    def long_winded():
        raise InputError("long " * 1000)

    assert fuzz.outcome(read, b"1")[0] == "escape"
    assert fuzz.outcome(read, b"12")[0] == "escape"
    monkeypatch.setattr(fuzz, "SECONDS_FOR_ONE", 0.0)
    assert fuzz.outcome(read, b"123") == ("escape", "took 0 s")
