"""The trial of mutated inputs: each is accepted, refused by our own error, or it escapes.

`fuzz` runs in this process; `fuzz_in_processes` in children of some hundred inputs each, which a crash or a
loop without end cannot take along. With `coverage`, later children also mutate the inputs that
reached a line of the package first.
"""

from __future__ import annotations

import json
import logging
import mmap
import os
import random
import resource
import signal
import struct
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.fuzz.coverage import LineCoverage, tokens_of
from benchmarks.fuzz.inputs import SECONDS_FOR_ONE, Kind
from benchmarks.fuzz.mutate import WORDS, mutated
from benchmarks.fuzz.scratch import remove_scratch_folders
from ddgcli.errors import DdgError

LONGEST_MESSAGE = 600  # characters, beside the path
WALL_FACTOR = 20  # on a busy machine the clock runs faster
INPUTS_OF_A_CHILD = 200
MESSAGE_IN_NOTES, BYTES_OF_AN_ESCAPE = 300, 4096  # a character takes 12 bytes in JSON at most
MEMORY_OF_A_CHILD = 2 << 30  # bytes beside what the parent has
KEPT_ESCAPES = 20
INTERRUPTS = (signal.SIGINT, signal.SIGTERM)  # a child has a group of its own, which they do not reach
SHARE_OF_ACCEPTED, SHARE_OF_REFUSED = 0.45, 0.1  # of the mutated inputs; the others are the valid ones
MAX_SLOWNESS = 4  # of an input that joins the pool, in mean times
QUICK_SECONDS = 0.01  # any input that takes less joins the pool
MAX_GROWTH = 4  # of an input that joins the pool, in sizes of the largest valid one


@dataclass
class Account:
    """What came of the inputs of one kind."""

    inputs: int = 0
    accepted: int = 0
    refused: int = 0
    slowest: float = 0.0
    cpu_seconds: float = 0.0
    escapes: list[tuple[str, bytes]] = field(default_factory=list)
    lines: int = 0  # reached in functions of the package; 0 where they are not counted
    lines_of_seeds: int = 0
    pool: int = 0  # inputs that were mutated
    interrupted: bool = False  # by Control-C; what the last child tried is not counted

    def __str__(self) -> str:
        lines = f", lines {self.lines_of_seeds} to {self.lines}, {self.pool} mutated" if self.lines else ""
        return (
            f"{self.inputs:7d} inputs, {self.accepted:6d} accepted, {self.refused:7d} refused, "
            f"{len(self.escapes)} escapes, {self.cpu_seconds:.1f} s, slowest {self.slowest:.2f} s{lines}"
        )

    def count(self, kind: str, message: str, data: bytes) -> None:
        """Count one input."""
        self.inputs += 1
        self.accepted += kind == "accepted"
        self.refused += kind == "refused"
        if kind == "escape" and len(self.escapes) < KEPT_ESCAPES:
            self.escapes.append((message[:300], data))


def outcome(
    read: Callable[[bytes], object], data: bytes, cpu_seconds: float = SECONDS_FOR_ONE
) -> tuple[str, str]:
    """('accepted' | 'refused' | 'escape', message)."""
    began = time.process_time()
    try:
        read(data)
        kind, message = "accepted", ""
    except DdgError as error:
        message = str(error)
        kind = "refused" if len(message) <= LONGEST_MESSAGE else "escape"
    except Exception as error:
        kind, message = "escape", f"{type(error).__name__}: {error}"
    if time.process_time() - began > cpu_seconds:
        kind, message = "escape", f"took {time.process_time() - began:.0f} s"
    return kind, message


@dataclass(frozen=True)
class Pool:
    """What is mutated: valid inputs, inputs that reached further lines, and words of the format.

    Of the latter, `accepted` ones are mutated more often than `refused` ones, most of whose mutations end in
    the same refusal.
    """

    seeds: Sequence[bytes]
    accepted: Sequence[bytes] = ()
    refused: Sequence[bytes] = ()
    tokens: Sequence[bytes] = WORDS

    def with_inputs(self, inputs: Sequence[tuple[str, bytes]]) -> Pool:
        """The pool with further inputs, each with its result, but those that have grown."""
        longest = MAX_GROWTH * max(map(len, self.seeds), default=0)
        new: dict[str, list[bytes]] = {"accepted": [*self.accepted], "refused": [*self.refused], "escape": []}
        for result, data in inputs:
            if len(data) <= longest:
                new[result].append(data)
        return replace(self, accepted=new["accepted"], refused=new["refused"])

    @property
    def size(self) -> int:
        """Number of the inputs that are mutated."""
        return len(self.seeds) + len(self.accepted) + len(self.refused)

    def mutated_input(self, rng: random.Random) -> bytes:
        """A mutation of one of the inputs, which may take pieces of all."""
        every = [*self.seeds, *self.accepted, *self.refused]
        share = rng.random()
        origin = self.seeds
        if share < SHARE_OF_ACCEPTED and self.accepted:
            origin = self.accepted
        elif share > 1 - SHARE_OF_REFUSED and self.refused:
            origin = self.refused
        return mutated(rng.choice(origin), rng, every, self.tokens)


