"""Calls and seconds of every effect, of the solver, the integrator and the output."""

from __future__ import annotations

from time import perf_counter


class Account:
    """Exclusive time by name: a timer inside another stops the outer one, so the parts add up to the whole.

    `with account.within("bending"): ...` counts one call and its seconds.
    """

    def __init__(self) -> None:
        self.calls: dict[str, int] = {}
        self.seconds: dict[str, float] = {}
        self._stack: list[str] = []
        self._since = 0.0

    def within(self, name: str) -> _Timer:
        """Context manager that books one call and the time inside it to `name`."""
        return _Timer(self, name)

    def _switch(self) -> None:
        now = perf_counter()
        if self._stack:
            self.seconds[self._stack[-1]] += now - self._since
        self._since = now

    def rows(self) -> dict[str, tuple[int, float]]:
        """name -> (calls, seconds)."""
        return {name: (self.calls[name], self.seconds[name]) for name in self.calls}

    def restore(self, rows: dict[str, tuple[int, float]]) -> None:
        """Go on from the rows of an earlier part of the run."""
        self.calls = {name: calls for name, (calls, _) in rows.items()}
        self.seconds = {name: seconds for name, (_, seconds) in rows.items()}


class _Timer:
    __slots__ = ("account", "name")

    def __init__(self, account: Account, name: str) -> None:
        self.account, self.name = account, name

    def __enter__(self) -> None:
        account = self.account
        account._switch()
        account.calls[self.name] = account.calls.get(self.name, 0) + 1
        account.seconds.setdefault(self.name, 0.0)
        account._stack.append(self.name)

    def __exit__(self, *exception: object) -> None:
        self.account._switch()
        self.account._stack.pop()
