"""Runs of the command line: in this process, or in one of its own, with estimators that misbehave beside it.

A process of its own is forked from a server that has imported everything (warm.py), and needs no seconds to begin.
"""

import contextlib
import io
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from multiprocessing import forkserver
from pathlib import Path
from unittest.mock import patch

from cooploc.__main__ import main
from cooploc.analysis.execution.run import Silent

HANGS = 1200  # [s] on the clock, which nothing but a hang takes, however slow and busy the machine
PLUGIN = '''
import os, signal, time
from dataclasses import dataclass
from cooploc.estimators.dead_reckoning import DeadReckoning


@dataclass(frozen=True)
class Held(DeadReckoning):
    """Waits as long as there is a file `hold` in its directory, and leaves one that is named by its process."""

    def predict(self, s, z):
        while os.path.exists("hold"):
            open(f"held-{os.getpid()}", "w").close()
            time.sleep(0.02)
        return super().predict(s, z)


@dataclass(frozen=True)
class Trouble(DeadReckoning):
    """Does something bad in the trials 3 and 4."""
    does: str = "raise"

    def init(self, prior, world, rows):
        if ((rows.trial == 3) | (rows.trial == 4)).any():
            if self.does == "raise":
                raise RuntimeError("sensor on fire")
            # alone in the second call: the first is given ten seconds more, to compile
            if self.does == "spin" and (len(rows.trial) > 1 or os.path.exists(f"began-{os.getpid()}")):
                while True:
                    pass
            open(f"began-{os.getpid()}", "w").close()
            if self.does == "nan":
                prior = prior._replace(x=prior.x * float("nan"))
        return super().init(prior, world, rows)
'''


class Log(Silent):
    """Remembers what a run says and computes, and ends it by Ctrl-C after some parts."""

    def __init__(self, parts=None):
        self.computed, self.said, self.began, self._left = [], [], None, parts

    def begin(self, trials, found):
        self.began = trials, found

    def advance(self, what, trials, failed):
        self.computed.append((what, trials))
        if len(self.computed) == self._left:
            raise KeyboardInterrupt

    def say(self, line):
        self.said.append(line)


def install(folder):
    """A folder of plug-ins that processes started with `environment` find."""
    (folder / "trouble.py").write_text(PLUGIN)
    info = folder / "trouble-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: trouble\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[cooploc.estimators]\nheld = trouble:Held\ntrouble = trouble:Trouble\n")
    return folder


def environment(plugins):
    """For a process that is started and finds these plug-ins."""
    found = [str(plugins), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, found))}


def inside(*arguments, cwd="."):
    """A command in this process, where a process is not the point."""
    told, complaints, code = io.StringIO(), io.StringIO(), 0
    with (
        contextlib.redirect_stdout(told),
        contextlib.redirect_stderr(complaints),
        contextlib.chdir(cwd),
        patch.dict(os.environ),  # the command line says where pictures go
        patch.object(sys, "argv", ["cooploc", *map(str, arguments)]),
    ):
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    return subprocess.CompletedProcess(arguments, code, told.getvalue(), complaints.getvalue())


class start:
    """Begin a command in a process and a process group of its own, as a shell would; the methods are Popen's."""

    def __init__(self, *arguments, plugins, cwd, prepare=None):
        if arguments[0] == "run" and "--check" not in arguments:  # what is made to fail is checked only where asked for
            arguments = (*arguments, "--no-check")
        self._folder = Path(tempfile.mkdtemp())
        asked = (self._folder, tuple(map(str, arguments)), environment(plugins), str(cwd), prepare)
        self._process = _server().Process(target=_begin, args=asked)
        self._process.start()
        self.pid, self.kill = self._process.pid, self._process.kill

    @property
    def returncode(self):
        return self._process.exitcode

    def poll(self):
        return self._process.exitcode

    def communicate(self, timeout=HANGS):
        """What it said, when it has ended."""
        self._process.join(timeout)
        if self.returncode is None:
            raise TimeoutError(f"still running after {timeout} s")
        found = tuple(file.read_text() if file.exists() else "" for file in _streams(self._folder))
        shutil.rmtree(self._folder)
        return found


def _streams(folder):
    return folder / "stdout", folder / "stderr"


def _server():
    """The context whose server has imported what commands need; it finds `warm` beside this file."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["warm"])
    with patch.dict(os.environ, environment(Path(__file__).parent)):
        forkserver.ensure_running()
    return context


def stop_server():
    """End it, where it was begun, and wait for it: so its processor time counts as that of the tests."""
    forkserver._forkserver._stop()


def _begin(folder, arguments, environ, cwd, prepare):
    """What the forked process does: become what a shell would have started."""
    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # also where this process ignores it
    for number, file in enumerate(_streams(folder), start=1):
        os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT), number)
    sys.stdout, sys.stderr = (open(number, "w", closefd=False) for number in (1, 2))  # noqa: SIM115
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environ)
    sys.path[:0] = [cwd, *environ["PYTHONPATH"].split(os.pathsep)]
    sys.argv = ["cooploc", *arguments]
    if prepare:
        prepare()
    main()


def finish(*arguments, **options):
    """Run to the end."""
    run = start(*arguments, **options)
    told, complaints = run.communicate()
    return subprocess.CompletedProcess(arguments, run.returncode, told, complaints)


def until(condition, seconds=HANGS):
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
