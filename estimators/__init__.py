"""Estimators: the methods that a robot or a team runs. They import nothing of the world they are judged in.

To add one: write a file like `ekf_local.py`, and give it a line in `BUILTIN`. From outside, name it `path.py:Name`,
register a class under the entry-point group `cooploc.estimators`, or pass an instance to `cl.run`.
"""

import sys
from typing import Any

from cooploc.estimators.building import ConfiguredEstimator, build
from cooploc.estimators.errors import BadInput
from cooploc.estimators.errors import nearest as nearest
from cooploc.estimators.label_syntax import parse as parse
from cooploc.estimators.label_syntax import shorten_labels as shorten_labels
from cooploc.estimators.label_syntax import split_labels as split_labels
from cooploc.estimators.registry import CallablePackage, Registry, load_object, refusal

# name -> its class, and the parameters that differ from the class's defaults
BUILTIN: dict[str, tuple[str, dict[str, Any]]] = {
    "dead-reckoning": ("cooploc.estimators.dead_reckoning:DeadReckoning", {}),
    "arl": ("cooploc.estimators.arl:Arl", {}),
    "rssi-pf": ("cooploc.estimators.arl:Arl", {"anchor_reading": "rssi"}),
    "mrsl-rssi": ("cooploc.estimators.mrsl:Mrsl", {"reading": "rssi"}),
    "mrsl-distance": ("cooploc.estimators.mrsl:Mrsl", {"reading": "range"}),
    "ctrn": ("cooploc.estimators.ctrn:Ctrn", {}),
    "cmrl": ("cooploc.estimators.cmrl:Cmrl", {}),
    "reciprocal-pf": ("cooploc.estimators.reciprocal_pf:ReciprocalPf", {}),
    "channel-pf": ("cooploc.estimators.channel_pf:ChannelPf", {}),
    "ekf-local": ("cooploc.estimators.ekf_local:EkfLocal", {}),
    "ekf-joint": ("cooploc.estimators.ekf_joint:EkfJoint", {}),
    "ekf-naive": ("cooploc.estimators.ekf_naive:EkfNaive", {}),
    "ekf-ci": ("cooploc.estimators.ekf_ci:EkfCi", {}),
    "ekf-split-ci": ("cooploc.estimators.ekf_split_ci:EkfSplitCi", {}),
    "ekf-ici": ("cooploc.estimators.ekf_ici:EkfIci", {}),
    "ekf-hmd": ("cooploc.estimators.ekf_hmd:EkfHmd", {}),
    "ekf-event-ci": ("cooploc.estimators.ekf_event_ci:EkfEventCi", {}),
    "ekf-gs-ci": ("cooploc.estimators.ekf_gs_ci:EkfGsCi", {}),
    "ekf-luft": ("cooploc.estimators.ekf_luft:EkfLuft", {}),
    "ekf-interim": ("cooploc.estimators.ekf_interim:EkfInterim", {}),
    "iekf-joint": ("cooploc.estimators.iekf_joint:IekfJoint", {}),
    "ukf-joint": ("cooploc.estimators.ukf_joint:UkfJoint", {}),
    "gbp": ("cooploc.estimators.gbp:Gbp", {}),
    "map-joint": ("cooploc.estimators.map_joint:MapJoint", {}),
    "constant": ("cooploc.estimators.dead_reckoning:Constant", {}),
}

REGISTRY = Registry("estimator", "cooploc.estimators", BUILTIN)
names, module_of = REGISTRY.names, REGISTRY.module_of


def make(configured: str | ConfiguredEstimator, **parameters: Any) -> Any:
    """Make an estimator by name, `make("mrsl-rssi", particles=500)` or `make("mrsl-rssi[particles=500]")`.

    Args:
        configured: the name of a built-in or a plug-in, or `path.py:Name`, where Name is a class or an instance; with
            parameters in brackets or without.
        parameters: those that differ from the defaults.

    Raises:
        BadInput: an unknown name or parameter, or a value that does not fit; says the nearest known one.
    """
    asked = configured if isinstance(configured, ConfiguredEstimator) else configure(configured)
    found, preset = REGISTRY.find(asked.name), {}
    if asked.builtin:
        place, preset = found
        found = load_object(place, f"the estimator {asked.name!r}")
    return build(asked.name, found, {**preset, **asked.parameters, **parameters})


def configure(label: str) -> ConfiguredEstimator:
    """Read a label, once, or raise BadInput; `make` turns it into an instance."""
    name, parameters = parse(label)
    if (given := shorten_labels(label).partition("[")[0].strip()) != name and given in names():
        raise BadInput(f"an estimator is called {given!r} already: give {name} another name")
    return ConfiguredEstimator(label, name, parameters, name in BUILTIN)


def is_builtin(estimator: Any) -> bool:
    """Return whether a name, a class or an instance is one of `BUILTIN`, whose code the tests of this package hold."""
    if isinstance(estimator, str):
        return configure(estimator).builtin
    cls = estimator if isinstance(estimator, type) else type(estimator)
    return f"{cls.__module__}:{cls.__qualname__}" in {place for place, _ in BUILTIN.values()}


def plugin_errors() -> dict[str, str]:
    """Return the installed plug-ins that cannot be used, by name, with the reason."""
    return REGISTRY.errors(_unusable)


def _unusable(name: str) -> str:
    try:
        return refusal(make(name))
    except Exception as e:  # a plug-in may fail in any way
        return str(e) if isinstance(e, BadInput) else f"{type(e).__name__}: {e}"


sys.modules[__name__].__class__ = CallablePackage
