"""`cooploc new-estimator NAME`: a small package with an estimator that runs, its test, and what registers it."""

import re
from pathlib import Path
from string import Template

from cooploc.estimators import BUILTIN
from cooploc.estimators.plugins.errors import BadInput

PYPROJECT = Template("""\
[build-system]
requires = ["setuptools>=64"]
build-backend = "setuptools.build_meta"

[project]
name = "$name"
version = "0.1.0"
requires-python = ">=3.11"
dependencies = ["cooploc"]

[project.entry-points."cooploc.estimators"]
$name = "$module:$cls"

[tool.setuptools]
py-modules = ["$module"]
""")

ESTIMATOR = Template('''\
"""$cls: say in two sentences what it does, and name the source."""

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from cooploc import Belief, Mail, Rows, World
from cooploc.estimators.kalman.update import kalman
from cooploc.estimators.interface import Senses


class State(NamedTuple):
    """What a robot remembers; rows r are (trial, robot)."""

    x: Any  # (r, d)     x [m], y [m], and heading [rad] where d = 3
    P: Any  # (r, d, d)  its covariance
    world: World


@dataclass(frozen=True)
class $cls:
    """A Kalman filter on a robot's own readings; sends nothing yet."""

    api: ClassVar[int] = 1
    uses: tuple[str, ...] = ("odometry", "anchor_rssi|landmark")
    gate: float = 13.8  # squared Mahalanobis distance beyond which a reading is refused

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        return State(prior.x, prior.P, world)

    def predict(self, s: State, z: Senses) -> State:
        x, F, Q = s.world.motion.move(s.x, z.odometry, z.dt)
        return s._replace(x=x, P=F @ s.P @ F.mT + Q)

    def correct(self, s: State, z: Senses) -> State:
        x, P = s.x, s.P
        for sensor, place, reading in s.world.fixed(z):
            y, H, _ = sensor.innovation(x, place, reading)
            x, P = kalman(x, P, y, H, sensor.R, self.gate)
        return s._replace(x=x, P=P)

    def send(self, s: State, z: Senses) -> Any:
        return np.empty((len(s.x), 0))  # (r, m) numbers for everyone; nan is silence

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        return s  # mail.packets (r, n, m) where mail.heard (r, n)

    def estimate(self, s: State) -> Belief:
        return Belief(s.x, (s.P + s.P.mT) / 2)
''')

TEST = Template('''\
"""$cls keeps to the rules of the comparison: one test for each check."""

from $module import $cls

from cooploc.scenarios.conformance.check import parametrize


@parametrize($cls())
def test_it_conforms(check):
    check()
''')

README = Template("""\
# $name

An estimator for [cooploc](https://pypi.org/project/cooploc/).

    pip install -e .
    cooploc list estimators                        # $name is among them
    pytest                                         # is it fair, and does it keep to the interface?
    cooploc check $name
    cooploc run quick --estimators mrsl-rssi,$name
""")


def create(name: str, folder: Path) -> list[Path]:
    """Write the package into `folder`; returns its files.

    Raises:
        BadInput: a name that cannot be, or a folder that is there already.

    """
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name):
        raise BadInput(f"{name!r} cannot name an estimator: write small letters, digits and hyphens, such as my-filter")
    if name in BUILTIN:
        raise BadInput(f"{name!r} is a built-in estimator: choose another name")
    if folder.exists():
        raise BadInput(f"{folder} exists: choose another name, or remove it")
    module = f"{name.replace('-', '_')}_estimator"
    words = {"name": name, "module": module, "cls": "".join(part.capitalize() for part in name.split("-"))}
    made = {
        "pyproject.toml": PYPROJECT,
        f"{module}.py": ESTIMATOR,
        "README.md": README,
        f"test_{module}.py": TEST,
    }
    folder.mkdir(parents=True)
    for file, template in made.items():
        (folder / file).write_text(template.substitute(words), encoding="utf-8")
    return [folder / file for file in made]
