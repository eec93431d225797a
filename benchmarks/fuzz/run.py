"""The trial of mutated inputs: each is accepted, refused by our own error, or it escapes.

`fuzz` runs in this process; `fuzz_in_processes` in children of some hundred inputs each, which a crash or a
loop without end cannot take along.
"""

from __future__ import annotations

import logging
import mmap
import os
import random
import resource
import signal
import struct
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field

from benchmarks.fuzz.inputs import Kind
from benchmarks.fuzz.mutate import mutated
from ddgcli.errors import DdgError

LONGEST_MESSAGE = 600  # characters, beside the path
SECONDS_FOR_ONE = 20.0  # of processor time, for inputs of some kilobytes
WALL_FACTOR = 20  # on a busy machine the clock runs faster
INPUTS_OF_A_CHILD = 200
MEMORY_OF_A_CHILD = 2 << 30  # bytes beside what the parent has
KEPT_ESCAPES = 20


@dataclass
class Account:
    """What came of the inputs of one kind."""

    inputs: int = 0
    accepted: int = 0
    refused: int = 0
    slowest: float = 0.0
    cpu_seconds: float = 0.0
    escapes: list[tuple[str, bytes]] = field(default_factory=list)

    def count(self, kind: str, message: str, data: bytes) -> None:
        """Count one input."""
        self.inputs += 1
        self.accepted += kind == "accepted"
        self.refused += kind == "refused"
        if kind == "escape" and len(self.escapes) < KEPT_ESCAPES:
            self.escapes.append((message[:300], data))


def outcome(read: Callable[[bytes], object], data: bytes) -> tuple[str, str]:
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
    if time.process_time() - began > SECONDS_FOR_ONE:
        kind, message = "escape", f"took {time.process_time() - began:.0f} s"
    return kind, message


def input_of(name: str, seeds: list[bytes], seed: int, number: int) -> bytes:
    """The mutated input of this number: the same in every process."""
    rng = random.Random(f"{name} {seed} {number}")
    return mutated(rng.choice(seeds), rng, seeds)


def fuzz(kind: Kind, count: int, seed: int, first: int = 0, notes: Notes | None = None) -> Account:
    """Try the inputs `first` … `first` + `count` of a kind; `notes` keep what a killed process knew."""
    account, seeds, read = Account(), kind.seeds(), kind.reader()
    for number in range(count):
        data = input_of(kind.name, seeds, seed, first + number)
        began = time.monotonic()
        result = outcome(read, data)
        account.count(*result, data)
        account.slowest = max(account.slowest, time.monotonic() - began)
        if notes is not None:
            notes.add(number, result[0], account.slowest)
    return account


def fuzz_in_processes(kind: Kind, cpu_seconds: float, seed: int) -> Account:
    """Try inputs of a kind in children until this processor time, theirs too, is over."""
    total, seeds, number = Account(), kind.seeds(), 0
    began = _cpu()
    while _cpu() - began < cpu_seconds:
        notes, code = _fuzz_in_child(kind, seed, number)
        total.slowest = max(total.slowest, notes.slowest)
        for k, result in enumerate(notes.results):
            data = b"" if result != "escape" else input_of(kind.name, seeds, seed, number + k)
            message = outcome(kind.reader(), data)[1] if result == "escape" else ""
            total.count(result, message, data)
        number += len(notes.results)
        if code:
            data = input_of(kind.name, seeds, seed, number)
            again = outcome(kind.reader(), data) if kind.guarded else ("escape", _reason(code))
            total.count(*again, data)
            number += 1
    total.cpu_seconds = _cpu() - began
    return total


def _reason(code: int) -> str:
    return f"took {SECONDS_FOR_ONE:.0f} s" if code == -signal.SIGKILL else f"the process ended with {code}"


def _cpu() -> float:
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in usage)


class Notes:
    """Results of a child's inputs in memory that its parent sees."""

    HEAD = struct.Struct("<qd")  # inputs read, slowest
    RESULTS = ("accepted", "refused", "escape")

    def __init__(self) -> None:
        self.memory = mmap.mmap(-1, self.HEAD.size + INPUTS_OF_A_CHILD)

    def add(self, number: int, result: str, slowest: float) -> None:
        """Note the result of an input of the child."""
        self.memory[self.HEAD.size + number] = self.RESULTS.index(result)
        self.memory[: self.HEAD.size] = self.HEAD.pack(number + 1, slowest)

    @property
    def results(self) -> list[str]:
        """Results of the inputs that were read."""
        count = self.HEAD.unpack(self.memory[: self.HEAD.size])[0]
        return [self.RESULTS[code] for code in self.memory[self.HEAD.size : self.HEAD.size + count]]

    @property
    def slowest(self) -> float:
        """Seconds by the clock of the slowest input."""
        return self.HEAD.unpack(self.memory[: self.HEAD.size])[1]


def _fuzz_in_child(kind: Kind, seed: int, first: int) -> tuple[Notes, int]:
    """Notes of a child and its exit code; it is killed where one input takes too long."""
    notes = Notes()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.setsid()
            _limit_memory()
            logging.disable()  # of writers of the seeds: what a format cannot hold
            warnings.simplefilter("ignore")  # the command line captures them
            with kind.without_guard():
                fuzz(kind, INPUTS_OF_A_CHILD, seed, first, notes)
            code = 0
        finally:
            os._exit(code)
    done, since, used = 0, time.monotonic(), 0.0
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return notes, os.waitstatus_to_exitcode(status)
        cpu, count = time.clock_gettime((~child << 3) | 2), len(notes.results)  # clock of another process
        if count != done:
            done, since, used = count, time.monotonic(), cpu
        elif max(cpu - used, (time.monotonic() - since) / WALL_FACTOR) > SECONDS_FOR_ONE:
            os.killpg(child, signal.SIGKILL)
        time.sleep(0.01)


def _limit_memory() -> None:
    with open("/proc/self/statm", encoding="ascii") as statm:
        used = int(statm.read().split()[0]) * resource.getpagesize()
    limit = used + MEMORY_OF_A_CHILD
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
