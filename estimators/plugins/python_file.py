"""Estimators and scenarios in a single Python file, named `path.py:Name`, so that nothing has to be installed.

A file is imported under a name made from its content: loading it again gives the same classes, and an edited file gives
new ones. Paths stay as written, relative to the directory where the run began, which its workers share.
"""

import hashlib
import sys
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

import cloudpickle

from cooploc.estimators.plugins.errors import BadInput, nearest, one_line


def is_file(name: str) -> bool:
    """Whether a name is `path.py:Name`.

    Raises:
        BadInput: it is a file's path without the name of an object in it.

    """
    if name.endswith(".py"):
        raise BadInput(f"{name} is a file: say which of its names, {name}:Name")
    return name.rpartition(":")[0].endswith(".py")


def found_in_file(name: str) -> Any:
    """The object that `path.py:Name` names.

    Raises:
        BadInput: the file has no such name, or cannot be imported; says why in one line.

    """
    file, _, attribute = name.rpartition(":")
    module = _imported(Path(file))
    public = [known for known in vars(module) if not known.startswith("_")]
    if not hasattr(module, attribute):
        raise BadInput(f"{file} has no {attribute!r}; {nearest(attribute, public)}")
    return getattr(module, attribute)


def _imported(path: Path) -> ModuleType:
    try:
        source = path.read_bytes()
    except OSError:
        raise BadInput(f"there is no file {path}; write path.py:Name") from None
    digest = hashlib.sha256(str(path.resolve()).encode() + b"\0" + source).hexdigest()
    name = f"_cooploc_{path.stem}_{digest[:12]}"  # hides no module, and pickle finds its classes by it
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_loader(name, loader=None, origin=str(path))
    if spec is None:
        raise BadInput(f"{path} cannot be imported: it is not a Python file")
    module = module_from_spec(spec)
    module.__file__ = str(path.resolve())  # numba and tracebacks look there
    sys.modules[name] = module
    try:
        exec(compile(source, module.__file__, "exec"), vars(module))
    except BaseException as e:
        del sys.modules[name]  # it is half there
        if isinstance(e, MemoryError) or not isinstance(e, (Exception, SystemExit, GeneratorExit)):
            raise  # of the machine, of the time limit or of Ctrl-C, not of the file
        raise BadInput(f"{path} cannot be imported: {one_line(e)}") from e
    cloudpickle.register_pickle_by_value(module)  # a worker could not import it by name
    return module
