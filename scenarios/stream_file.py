"""The file of a stream: a zip of plain arrays (numpy's npz, no pickle) whose member `header` is JSON."""

import hashlib
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from cooploc.estimators.interface import World
from cooploc.estimators.models import gradient_doa, motion, sensors
from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.guard import LOADED
from cooploc.scenarios.sealed import SEALED, Damaged, parsed, seal, unsealed
from cooploc.scenarios.stream_header import PLACES, demand_header, demand_shapes
from cooploc.scenarios.zip_sizes import demand_sizes

FORMAT = SEALED
MODELS: dict[str, type[Any]] = {
    cls.__name__: cls
    for cls in (
        motion.Displacement,
        motion.Unicycle,
        sensors.LogDistance,
        sensors.Range,
        sensors.Bearing,
        sensors.Sighting,
        gradient_doa.GradientDoa,
    )
}


def write(path: Path, header: Mapping[str, Any], world: World, arrays: Mapping[str, Any]) -> None:
    """Write a stream's header, world and arrays.

    Raises:
        BadInput: the world has a model of another package, which a file cannot describe.

    """
    places = {name: getattr(world, name) for name in PLACES}
    described = {
        "format": FORMAT,
        "what": "cooploc stream: arrays are (trial, tick, robot, ...), SI units, nan is absent",
        "robots": world.robots,
        "tick": world.tick,
        "t0": world.t0,
        "motion": _describe(world.motion),
        "sensors": {channel: _describe(sensor) for channel, sensor in world.sensors.items()},
        **header,
        "digests": {name: _digest(array) for name, array in {**places, **arrays}.items() if _needs_digest(name)},
    }
    encoded = np.frombuffer(json.dumps(seal(described), indent=1).encode(), np.uint8)
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, header=encoded, **places, **dict(arrays))


def read(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The header and the arrays of a file.

    Raises:
        BadInput: there is no file, it is not a stream's, not what was written, or of a newer format.

    """
    sys.audit(LOADED, str(path))
    if path.exists() and not path.is_file():
        raise BadInput(f"{path} is not a file; name a stream that cooploc wrote")
    try:
        demand_sizes(path)
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        content = parsed(arrays.pop("header").tobytes())
        newer = content["format"] > FORMAT
        header = {} if newer else unsealed(content)
    except FileNotFoundError:
        raise BadInput(f"there is no file {path}; name a stream that cooploc wrote") from None
    except Exception as e:  # zip, zlib and numpy raise whatever they meet
        why = " ".join(f"{type(e).__name__}: {e}".split())[:200]
        raise BadInput(f"{path} is not a stream's file ({why}); name one that cooploc wrote") from None
    if newer:
        raise BadInput(f"{path} has format {content['format']}, this version reads up to {FORMAT}: update cooploc")
    try:
        demand_header(header)
        demand_shapes(header, arrays)
        _demand_digests(header, arrays)
    except Damaged as e:
        raise BadInput(f"{path} is incomplete or inconsistent ({e}); get the file again") from None
    return header, arrays


def _needs_digest(name: str) -> bool:
    """True for an array that the hashes of the trials leave out."""
    return name in (*PLACES, "trial", "time")


def _digest(array: Any) -> str:
    plain = np.ascontiguousarray(array)
    return hashlib.sha256(f"{plain.dtype.str} {plain.shape};".encode() + plain.tobytes()).hexdigest()


def _demand_digests(header: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    for name, stated in header.get("digests", {}).items():
        if name not in arrays or _digest(arrays[name]) != stated:
            raise Damaged(f"its array {name!r} is not what was written")


def world_of(header: Mapping[str, Any], arrays: Mapping[str, Any]) -> World:
    """The world that a file describes.

    Raises:
        BadInput: it names a model that this version does not know.

    """
    return World(
        robots=header["robots"],
        tick=header["tick"],
        t0=header["t0"],
        motion=_model(header["motion"]),
        sensors={channel: _model(described) for channel, described in header["sensors"].items()},
        **{name: arrays[name] for name in PLACES},
    )


def _describe(model: Any) -> dict[str, Any]:
    name = type(model).__name__
    known: object = MODELS.get(name)
    if known is not type(model):
        raise BadInput(f"a stream with the model {name} cannot be written: only {', '.join(MODELS)} have a description")
    return {"model": name, **asdict(model)}


def _model(described: dict[str, Any]) -> Any:
    name = str(described["model"])
    if name not in MODELS:
        raise BadInput(f"the stream names a model {name!r} that this version does not know: update cooploc")
    return TypeAdapter(MODELS[name]).validate_python({k: v for k, v in described.items() if k != "model"})