def input_of(kind: Kind, pool: Pool, seed: int, number: int) -> bytes:
    """The input of this number: from the same pool the same in every process."""
    rng = random.Random(f"{kind.name} {seed} {number}")
    if kind.random_input is not None:
        return kind.random_input(rng)
    return pool.mutated_input(rng)


def fuzz(
    kind: Kind,
    count: int,
    seed: int,
    first: int = 0,
    notes: Notes | None = None,
    pool: Pool | None = None,
    coverage: LineCoverage | None = None,
    cpu_seconds: float = np.inf,
) -> Account:
    """Try the inputs `first` … `first` + `count` of a kind; `notes` keep what a killed process knew."""
    account, read = Account(), kind.reader()
    pool = Pool(kind.seeds()) if pool is None else pool
    reached, whole = b"" if coverage is None else coverage.snapshot, 0.0
    for number in range(count):
        data = input_of(kind, pool, seed, first + number)
        began = _cpu()
        result = outcome(read, data, kind.cpu_seconds)
        account.count(*result, data)
        seconds = _cpu() - began
        account.slowest, whole = max(account.slowest, seconds), whole + seconds
        now = b"" if coverage is None else coverage.snapshot
        if notes is not None:
            quick = seconds <= max(QUICK_SECONDS, MAX_SLOWNESS * whole / (number + 1))
            notes.add(number, *result, account.slowest, further=now != reached and quick)
        reached = now
        if time.process_time() > cpu_seconds:
            break
    return account


def fuzz_in_processes(
    kind: Kind, cpu_seconds: float, seed: int, coverage: LineCoverage | None = None, guided: bool = True
) -> Account:
    """Try inputs of a kind in children until this processor time, theirs too, is over.

    Parameters
    ----------
    kind : Kind
    cpu_seconds : float
    seed : int
    coverage : LineCoverage, optional
        Counts the lines that the inputs reach.
    guided : bool
        Whether inputs that reach further lines join the pool.
    """
    total, pool, number = Account(), Pool(kind.seeds()), 0
    read = kind.reader()
    if coverage is not None:
        pool = _with_coverage_of_seeds(kind, pool, coverage)
        total.lines_of_seeds = coverage.count
    began = _cpu()
    while (left := cpu_seconds - (_cpu() - began)) > 0:
        try:
            notes, code = _fuzz_in_child(kind, seed, number, pool, coverage, left)
        except KeyboardInterrupt:
            total.interrupted = True
            break
        total.slowest = max(total.slowest, notes.slowest)
        messages = notes.messages
        for k, result in enumerate(notes.results):
            data = b"" if result != "escape" else input_of(kind, pool, seed, number + k)
            message = messages.get(k, "")
            if result == "escape" and _outcome_in_child(kind, read, data)[0] != "escape":
                message = f"not when it is tried again: {message}"
            total.count(result, message, data)
        further = [(notes.results[k], input_of(kind, pool, seed, number + k)) for k in notes.further]
        number += len(notes.results)
        if code:
            data = input_of(kind, pool, seed, number)
            again = ("escape", _reason(code, kind.cpu_seconds))  # of a guarded reader the child had no guard
            total.count(*(_outcome_in_child(kind, read, data) if kind.guarded else again), data)
            number += 1
        if guided:
            pool = pool.with_inputs(further)
    total.cpu_seconds = _cpu() - began
    total.lines = coverage.count if coverage is not None else 0
    total.pool = pool.size
    remove_scratch_folders()
    return total


def _with_coverage_of_seeds(kind: Kind, pool: Pool, coverage: LineCoverage) -> Pool:
    """Mark the lines that the valid inputs reach; the pool with the words of their files."""
    coverage.clear()
    read = kind.reader()
    with kind.without_guard():
        for data in pool.seeds:
            outcome(read, data)
    return replace(pool, tokens=tokens_of(coverage.files()) or WORDS)


def _reason(code: int, seconds: float) -> str:
    return f"took {seconds:.0f} s" if code == -signal.SIGKILL else f"the process ended with {code}"


def _cpu() -> float:
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in usage)


