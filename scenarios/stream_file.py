"""The file of a stream: a zip of plain arrays (numpy's npz, no pickle) whose member `header` is JSON."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from cooploc.estimators import models
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import World

FORMAT = 3  # 2 had a checksum in its header
PLACES = ("arena", "anchors", "landmarks")  # what a world has as arrays
MODELS: dict[str, type[Any]] = {
    cls.__name__: cls
    for cls in (
        models.Displacement,
        models.Unicycle,
        models.LogDistance,
        models.Range,
        models.Bearing,
        models.Sighting,
        models.GradientDoa,
    )
}


def write(path: Path, header: Mapping[str, Any], world: World, arrays: Mapping[str, Any]) -> None:
    """Write a stream's header, world and arrays.

    Raises:
        BadInput: the world has a model of another package, which a file cannot describe.

    """
    described = {
        "format": FORMAT,
        "what": "cooploc stream: arrays are (trial, tick, robot, ...), SI units, nan is absent",
        "robots": world.robots,
        "tick": world.tick,
        "t0": world.t0,
        "motion": _describe(world.motion),
        "sensors": {channel: _describe(sensor) for channel, sensor in world.sensors.items()},
        **header,
    }
    places = {name: getattr(world, name) for name in PLACES}
    encoded = np.frombuffer(json.dumps(described, indent=1).encode(), np.uint8)
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, header=encoded, **places, **dict(arrays))


def read(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the header and the arrays of a file; the zip has a checksum of each.

    Raises:
        BadInput: there is no file, it is not a stream's, not what was written, or of a newer format.

    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        header: dict[str, Any] = json.loads(arrays.pop("header").tobytes())
        newer = header["format"] > FORMAT
    except FileNotFoundError:
        raise BadInput(f"there is no file {path}; name a stream that cooploc wrote") from None
    except Exception as e:  # zip, zlib and numpy raise whatever they meet
        why = " ".join(f"{type(e).__name__}: {e}".split())[:200]
        raise BadInput(f"{path} is not a stream's file ({why}); name one that cooploc wrote") from None
    if newer:
        raise BadInput(f"{path} has format {header['format']}, this version reads up to {FORMAT}: update cooploc")
    return header, arrays


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
