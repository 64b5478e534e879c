"""Runs of the command line as processes of their own, with estimators that misbehave installed beside them."""

import json
import os
import signal
import subprocess
import sys
import time
from functools import partial

PLUGIN = '''
import os, signal, time
from dataclasses import dataclass
from cooploc.estimators.dead_reckoning import DeadReckoning


@dataclass(frozen=True)
class Slow(DeadReckoning):
    """Takes its time."""
    seconds: float = 0.05

    def predict(self, s, z):
        time.sleep(self.seconds)
        return super().predict(s, z)


@dataclass(frozen=True)
class Trouble(DeadReckoning):
    """Does something bad in the trials 3 and 4."""
    does: str = "raise"

    def init(self, prior, world, rows):
        if ((rows.trial == 3) | (rows.trial == 4)).any():
            if self.does == "raise":
                raise RuntimeError("sensor on fire")
            if self.does == "sleep":
                time.sleep(3600)
            if self.does == "spin":
                while True:
                    pass
            if self.does == "die":
                os.kill(os.getpid(), signal.SIGKILL)
            if self.does == "nan":
                prior = prior._replace(x=prior.x * float("nan"))
        return super().init(prior, world, rows)
'''


def install(folder):
    """A folder of plug-ins that processes started with `environment` find."""
    (folder / "trouble.py").write_text(PLUGIN)
    info = folder / "trouble-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: trouble\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[cooploc.estimators]\nslow = trouble:Slow\ntrouble = trouble:Trouble\n")
    return folder


def environment(plugins):
    return {**os.environ, "PYTHONPATH": str(plugins)}


def command(*arguments):
    """As a user calls it, but that what is made to be slow and to fail is checked only where --check says so."""
    if arguments[0] == "run" and "--check" not in arguments:
        arguments = (*arguments, "--no-check")
    return [sys.executable, "-m", "cooploc", *map(str, arguments)]


def finish(*arguments, plugins, **options):
    """Run to the end."""
    return subprocess.run(
        command(*arguments), env=environment(plugins), capture_output=True, text=True, timeout=300, **options
    )


def start(*arguments, plugins, **options):
    """Begin, in a process group of its own, as a shell would; Ctrl-C counts even where this process ignores it."""
    return subprocess.Popen(
        command(*arguments),
        env=environment(plugins),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.default_int_handler),
        **options,
    )


def until(condition, seconds=60):
    """Wait for something to come true."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"still not true after {seconds} s: {condition}")
        time.sleep(0.02)


def parts(folder):
    """Every part's bytes, by name."""
    return {file.name: file.read_bytes() for file in sorted((folder / "parts").glob("*.parquet"))}


def marks(folder):
    """Every part's inode and time of change, by name."""
    found = sorted((folder / "parts").glob("*.parquet"))
    return {file.name: (file.stat().st_ino, file.stat().st_mtime_ns) for file in found}


def table(told):
    """The rows of --json, by estimator."""
    return {row["estimator"]: row for row in json.loads(told.stdout)}