class Notes:
    """Results of a child's inputs in memory that its parent sees."""

    HEAD = struct.Struct("<qd")  # inputs read, slowest
    RESULTS = ("accepted", "refused", "escape")
    FURTHER = 128  # added to the result of an input that reached a line first

    def __init__(self) -> None:
        self.memory = mmap.mmap(-1, self.HEAD.size + INPUTS_OF_A_CHILD)
        # number and message of each escape
        self.lines = mmap.mmap(-1, INPUTS_OF_A_CHILD * BYTES_OF_AN_ESCAPE)

    def add(self, number: int, result: str, message: str, slowest: float, further: bool = False) -> None:
        """Note the result of an input of the child."""
        if result == "escape":
            self.lines.write(json.dumps([number, message[:MESSAGE_IN_NOTES]]).encode() + b"\n")
        self.memory[self.HEAD.size + number] = self.RESULTS.index(result) + self.FURTHER * further
        self.memory[: self.HEAD.size] = self.HEAD.pack(number + 1, slowest)

    @property
    def messages(self) -> dict[int, str]:
        """Messages of the escapes by number."""
        return dict(json.loads(line) for line in self.lines[: self.lines.find(b"\0")].splitlines())

    @property
    def codes(self) -> bytes:
        """Codes of the inputs that were read."""
        count = self.HEAD.unpack(self.memory[: self.HEAD.size])[0]
        return self.memory[self.HEAD.size : self.HEAD.size + count]

    @property
    def results(self) -> list[str]:
        """Results of the inputs that were read."""
        return [self.RESULTS[code % self.FURTHER] for code in self.codes]

    @property
    def further(self) -> list[int]:
        """Numbers of the inputs that reached a line first."""
        return [number for number, code in enumerate(self.codes) if code >= self.FURTHER]

    @property
    def slowest(self) -> float:
        """Processor seconds of the slowest input."""
        return self.HEAD.unpack(self.memory[: self.HEAD.size])[1]


def _fuzz_in_child(
    kind: Kind, seed: int, first: int, pool: Pool, coverage: LineCoverage | None, cpu_seconds: float
) -> tuple[Notes, int]:
    """Notes of a child that reads inputs, and its exit code."""

    def read_inputs(notes: Notes) -> None:
        with kind.without_guard():
            fuzz(kind, INPUTS_OF_A_CHILD, seed, first, notes, pool, coverage, cpu_seconds)

    return _watched_child(kind, read_inputs)


def _outcome_in_child(kind: Kind, read: Callable[[bytes], object], data: bytes) -> tuple[str, str]:
    """Outcome of an input tried again, with the guard of its reader."""

    def read_one(notes: Notes) -> None:
        result, message = outcome(read, data, kind.cpu_seconds)
        notes.add(0, result, message, 0.0)

    notes, code = _watched_child(kind, read_one)
    if code or not notes.results:
        return "escape", _reason(code, kind.cpu_seconds)
    return notes.results[0], notes.messages.get(0, "")


def _watched_child(kind: Kind, work: Callable[[Notes], None]) -> tuple[Notes, int]:
    """Notes that a child makes in `work`, and its exit code."""
    notes = Notes()
    # an interrupt between the fork and the try would not end the child
    interrupts: list[int] = []
    handlers = {
        number: signal.signal(number, lambda number, _: interrupts.append(number)) for number in INTERRUPTS
    }
    child = os.fork()
    if child == 0:
        code = 1
        try:
            _set_handlers(handlers)
            os.setsid()
            _limit_memory()
            logging.lastResort = None  # the command line has its own handler
            warnings.simplefilter("ignore")  # the command line captures them
            work(notes)
            code = 0
        finally:
            remove_scratch_folders()
            os._exit(code)
    try:
        _set_handlers(handlers)
        if interrupts:
            raise KeyboardInterrupt
        return notes, _watch(kind, child, notes)
    except KeyboardInterrupt:
        with suppress(ProcessLookupError):  # the child has no group of its own yet
            os.killpg(child, signal.SIGKILL)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        raise


def _set_handlers(handlers: dict[signal.Signals, Any]) -> None:
    for number, handler in handlers.items():
        signal.signal(number, handler)


def _watch(kind: Kind, child: int, notes: Notes) -> int:
    """Exit code of a child, which is killed where one input takes too long."""
    count_before, clock_before, cpu_before = 0, time.monotonic(), 0.0
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        cpu, count = time.clock_gettime((~child << 3) | 2), len(notes.results)  # clock of another process
        if count != count_before:
            count_before, clock_before, cpu_before = count, time.monotonic(), cpu
        elif max(cpu - cpu_before, (time.monotonic() - clock_before) / WALL_FACTOR) > kind.cpu_seconds:
            os.killpg(child, signal.SIGKILL)
        time.sleep(0.01)


def _limit_memory() -> None:
    with open("/proc/self/statm", encoding="ascii") as statm:
        virtual_size = int(statm.read().split()[0]) * resource.getpagesize()
    limit = virtual_size + MEMORY_OF_A_CHILD
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
