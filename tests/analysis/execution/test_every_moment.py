"""Whatever the moment of death between a run's start and its first part, the same command goes on."""

from functools import partial

import pytest
from dying import EXIT, die_at
from processes import finish, inside, parts

pytestmark = pytest.mark.slow
TINY = 'trials = 1\nscenarios = ["robots-1-3/n=1[ticks=2]"]\nestimators = ["dead-reckoning"]\n'
MOST = 200  # operations, which no run of one part needs


def test_a_run_that_dies_before_any_of_its_file_operations_goes_on(tmp_path):
    (tmp_path / "tiny.toml").write_text(TINY)
    whole = inside("run", "tiny.toml", "--out", "whole", cwd=tmp_path)
    assert whole.returncode == 0, whole.stderr
    for number in range(1, MOST):
        out = f"run{number}"
        command = ("run", "tiny.toml", "--out", out)
        died = finish(*command, plugins=tmp_path, cwd=tmp_path, prepare=partial(die_at, number, f"{out}"))
        assert died.returncode == EXIT, died.stderr
        there = parts(tmp_path / out)
        again = inside(*command, cwd=tmp_path)
        assert again.returncode == 0, f"before operation {number}: {again.stderr}"
        assert parts(tmp_path / out) == parts(tmp_path / "whole")
        assert not list((tmp_path / out).rglob("*.tmp"))
        if there:
            break
    assert 10 < number < MOST - 1
