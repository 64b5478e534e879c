"""Kernels are kept on disk, and compiled again when a file that they are made of has changed."""

import ast
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numba
import pytest

import cooploc.estimators
from cooploc.estimators.compiled import SHARED, cache_directory, strict_kernel

ROOM = Path(cooploc.estimators.__file__).parent


@pytest.mark.slow
def test_second_process_takes_kernels_from_the_disk(tmp_path):
    """And a process in which a shared source has changed compiles them again."""
    use = """
k.systematic(np.full((1, 4), 0.25), np.array([0.5]))
print(sum(k._fill_ancestors.stats.cache_hits.values()))
"""
    imported = "from cooploc.estimators import particle_kernels as k; import numpy as np"
    changed = "from cooploc.estimators import compiled; compiled.SOURCES.append(b'changed')"

    def begun(*lines):
        command = [sys.executable, "-c", "\n".join([*lines, imported, use])]
        env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        return subprocess.Popen(command, env=env, stdout=subprocess.PIPE, text=True)

    at_once = [begun(), begun()]  # the one waits while the other compiles
    assert sorted(int(one.communicate()[0]) for one in at_once) == [0, 1]
    assert int(begun(changed).communicate()[0]) == 0


def double(x):
    return 2 * x


def test_where_no_folder_can_be_written_kernels_are_kept_among_the_user_s_temporary_files(tmp_path, monkeypatch):
    """As in a container whose user has no home. Of a directory that others may write nothing is read."""
    own, real = tmp_path / f"cooploc-{os.getuid()}", numba.njit

    def without_folder(*function, **options):
        if options.get("cache") and not numba.config.CACHE_DIR:
            raise RuntimeError("cannot cache function: no locator available")
        return real(*function, **options)

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(numba, "njit", without_folder)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    for is_own in (True, False):
        monkeypatch.setattr(numba.config, "CACHE_DIR", "")
        kernel = strict_kernel(double)
        assert kernel(2.0) == 4.0
        assert tmp_path in cache_directory(kernel).parents
        assert (own in cache_directory(kernel).parents) == is_own
        own.chmod(0o777)


def test_every_file_whose_functions_are_inlined_elsewhere_is_listed_as_shared():
    """Otherwise a kernel that was compiled before such a file changed would be used after."""
    inlined_elsewhere = re.compile(r"^@(strict_)?(inlined|intrinsic)\ndef [a-z]", re.MULTILINE)
    files = [f for f in ROOM.rglob("*.py") if inlined_elsewhere.search(f.read_text())]
    assert len(files) > 3
    assert {f.relative_to(ROOM).with_suffix("").as_posix() for f in files} <= set(SHARED)


@pytest.mark.slow
def test_no_bit_depends_on_which_kernel_was_compiled_first():
    """numba keeps one function for `x ** 2` in a process, as the first kernel that has one wants it, fast or strict."""
    bases = set()
    for file in ROOM.rglob("*.py"):
        functions = (one for one in ast.walk(ast.parse(file.read_text())) if isinstance(one, ast.FunctionDef))
        fast = (f for f in functions if {"kernel", "inlined"} & set(map(ast.unparse, f.decorator_list)))
        powers = (
            one for f in fast for one in ast.walk(f) if isinstance(one, ast.BinOp) and isinstance(one.op, ast.Pow)
        )
        bases |= {(file.name, ast.unparse(one.left)) for one in powers}
    assert {base for base in bases if not re.fullmatch(r"[A-Z_]+|[0-9.]+", base[1])} == {
        ("particle_kernels.py", "n")  # n ** (-1 / 6), of libm
    }
