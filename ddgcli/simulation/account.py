"""Account of the calls and seconds of every effect, of the solver, the integrator and the output."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter


class Account:
    """Exclusive time by name: an inner timer stops the outer one, so that the parts add up to the whole.

    `with account.within("bending"): ...` counts one call and its seconds.

    Attributes
    ----------
    check : callable, optional
        Called before each timer starts; a trial run raises an exception in it when its time is over.
    """

    check: Callable[[], None] | None = None

    def __init__(self) -> None:
        self.calls: dict[str, int] = {}
        self.seconds: dict[str, float] = {}
        self._stack: list[str] = []
        self._since = 0.0

    def within(self, name: str, calls: int = 1) -> _Timer:
        """Context manager that adds one call (or `calls`) and the time inside it to those of `name`."""
        return _Timer(self, name, calls)

    def _switch(self) -> None:
        now = perf_counter()
        if self._stack:
            self.seconds[self._stack[-1]] += now - self._since
        self._since = now

    def rows(self) -> dict[str, tuple[int, float]]:
        """name -> (calls, seconds)."""
        return {name: (self.calls[name], self.seconds[name]) for name in self.calls}

    def restore(self, rows: dict[str, tuple[int, float]]) -> None:
        """Continue from the rows of an earlier part of the run."""
        self.calls = {name: calls for name, (calls, _) in rows.items()}
        self.seconds = {name: seconds for name, (_, seconds) in rows.items()}


def time_shares(
    account: Account, effects: list[str], total: float
) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
    """Seconds of the time loop by effect and by part.

    Parameters
    ----------
    account : Account
    effects : list of str
        Names of the effects.
    total : float
        Seconds of the loop.

    Returns
    -------
    by_effect : dict
        Effect -> seconds, share of the total and number of evaluations; those never evaluated come last.
    by_part : dict of str to float
        Seconds of the effects, "solver", "integrator", "output", "unaccounted" and "total".
    """
    seconds = {name: account.seconds.get(name, 0.0) for name in (*effects, "solver", "integrator", "output")}
    by_effect: dict[str, dict[str, float]] = {
        name: {
            "seconds": seconds[name],
            "share": seconds[name] / (total or 1.0),
            "evaluations": account.calls.get(name, 0),
        }
        for name in sorted(effects, key=lambda name: not account.calls.get(name))
    }
    return by_effect, {**seconds, "unaccounted": total - sum(seconds.values()), "total": total}


class _Timer:
    __slots__ = ("account", "calls", "name")

    def __init__(self, account: Account, name: str, calls: int) -> None:
        self.account, self.name, self.calls = account, name, calls

    def __enter__(self) -> None:
        account = self.account
        if account.check is not None:
            account.check()
        account._switch()
        account.calls[self.name] = account.calls.get(self.name, 0) + self.calls
        account.seconds.setdefault(self.name, 0.0)
        account._stack.append(self.name)

    def __exit__(self, *exception: object) -> None:
        self.account._switch()
        self.account._stack.pop()
