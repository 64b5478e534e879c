"""What is shipped: every module in wheel and sdist, a wheel that works in an empty environment, an honest lock."""

import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
SOURCES = {
    file.relative_to(ROOT).as_posix()
    for folder in ("cooploc", "estimators", "scenarios", "analysis")
    for file in (ROOT / folder).rglob("*")  # does not follow the links inside cooploc/
    if file.is_file() and "__pycache__" not in file.parts
}
SHIPPED = {name if name.startswith("cooploc/") else f"cooploc/{name}" for name in SOURCES}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The sdist, and the wheel built from it, of a copy of the tree."""
    tree, ignored = tmp_path_factory.mktemp("tree") / "cooploc", (".*", "build", "dist", "runs", "*.egg-info")
    shutil.copytree(ROOT, tree, symlinks=True, ignore=shutil.ignore_patterns(*ignored))
    out = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(tree)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return next(out.glob("*.tar.gz")), next(out.glob("*.whl"))


def test_every_folder_with_code_is_a_package():
    """A folder without `__init__.py` would drop out of the wheel and of import-linter's sight."""
    folders = {(ROOT / name).parent for name in SOURCES if name.endswith(".py")}
    assert [folder for folder in sorted(folders) if not (folder / "__init__.py").exists()] == []


@pytest.mark.slow
def test_wheel_and_sdist_hold_every_module(built):
    names = set(zipfile.ZipFile(built[1]).namelist())
    assert names >= SHIPPED
    assert {name for name in names if name.endswith(".py")} == {name for name in SHIPPED if name.endswith(".py")}
    with tarfile.open(built[0]) as sdist:
        names = {name.partition("/")[2] for name in sdist.getnames()}
    examples = {f"examples/{file.name}" for file in (ROOT / "examples").iterdir() if file.is_file()}
    assert names >= SOURCES | examples | {"pyproject.toml", "LICENSE", "README.md"}


def needed(requirements, extras=("",)):
    """The names of all distributions that these requirements ask for, and what those ask for."""
    asked = [one for one in map(Requirement, requirements) if is_asked_for(one, extras)]
    below = (needed(metadata.requires(one.name) or (), tuple(one.extras) or ("",)) for one in asked)
    return {one.name for one in asked}.union(*below)


def is_asked_for(requirement, extras):
    return requirement.marker is None or any(requirement.marker.evaluate({"extra": extra}) for extra in extras)


@pytest.mark.slow
def test_the_wheel_runs_in_an_empty_environment(built, tmp_path):
    """Its declared dependencies suffice: a new environment has the wheel and what it asks for, and nothing else."""
    venv.create(tmp_path)
    pip = [sys.executable, "-m", "pip", "--python", str(tmp_path / "bin" / "python"), "--disable-pip-version-check"]
    subprocess.run([*pip, "install", "--quiet", "--no-index", "--no-deps", "--no-compile", str(built[1])], check=True)
    (site,) = (tmp_path / "lib").glob("python*/site-packages")
    (installed,) = metadata.distributions(name="cooploc", path=[str(site)])
    for name in needed(installed.requires):
        for top in {file.parts[0] for file in metadata.files(name)} - {".."}:
            if not (site / top).exists():
                (site / top).symlink_to(metadata.distribution(name).locate_file(top))
    told = subprocess.run([str(tmp_path / "bin" / "cooploc"), "list"], capture_output=True, text=True, cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    assert "mrsl-rssi" in told.stdout


@pytest.mark.parametrize(
    ("lock", "extras"), [("requirements.lock", {"cluster", "dev"}), ("docs/requirements.lock", {"docs"})]
)
def test_a_lock_pins_every_dependency_with_hashes_and_names_no_index(lock, extras):
    text = (ROOT / lock).read_text(encoding="utf-8")
    assert not re.search(r"https?://|--index-url|--find-links|file:", text)
    pinned = re.findall(r"^([A-Za-z0-9._-]+)==[^\s;]+", text, re.MULTILINE)
    entries = re.split(r"^(?=[A-Za-z0-9])", text, flags=re.MULTILINE)[1:]
    assert len(entries) == len(pinned)
    assert all("--hash=sha256:" in entry for entry in entries)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *(d for extra in extras for d in project["optional-dependencies"][extra])]
    names = {re.sub("[._]", "-", re.split(r"[><=\[ ;]", requirement)[0].lower()) for requirement in wanted}
    assert names <= {name.lower() for name in pinned}
